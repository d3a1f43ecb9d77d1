"""A flat tip that does not stand square on the surface."""

from __future__ import annotations

import math
from typing import Any

from palpate import Angle, Depth, Indenter, select
from pydantic import Field

_POWER = 1.7  # of u, fitted to boundary elements; value and slope in full contact are exact
_BEND = 0.2  # of u, with `_POWER`
_MAX_TILT = math.radians(15.0)  # a choice: larger angles are not small


class TiltedFlat(Indenter):
    """A flat-ended cylinder of radius R whose face is tilted by a small angle t against the surface.

    Its edge touches first; depth counts from there. From d = 3 R t on the whole face touches and the force is that of
    `flat` at the depth of its middle: A(d) = R (d - R t), exact (the tilted punch's pressure is
    E* (d - R t + 2 t x)/(pi sqrt(R^2 - r^2)), nowhere negative). Before, with u = d/(3 R t),
    A = 2 t R^2 u^1.7 (1.2 - 0.2 u) and a = A' = (2/3) R (2.04 u^0.7 - 0.54 u^1.7), which joins it in value and slope;
    boundary elements give the force within 1.5 % for u > 0.25 and within 11 % at u = 0.03, where it is 0.4 % of that at
    full contact. Assumes a rigid holder, small angles, no friction; the moment and the contact's shape are left out.
    Source: Johnson 1985, section 3.4 (rigid punch, tilted) for full contact; boundary elements for what is before.
    """

    radius: Depth = Field(gt=0, description="radius R of the face")
    tilt: Angle = Field(gt=0, le=_MAX_TILT, description="angle t between face and surface")

    @property
    def full_depth(self) -> float:
        """The depth 3 R t [m] from which on the whole face touches."""
        return 3.0 * self.radius * self.tilt

    def _share(self, depth: Any) -> Any:
        """Return u, 1 at most."""
        u = depth / self.full_depth
        return select(u, 1.0, 1.0 + 0.0 * u, u)

    def contact_radius(self, depth: Any) -> Any:
        """(2/3) R (2.04 u^0.7 - 0.54 u^1.7), R in full contact [m]."""
        u = self._share(depth)
        bent = _POWER * (1.0 + _BEND) - (_POWER + 1.0) * _BEND * u
        return 2.0 / 3.0 * self.radius * u ** (_POWER - 1.0) * bent

    def profile_area(self, depth: Any) -> Any:
        """2 t R^2 u^1.7 (1.2 - 0.2 u), R (d - R t) in full contact [m^2]."""
        u = self._share(depth)
        partly = 2.0 * self.tilt * self.radius**2 * u**_POWER * (1.0 + _BEND - _BEND * u)
        deeper = depth - self.full_depth
        return partly + self.radius * select(deeper, 0.0, deeper, 0.0 * depth)
