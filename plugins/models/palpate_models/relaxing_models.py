"""Linear materials in the frame of the method of dimensionality reduction."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from palpate import ContactModel, Floats, Indenter, MaterialValue, Parameter, select
from pydantic import Field, model_validator

from palpate_models.other_layers import other_layers
from palpate_models.parameters import (
    DASHPOT_VISCOSITY,
    FLOW_VISCOSITY,
    INSTANT_ELASTICITY,
    LASTING_ELASTICITY,
    RELAXATION_TIME,
    RELAXING_ELASTICITY,
)
from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.skin import ContactGeometry, Skin, curved_share
from palpate_models.thickness import OptionalThickness
from palpate_models.ting_unloading import ting_force

_SKIN = (
    'the skin where it is not level and flat, such as { inclination = "20 deg", skin_radius = "50 mm" }; left out: '
    "assumed to be both"
)
_REGULAR_DEPTH = 1e-3  # [m] and as a radius, a choice: any value in contact
_THICKNESS = 'correction for a layer, as for dimensionality-reduction; left out or "none": a half-space'


class RelaxingModel(ContactModel):
    """A linear material, which may relax, pressed by any axisymmetric tip; a model gives its `spectrum`.

    F = 2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d' + sum of q_k with an internal state q_k [N] for each arm,
    dq_k/dt = 2 E_k/(1 - nu^2) a(d) d' - q_k/tau_k in contact and -q_k/tau_k out of it.
    """

    indenter: Indenter = Field(description="the tip")
    poisson: float = Field(default=0.5, ge=0, le=0.5, description="Poisson's ratio nu; 0.5 for incompressible material")
    thickness: OptionalThickness = Field(default=None, description=_THICKNESS)
    skin: Skin | None = Field(default=None, description=_SKIN)

    @model_validator(mode="after")
    def _check_geometry(self) -> Self:
        ContactGeometry.of(self).check()
        return self

    @abstractmethod
    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """Return the relaxation modulus at parameter values."""

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d' + sum of q_k [N]; without `memory` long at rest."""
        law = self.spectrum(theta)
        area, radius = ContactGeometry.of(self).contact(depth)
        total = 0.0 * depth if law.lasting is None else 2.0 / (1.0 - self.poisson**2) * law.lasting * area
        if law.damper is not None:
            total = total + 4.0 / (1.0 - self.poisson) * law.damper * radius * rate
        for state in memory[: len(law.arms)]:
            total = total + state
        return total

    def memory_rate(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any]) -> tuple[Any, ...]:
        """2 E_k/(1 - nu^2) a(d) d' - q_k/tau_k [N/s]."""
        # Out of contact nothing loads an arm; a depth is substituted whose radius is regular.
        _, radius = ContactGeometry.of(self).contact(select(depth, 0.0, depth, _REGULAR_DEPTH + 0.0 * depth))
        loading = select(depth, 0.0, 2.0 / (1.0 - self.poisson**2) * radius * rate, 0.0 * depth)
        pace = self.pace(radius, theta)
        slopes = []
        for (strength, relaxation_rate), state in zip(self.spectrum(theta).arms, memory, strict=True):
            if pace is not None:
                relaxation_rate = pace * relaxation_rate
            slopes.append(strength * loading - relaxation_rate * state)
        return tuple(slopes)

    def curved_share(self, curvature: Floats, depth: Floats) -> Floats | None:
        """See `palpate_models.skin.curved_share`."""
        return curved_share(self, curvature, depth)

    def loading_cycle_force(self, time: Floats, depth: Floats, theta: Sequence[float], reversal: float) -> Floats:
        """Return the force (n,) [N] over one loading and unloading, see `ting_force`; raises ValueError for others."""
        if self.pace(_REGULAR_DEPTH, theta) is not None:
            raise ValueError(f"Ting's unloading needs a relaxation modulus, and {type(self).__name__} has none")
        return ting_force(self, self.spectrum(theta), time, depth, reversal)

    def pace(self, radius: Any, theta: Sequence[Any]) -> Any:
        """Return the factor of all rates at a contact radius [m]; None for a material without one."""
        return None

    def validity(self, depth: float) -> str:
        """Return a warning where tip, skin or thickness correction do not hold at a depth [m]; else an empty text."""
        return ContactGeometry.of(self).validity(depth)

    def other_geometries(self, depth: float, theta: Sequence[float]) -> dict[str, tuple[float, ...]]:
        """Return the values by other layers that the stated thickness admits, see `other_layers`."""
        return other_layers(self.parameters, theta, self.indenter, self.thickness, depth)


_ONE_ARM = ("relaxing_force",)


