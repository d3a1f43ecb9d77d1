"""Settings of the kinematic filter and its smoother."""

from __future__ import annotations

from abc import ABC
from typing import Literal

from palpate import Damping, Estimator, Force, ForceDrift, ForceWalk, Length, Speed, Time
from pydantic import Field

_DEFAULT_DRIFT = 1.5 / 3600.0  # [N/s], 1.5 N/h of a six-axis sensor that warms up (0044)


class KinematicSettings(Estimator, ABC):
    """Settings that the kinematic filter and its smoother share.

    Densities are those of a sweep at 4 mm/s; with `sweep_speed` v, random walks scale by v/4 mm/s and integrated ones
    by its third power. At 0 the surface and the material do not change, and slope and trend are not states.
    """

    force_std: Force = Field(default=0.05, gt=0, description="standard deviation of the force")
    position_std: Length = Field(default=5e-6, gt=0, description="standard deviation of the position")
    velocity_std: Speed = Field(default=0.67e-3, gt=0, description="standard deviation of the velocity")
    noise: Literal["given", "measure"] = Field(
        default="given",
        description='"measure": take force and velocity from the standstill before a live motion, else from free air',
    )
    sweep_speed: Speed = Field(default=0.0, ge=0, description="speed along the surface; 0 for a point")
    jerk: float = Field(default=0.5, gt=0, allow_inf_nan=False, description="density of the tip's jerk, in m^2/s^5")
    surface_walk: float = Field(
        default=1e-11, ge=0, allow_inf_nan=False, description="density of the surface's height, in m^2/s"
    )
    slope_walk: float = Field(
        default=1e-8, ge=0, allow_inf_nan=False, description="density of the surface's slope, in m^2/s^3"
    )
    stiffness_walk: float = Field(
        default=1e-5, ge=0, allow_inf_nan=False, description="density of the logarithm of the first parameter, in 1/s"
    )
    stiffness_trend: float = Field(
        default=1e-2, ge=0, allow_inf_nan=False, description="density of that logarithm's trend, in 1/s^3"
    )
    ratio_walk: float = Field(
        default=1e-3, ge=0, allow_inf_nan=False, description="density of the other parameters' logarithms, in 1/s"
    )
    bias_std: Force = Field(
        default=0.0, ge=0, description="standard deviation of a force bias to be estimated; 0: none at the tare"
    )
    drift: ForceDrift | None = Field(
        default=None,
        ge=0,
        description="standard deviation of the bias's unknown constant slope; left out: 1.5 N/h with bias_std, else 0",
    )
    drift_walk: ForceWalk = Field(default=0.0, ge=0, description="random walk of that bias")
    iterations: int = Field(
        default=1, ge=1, le=5, description="linearisations of the force in one update; 3 for an iterated filter (IEKF)"
    )
    student: float | None = Field(
        default=None, gt=1, allow_inf_nan=False, description="degrees of freedom of the force's noise; 4 for outliers"
    )
    start_from: Literal["fit", "guess"] = Field(
        default="fit",
        description='"fit": a variable-projection fit of the first start_duration of contact; with a force bias always',
    )
    start_duration: Time = Field(default=0.5, gt=0, description="length of the fit")
    start_depth: Length = Field(default=1e-3, gt=0, description="first guess of the depth, where the fit fails")
    start_force: Force = Field(default=0.1, gt=0, description="first guess of the elastic force at a depth of 1 mm")
    start_damping: Damping = Field(
        default=10.0, gt=0, description="first guess of the force per speed at a depth of 1 mm"
    )
    start_spread: float = Field(
        default=1.5, gt=0, le=10, description="standard deviation of the logarithm of a guessed parameter"
    )
    first_guess: dict[str, float | str] = Field(
        default={}, description='first guesses by parameter name, such as { elasticity = "50 kPa" }'
    )

    @property
    def declared_noise(self) -> tuple[float, float] | None:
        """See `palpate.Estimator`."""
        return (self.force_std, self.velocity_std) if self.noise == "given" else None

    @property
    def follows_changes(self) -> bool:
        """See `palpate.Estimator`."""
        return self.sweep_speed > 0

    @property
    def robust(self) -> bool:
        """See `palpate.Estimator`."""
        return self.student is not None


def fits(settings: KinematicSettings) -> bool:
    """Return True if the filter starts from a fit; with a force bias it always does, since a guess misleads it."""
    return settings.start_from == "fit" or has_bias(settings)


def has_bias(settings: KinematicSettings) -> bool:
    """Return True if a force bias is a state."""
    return max(settings.bias_std, drift_of(settings), settings.drift_walk) > 0


def drift_of(settings: KinematicSettings) -> float:
    """Return the standard deviation of the bias's slope [N/s]."""
    if settings.drift is None:
        return _DEFAULT_DRIFT if settings.bias_std > 0 else 0.0
    return settings.drift
