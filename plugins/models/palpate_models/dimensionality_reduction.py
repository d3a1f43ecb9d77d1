"""The method of dimensionality reduction, elastic and viscous: the paper's contact model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from palpate import MaterialValue, Parameter
from pydantic import Field

from palpate_models.parameters import ELASTICITY, VISCOSITY
from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.relaxing_models import RelaxingModel
from palpate_models.thickness import OptionalThickness


class DimensionalityReduction(RelaxingModel):
    """A soft half-space as a row of springs and dampers, pressed by any axisymmetric tip.

    F = 2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d', with the tip's contact radius a(d) and profile area A(d).
    For a sphere this is (4/3) E/(1 - nu^2) sqrt(R) d^1.5 + 4 eta/(1 - nu) sqrt(R d) d'. With `thickness`, A becomes
    A(d) c(d) and a becomes its derivative (see the `thickness` key: dimitriadis, garcia, finite-cylinder); `skin`
    states an inclination and curvature. Assumes a homogeneous, isotropic half-space, flat but for these, small strain
    (a/R well below 1, depth below some 10 % of the thickness), no friction on a level skin and no adhesion; material of
    Kelvin-Voigt type.
    Source: paper, eqs. kv_el and TotalForce; Popov and Hess 2015.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (ELASTICITY, VISCOSITY)

    thickness: OptionalThickness = Field(
        default=None,
        description='correction for a layer, such as { law = "dimitriadis", height = "22 mm", bonded = false }; '
        'laws: dimitriadis, garcia, finite-cylinder, table; "half-space": the specimen is thick, nothing is corrected; '
        'left out or "none": the same, but not declared',
    )

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """E at all times, and the damper."""
        return RelaxationSpectrum(theta[0], theta[1], ())

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """Return the parameters themselves."""
        return (MaterialValue("elasticity", theta[0], (1.0, 0.0)), MaterialValue("viscosity", theta[1], (0.0, 1.0)))

    def delay_shift(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Return a late force lowers viscosity by the shear modulus G = E/(2 (1 + nu)) per second, for every tip."""
        return 0.0, -theta[0] / (2.0 * (1.0 + self.poisson))
