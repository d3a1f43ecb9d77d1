"""The method of dimensionality reduction, elastic and viscous: the paper's contact model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from palpate import ContactModel, Indenter, Parameter
from pydantic import Field


class DimensionalityReduction(ContactModel):
    """A soft half-space as a row of springs and dampers, pressed by any axisymmetric tip.

    F = 2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d', with the tip's contact radius a(d) and profile area A(d).
    For a sphere this is (4/3) E/(1 - nu^2) sqrt(R) d^1.5 + 4 eta/(1 - nu) sqrt(R d) d'.
    Assumes a homogeneous, isotropic, flat half-space, small strain (a/R well below 1, depth below some 10 % of the
    thickness), no friction and no adhesion; material of Kelvin-Voigt type.
    Source: paper, eqs. kv_el and TotalForce; Popov and Hess 2015.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("elasticity", "E", "Pa", "Young's modulus of the material", role="elastic"),
        Parameter("viscosity", "eta", "Pa*s", "shear viscosity of the material", role="viscous"),
    )

    indenter: Indenter = Field(description="the tip")
    poisson: float = Field(default=0.5, ge=0, le=0.5, description="Poisson's ratio nu; 0.5 for incompressible material")

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d' [N]."""
        elasticity, viscosity = theta
        elastic = 2.0 / (1.0 - self.poisson**2) * elasticity * self.indenter.profile_area(depth)
        return elastic + 4.0 / (1.0 - self.poisson) * viscosity * self.indenter.contact_radius(depth) * rate

    def delay_shift(self, theta: Sequence[float]) -> tuple[float, ...]:
        """A late force lowers viscosity by the shear modulus G = E/(2 (1 + nu)) per second, for every tip."""
        return 0.0, -theta[0] / (2.0 * (1.0 + self.poisson))
