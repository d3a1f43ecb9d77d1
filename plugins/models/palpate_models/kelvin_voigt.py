"""Kelvin and Voigt's linear spring and damper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from palpate import ContactModel, Indenter, MaterialValue, Parameter
from pydantic import Field

from palpate_models.indenters.power_profiles import Flat
from palpate_models.parameters import DAMPING, STIFFNESS


class KelvinVoigt(ContactModel):
    """A linear spring in parallel with a linear damper, whatever the tip: F = K d + B d'.

    K [N/m] and B [N s/m] belong to tip, depth and material together. Under a flat tip of radius R they are
    K = 2 R E/(1 - nu^2) and B = 4 R eta/(1 - nu), and only then E and eta are derived from them, where `indenter`
    names the tip; under any other tip the contact grows with depth and no E follows.
    Source: paper, eq. of the Kelvin-Voigt model; Boussinesq 1885 for the flat tip.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (STIFFNESS, DAMPING)

    indenter: Indenter | None = Field(default=None, description="the tip; with a flat one, E and eta are derived")
    poisson: float = Field(default=0.5, ge=0, le=0.5, description="Poisson's ratio nu, for E and eta")

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """K d + B d' [N]."""
        return theta[0] * depth + theta[1] * rate

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E = K (1 - nu^2)/(2 R) and eta = B (1 - nu)/(4 R) under a flat tip."""
        if not isinstance(self.indenter, Flat):
            return ()
        elastic = (1.0 - self.poisson**2) / (2.0 * self.indenter.radius)
        viscous = (1.0 - self.poisson) / (4.0 * self.indenter.radius)
        caveat = "from a linear spring and damper, which a half-space is under a flat tip only"
        return (
            MaterialValue("elasticity", theta[0] * elastic, (elastic, 0.0), caveat),
            MaterialValue("viscosity", theta[1] * viscous, (0.0, viscous), caveat),
        )

    def delay_shift(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Return a late force lowers damping by K per second."""
        return 0.0, -theta[0]
