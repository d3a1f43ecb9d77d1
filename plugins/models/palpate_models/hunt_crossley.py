"""Hunt and Crossley's power-law spring and damper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from palpate import ContactModel, Indenter, MaterialValue, Parameter
from pydantic import Field

from palpate_models.parameters import EXPONENT, REFERENCE_DAMPING, REFERENCE_FORCE

_REFERENCE_DEPTH = 1e-3  # [m], a choice: there K_c [N] is Hunt and Crossley's number in N/mm^n
_EXPONENT_TOLERANCE = 0.05  # a choice: exponents closer than this are the same power


def _power_law_force(depth: Any, rate: Any, force: Any, damping: Any, exponent: Any) -> Any:
    return (force + damping * rate) * (depth / _REFERENCE_DEPTH) ** exponent


def _material(
    indenter: Indenter | None, poisson: float, theta: Sequence[float], exponent: float
) -> tuple[MaterialValue, ...]:
    """Return E = K_c (1 - nu^2)/(2 A(1 mm)) if the tip's own force has the same power of depth, else nothing.

    K_c [N], the first of `theta`, is the force at 1 mm; A is the tip's profile area.
    """
    if indenter is None:
        return ()
    # The tip's power at that depth is the slope of ln A by ln d, a d/A.
    area = float(indenter.profile_area(_REFERENCE_DEPTH))
    tip_exponent = float(indenter.contact_radius(_REFERENCE_DEPTH)) * _REFERENCE_DEPTH / area
    if abs(tip_exponent - exponent) > _EXPONENT_TOLERANCE:
        return ()
    # The modulus is proportional to K_c alone.
    slope = (1.0 - poisson**2) / (2.0 * area)
    gradient = (slope, *(0.0 for _ in theta[1:]))
    caveat = (
        f"from a power law whose exponent {exponent:.3g} is that of this tip at 1 mm; its damping gives no viscosity"
    )
    return (MaterialValue("elasticity", theta[0] * slope, gradient, caveat),)


class HuntCrossley(ContactModel):
    """A power-law spring whose damping grows with depth as the force does, with a fixed exponent.

    F = (K_c + B_c d') (d/d_0)^n with d_0 = 1 mm, so that K_c [N] is the force at rest at a depth of 1 mm: the number
    that Hunt and Crossley's K_c has in N/mm^n, in a unit that does not depend on n. n = 1.5 is a sphere, 2 a cone,
    1 a flat tip. Out of contact the force is 0; at touch it is continuous, unlike `kelvin-voigt`.
    E follows only where the tip's own force goes with the same power; no viscosity follows, since the damping of a
    half-space goes with d^(n-1).
    Source: Hunt and Crossley 1975; paper, eq. of the Hunt-Crossley model.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (REFERENCE_FORCE, REFERENCE_DAMPING)

    exponent: float = Field(default=1.5, ge=0.5, le=4, description="power n of the depth")
    indenter: Indenter | None = Field(default=None, description="the tip; with one of the same power, E is derived")
    poisson: float = Field(default=0.5, ge=0, le=0.5, description="Poisson's ratio nu, for E")

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """(K_c + B_c d') (d/1 mm)^n [N]."""
        return _power_law_force(depth, rate, theta[0], theta[1], self.exponent)

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E = K_c (1 - nu^2)/(2 A(1 mm)) under a tip of the same power."""
        return _material(self.indenter, self.poisson, theta, self.exponent)


class FreeHuntCrossley(ContactModel):
    """`hunt-crossley` with its exponent estimated, too.

    F = (K_c + B_c d') (d/d_0)^n with d_0 = 1 mm. A depth that is inferred and not measured trades against n: give
    the alignment a measured surface, or expect a wide uncertainty.
    Source: Hunt and Crossley 1975; paper, eq. of the Hunt-Crossley model.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (REFERENCE_FORCE, REFERENCE_DAMPING, EXPONENT)

    indenter: Indenter | None = Field(default=None, description="the tip; with one of the same power, E is derived")
    poisson: float = Field(default=0.5, ge=0, le=0.5, description="Poisson's ratio nu, for E")

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """(K_c + B_c d') (d/1 mm)^n [N]."""
        return _power_law_force(depth, rate, theta[0], theta[1], theta[2])

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E = K_c (1 - nu^2)/(2 A(1 mm)) under a tip of the same power."""
        return _material(self.indenter, self.poisson, theta, theta[2])