class StandardLinearSolid(RelaxingModel):
    """A material with a lasting and a fading elasticity (Zener's), pressed by any axisymmetric tip.

    F = 2 E/(1 - nu^2) A(d) + q with the internal state q [N], dq/dt = 2 E_1/(1 - nu^2) a(d) d' - q/tau in contact
    and -q/tau out of it: the hereditary integral with the relaxation modulus E + E_1 exp(-t/tau). Slow motion feels
    E and a viscosity of E_1 tau/(2 (1 + nu)), fast motion feels E + E_1.
    Assumes what `dimensionality-reduction` does, one nu for all times, and contact that follows the depth also while
    the tip retracts (no negative pressure at the rim; Ting's correction is left out).
    Source: Lee and Radok 1960; Popov and Hess 2015, chapter on viscoelastic contacts.
    """

    memory: ClassVar[tuple[str, ...]] = _ONE_ARM
    parameters: ClassVar[tuple[Parameter, ...]] = (LASTING_ELASTICITY, RELAXING_ELASTICITY, RELAXATION_TIME)

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """E + E_1 exp(-t/tau)."""
        return RelaxationSpectrum(theta[0], None, ((theta[1], 1.0 / theta[2]),))

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E, and the viscosity E_1 tau/(2 (1 + nu)) of slow motion."""
        per_modulus = 1.0 / (2.0 * (1.0 + self.poisson))
        gradient = (0.0, theta[2] * per_modulus, theta[1] * per_modulus)
        slow = "for motion that is slow against the relaxation time"
        return (
            MaterialValue("elasticity", theta[0], (1.0, 0.0, 0.0), slow),
            MaterialValue("viscosity", theta[1] * theta[2] * per_modulus, gradient, slow),
        )


class DimensionalityReductionMaxwell(RelaxingModel):
    """Spring, damper and one Maxwell arm side by side: the paper's material, and a part of it that fades.

    F = 2 E/(1 - nu^2) A(d) + 4 eta/(1 - nu) a(d) d' + q with the internal state q [N],
    dq/dt = 2 E_1/(1 - nu^2) a(d) d' - q/tau in contact and -q/tau out of it: the hereditary integral with the
    relaxation modulus E + E_1 exp(-t/tau), and a damper in parallel. E is the elasticity at rest (E_inf); fast motion
    feels E_0 = E + E_1, which is reported, too.
    Assumes what `standard-linear-solid` does. Damper and arm are distinguished by motion on both sides of 1/tau: a
    press or a step and an oscillation.
    Source: paper, eq. TotalForce; Lee and Radok 1960; Popov and Hess 2015, chapter on viscoelastic contacts.
    """

    memory: ClassVar[tuple[str, ...]] = _ONE_ARM
    parameters: ClassVar[tuple[Parameter, ...]] = (
        LASTING_ELASTICITY,
        DASHPOT_VISCOSITY,
        RELAXING_ELASTICITY,
        RELAXATION_TIME,
    )

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """E + E_1 exp(-t/tau), and the damper."""
        return RelaxationSpectrum(theta[0], theta[1], ((theta[2], 1.0 / theta[3]),))

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E and eta themselves, and E_0 = E + E_1."""
        fast = "for motion that is fast against the relaxation time"
        return (
            MaterialValue("elasticity", theta[0], (1.0, 0.0, 0.0, 0.0), "at rest"),
            MaterialValue("viscosity", theta[1], (0.0, 1.0, 0.0, 0.0)),
            MaterialValue("instant_elasticity", theta[0] + theta[2], (1.0, 0.0, 1.0, 0.0), fast),
        )


class Maxwell(RelaxingModel):
    """A material that flows (Maxwell's): elastic at once, viscous in the long run, pressed by any axisymmetric tip.

    F = q with the internal state q [N], dq/dt = 2 E/(1 - nu^2) a(d) d' - q/tau in contact and -q/tau out of it, with
    the relaxation time tau = eta/G = 2 (1 + nu) eta/E. Held at a depth, the force fades to nothing.
    Assumes what `standard-linear-solid` does.
    Source: Lee and Radok 1960; Popov and Hess 2015, chapter on viscoelastic contacts.
    """

    memory: ClassVar[tuple[str, ...]] = _ONE_ARM
    parameters: ClassVar[tuple[Parameter, ...]] = (INSTANT_ELASTICITY, FLOW_VISCOSITY)

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """E exp(-t/tau), tau = 2 (1 + nu) eta/E."""
        return RelaxationSpectrum(None, None, ((theta[0], theta[0] / (2.0 * (1.0 + self.poisson) * theta[1])),))

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """Return the parameters themselves."""
        return (MaterialValue("elasticity", theta[0], (1.0, 0.0)), MaterialValue("viscosity", theta[1], (0.0, 1.0)))
