"""Elastic contact of a sphere that sticks, by the theories called DMT and JKR."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

from palpate import ContactModel, Depth, MaterialValue, Parameter, select
from pydantic import Field

from palpate_models.parameters import ADHESION_WORK, ELASTICITY

_POLE_GUARD = 1e-30  # a choice far below any work of adhesion over a modulus: w = 0 has no pole
_MAX_DEPTH_RATIO = 0.2  # of R: there a paraboloid is 2 % above the sphere, by d/(10 R) (see `exact-sphere`)


class _AdhesiveSphere(ContactModel):
    """Sphere and Poisson's ratio of a contact that sticks."""

    parameters: ClassVar[tuple[Parameter, ...]] = (ELASTICITY, ADHESION_WORK)
    adhesive: ClassVar[bool] = True

    radius: Depth = Field(gt=0, description="radius R of the sphere, half of its diameter")
    poisson: float = Field(default=0.5, ge=0, le=0.5, description="Poisson's ratio nu; 0.5 for incompressible material")

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E itself."""
        return (MaterialValue("elasticity", theta[0], (1.0, 0.0)),)

    def validity(self, depth: float) -> str:
        """Return a warning beyond the depth at which the paraboloid of both theories is 2 % above the sphere."""
        if depth <= _MAX_DEPTH_RATIO * self.radius:
            return ""
        share, limit = f"{depth / self.radius:.0%}", f"{100 * _MAX_DEPTH_RATIO:.0f} %"
        return f"the depth is {share} of the radius; a paraboloid approximates the sphere up to {limit}"

    def _plane_strain(self, elasticity: Any) -> Any:
        """E* = E/(1 - nu^2) [Pa]."""
        return elasticity / (1.0 - self.poisson**2)


class DerjaguinMullerToporov(_AdhesiveSphere):
    """A sphere on a half-space that attracts it from outside of the contact: stiff material, small tip, weak adhesion.

    F = 4/3 E* sqrt(R) d^1.5 - 2 pi w R in contact, 0 out of it, with E* = E/(1 - nu^2) and the work of adhesion w. The
    tip comes off at depth 0 with a pull of 2 pi w R.
    Assumes a paraboloid on a homogeneous elastic half-space, small strain, no viscosity, and Tabor's parameter
    (R w^2/(E*^2 z_0^3))^(1/3), z_0 some 0.3 nm, below 0.1.
    Source: Derjaguin, Muller and Toporov 1975; Maugis 1992.
    """

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """4/3 E* sqrt(R) d^1.5 - 2 pi w R [N]."""
        hertz = 4.0 / 3.0 * self._plane_strain(theta[0]) * self.radius**0.5 * depth**1.5
        return hertz - 2.0 * math.pi * self.radius * theta[1] + 0.0 * rate


class JohnsonKendallRoberts(_AdhesiveSphere):
    """A sphere on a half-space that sticks within the contact: soft material, large tip, strong adhesion.

    F = 4 E* a^3/(3 R) - sqrt(8 pi w E* a^3) with the contact radius a from d = a^2/R - sqrt(2 pi w a/E*), in closed
    form (a quartic in sqrt(a)), E* = E/(1 - nu^2) and the work of adhesion w. On approach, the tip touches at d = 0 and
    is drawn in with 8/9 of the largest pull, 1.5 pi w R; leaving, it holds on to d = -3/4 (pi^2 w^2 R/E*^2)^(1/3),
    where it comes off with 5/6 pi w R. Below d = 0 the direction says which of both it is, so that a tip that turns
    there is not followed. Assumes a paraboloid on a homogeneous elastic half-space, small strain, no viscosity, a stiff
    robot (motion is given, not force), the same w coming and leaving, and Tabor's parameter (see `dmt`) above 5.
    Source: Johnson, Kendall and Roberts 1971; Maugis 1992.
    """

    def _scale(self, theta: Sequence[Any]) -> Any:
        """c R = sqrt(2 pi w/E*) R [m^1.5], of which the depth goes as the power 4/3 over R."""
        return (2.0 * math.pi * theta[1] / self._plane_strain(theta[0]) + _POLE_GUARD) ** 0.5 * self.radius

    def pull_off_depth(self, theta: Sequence[Any]) -> Any:
        """-3/4 (pi^2 w^2 R/E*^2)^(1/3) [m]."""
        ratio = math.pi * theta[1] / self._plane_strain(theta[0])
        return -0.75 * (ratio**2 * self.radius + _POLE_GUARD) ** (1 / 3)

    def contact_radius(self, depth: Any, theta: Sequence[Any]) -> Any:
        """Return the larger root a of a^2/R - sqrt(2 pi w a/E*) = d [m].

        With s = sqrt(a)/(c R)^(1/3), c = sqrt(2 pi w/E*), and D = d R/(c R)^(4/3) it is s^4 - s = D, whose resolvent
        cubic m^3 + D m = 1/8 has one real root wherever the contact holds.
        """
        unit = self._scale(theta)
        D = depth * self.radius / unit ** (4 / 3)
        # The real root of the resolvent cubic by Cardano, (1/16 + q)^(1/3) + (1/16 - q)^(1/3) with q^2 = 1/256 +
        # (D/3)^3, as a quotient: the two cube roots would cancel.
        discriminant = 1 / 256 + (D / 3.0) ** 3
        square_root = select(discriminant, 0.0, select(discriminant, 0.0, discriminant, 1.0) ** 0.5, 0.0)
        first = (1 / 16 + square_root) ** (1 / 3)
        second = D / (3.0 * first)
        m = 0.125 / (first * first + D / 3.0 + second * second)
        # The larger root of the quartic by Ferrari, s = sqrt(m/2) + sqrt(1/(2 sqrt(2 m)) - m/2).
        radicand = 1.0 / (2.0 * (2.0 * m) ** 0.5) - m / 2.0
        s = (m / 2.0) ** 0.5 + select(radicand, 0.0, select(radicand, 0.0, radicand, 1.0) ** 0.5, 0.0)
        return (unit ** (1 / 3) * s) ** 2

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """4 E* a^3/(3 R) - sqrt(8 pi w E* a^3) [N]."""
        modulus, radius = self._plane_strain(theta[0]), self.contact_radius(depth, theta)
        sticking = (8.0 * math.pi * theta[1] * modulus + _POLE_GUARD) ** 0.5 * radius**1.5
        return 4.0 / 3.0 * modulus * radius**3 / self.radius - sticking + 0.0 * rate
