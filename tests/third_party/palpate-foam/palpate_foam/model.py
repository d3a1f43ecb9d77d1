"""A foam that is the stiffer the deeper it is pressed."""

from collections.abc import Sequence
from typing import Any

from palpate import ContactModel, Indenter, Length, MaterialValue, Parameter
from pydantic import Field


class StiffFoam(ContactModel):
    """F = 8/3 E A(d) (1 + d/h) + 8 eta a(d) d': an incompressible half-space that stiffens with depth."""

    parameters = (
        Parameter("elasticity", "E", "Pa", "modulus at small depths", role="elastic", start=1e5),
        Parameter("viscosity", "eta", "Pa*s", "shear viscosity", role="viscous", start=300.0),
    )
    indenter: Indenter = Field(description="the tip")
    stiffening: Length = Field(default=0.05, gt=0, description="h, at which the elastic force has doubled")

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """Force [N] at a depth [m] and its rate [m/s]."""
        elasticity, viscosity = theta
        elastic = 8 / 3 * elasticity * self.indenter.profile_area(depth) * (1 + depth / self.stiffening)
        return elastic + 8 * viscosity * self.indenter.contact_radius(depth) * rate

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """The parameters themselves."""
        return (MaterialValue("elasticity", theta[0], (1.0, 0.0)), MaterialValue("viscosity", theta[1], (0.0, 1.0)))
