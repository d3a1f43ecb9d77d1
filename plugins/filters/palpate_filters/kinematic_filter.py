"""The kinematic filter: position, velocity and force measured, the surface and the material found."""

from __future__ import annotations

import math
from abc import ABC
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from palpate import (
    ConfigurationError,
    Damping,
    Estimator,
    Force,
    KinematicProcess,
    Length,
    Problem,
    Samples,
    Speed,
    Time,
    Tracker,
)
from pydantic import Field

from palpate_filters.first_guess import first_guess
from palpate_filters.inertial_filter import mass_of
from palpate_filters.kinematic_step import kinematic_step
from palpate_filters.opening_fit import fit_start, fittable
from palpate_filters.tracking import Carry, Opening, Recursion, RecursiveTracker

Floats = NDArray[np.float64]

_REFERENCE_SPEED = 4e-3  # [m/s], the sweep for which the densities are given
_FIT_SPREAD = (
    10.0  # the filter sees the fitted samples again, so it takes only a hundredth of their weight from the fit
)
_ACCELERATION_STD = 1.0  # [m/s^2]
_STEEPEST = 0.05  # first standard deviation of a surface's slope
_TREND_STD = 0.05  # [1/s]


class KinematicSettings(Estimator, ABC):
    """Settings that the kinematic filter and its smoother share.

    Densities are those of a sweep at 4 mm/s; with `sweep_speed` v, random walks scale by v/4 mm/s and integrated ones
    by its third power. At 0 the surface and the material do not change, and slope and trend are no states.
    """

    force_std: Force = Field(default=0.05, gt=0, description="standard deviation of the force")
    position_std: Length = Field(default=5e-6, gt=0, description="standard deviation of the position")
    velocity_std: Speed = Field(default=0.67e-3, gt=0, description="standard deviation of the velocity")
    noise: Literal["given", "measure"] = Field(
        default="given",
        description='"measure": take force and velocity from the rest before a live motion, else from free air',
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
        default=0.0, ge=0, description="standard deviation of a constant force bias that is to be found; 0: none"
    )
    bias_walk: float = Field(default=0.0, ge=0, allow_inf_nan=False, description="density of that bias, in N^2/s")
    iterations: int = Field(
        default=1, ge=1, le=5, description="linearisations of the force in one update; 3 for an iterated filter (IEKF)"
    )
    student: float | None = Field(
        default=None, gt=1, allow_inf_nan=False, description="degrees of freedom of the force's noise; 4 for outliers"
    )
    start_from: Literal["fit", "guess"] = Field(
        default="fit", description='"fit": a variable-projection fit of the first start_duration of contact'
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


class KinematicFilter(KinematicSettings):
    """The kinematic filter: states the tip's motion, the surface, and the material's parameters as logarithms.

    Process: `palpate.KinematicProcess`. All that is measured is treated as measured: position, velocity and force. So
    the noise of the force does not drive the state, which is what biases viscosity in the paper's filter.
    Source: Kalman filtering of kinematics with white jerk (Bar-Shalom, Li and Kirubarajan 2001, section 6.2).
    """

    def start(self, problem: Problem) -> Tracker:
        """A tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        return RecursiveTracker(kinematic_recursion(self, problem), opening(self, problem))


class IteratedKinematicFilter(KinematicSettings):
    """The kinematic filter with its force linearised anew at each iterate (iterated extended Kalman filter).

    For strongly curved forces and poor starts; from a fit it brings nothing. Source: Bell and Cathey 1993.
    """

    iterations: int = Field(default=3, ge=1, le=5, description="linearisations of the force in one update")

    def start(self, problem: Problem) -> Tracker:
        """A tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        return RecursiveTracker(kinematic_recursion(self, problem), opening(self, problem))


def opening(settings: KinematicSettings, problem: Problem) -> Opening:
    """How the filter gets under way."""
    window = settings.start_duration if settings.start_from == "fit" else 0.0
    return Opening(window, settings.noise == "measure", problem.rest)


def kinematic_recursion(settings: KinematicSettings, problem: Problem, *, with_state: bool = False) -> Recursion:
    """The filter as its tracker needs it."""
    mass_of(problem)
    process = kinematic_process(settings, problem)
    guess = _guess(settings, process)
    count = len(problem.model.parameters)

    def numbers(force_std: float | None, velocity_std: float | None) -> Floats:
        start = [settings.start_depth, *process.on_chart(guess.tolist(), math.log)]
        std = [2.0 * settings.start_depth, *([settings.start_spread] * count)]
        return np.array([*noises(settings, force_std, velocity_std), *start, *std])

    def begin(carry: Carry, first: Samples, patient: bool) -> tuple[Floats, bool] | None:
        if carry.state is not None:
            return _resume(process, carry, first)
        return _fresh(settings, process, guess, first, patient)

    step = kinematic_step(process, iterations=settings.iterations, student=settings.student, with_state=with_state)
    return Recursion(step, count, numbers, begin, _inputs)


def kinematic_process(settings: KinematicSettings, problem: Problem) -> KinematicProcess:
    """The process that the settings ask for."""
    return KinematicProcess(problem.model, problem.tip_mass, settings.sweep_speed > 0, settings.bias_std > 0)


def noises(settings: KinematicSettings, force_std: float | None, velocity_std: float | None) -> list[float]:
    """The noises of `palpate_filters.kinematic_step`, in their order."""
    pace = settings.sweep_speed / _REFERENCE_SPEED
    walks = [settings.surface_walk * pace, settings.slope_walk * pace**3]
    walks += [settings.stiffness_walk * pace, settings.stiffness_trend * pace**3, settings.ratio_walk * pace]
    measured = [force_std or settings.force_std, settings.position_std, velocity_std or settings.velocity_std]
    return [*measured, settings.jerk, *walks, settings.bias_walk]


def _inputs(samples: Samples, interval: Floats) -> Floats:
    return np.column_stack([samples.force, samples.position, samples.velocity, interval])


def _guess(settings: KinematicSettings, process: KinematicProcess) -> Floats:
    forces = {"elastic": (settings.start_force, 1.0), "viscous": (settings.start_damping, 1.0)}
    given: dict[str, Any] = dict(settings.first_guess)
    guess, _ = first_guess(process.model, forces, given, {})
    for parameter, value in zip(process.model.parameters, guess, strict=True):
        if parameter.lower >= 0 and value <= 0:
            raise ConfigurationError(f"first guess of {parameter.name}: must be above 0")
    return guess


def _fresh(
    settings: KinematicSettings, process: KinematicProcess, guess: Floats, window: Samples, patient: bool
) -> tuple[Floats, bool] | None:
    """State from a fit of the window where one is wanted and succeeds, else, once not patient, from the first guess."""
    n, chart = process.states, process.chart
    mean, std = np.zeros(n), np.zeros(n)
    std[3], std[chart] = 2.0 * settings.start_depth, settings.start_spread
    mean[3], theta = window.position[0] + settings.start_depth, guess
    found = fit_start(process.model, process.mass, window, guess) if settings.start_from == "fit" else None
    if found is None and patient and settings.start_from == "fit" and fittable(process.model):
        return None
    if found is not None:
        mean[3], theta = found.surface, found.theta
        std[3] = min(_FIT_SPREAD * found.surface_std, std[3])
        known = found.theta_std > 0
        relative = _FIT_SPREAD * np.where(known, found.theta_std, 0.0) / np.abs(theta)
        std[chart] = np.where(known, np.clip(relative, 1e-3, settings.start_spread), settings.start_spread)
    mean[chart] = process.on_chart(theta.tolist(), math.log)
    std[process.memory] = 1.0
    if process.sweeping:
        std[4], std[-1] = _STEEPEST * settings.sweep_speed, _TREND_STD
    if process.biased:
        std[process.bias] = settings.bias_std
    _place(settings.position_std, settings.velocity_std, mean, std, window)
    return np.concatenate([mean, np.diag(std**2).ravel(), [0.0]]), False


def _place(position_std: float, velocity_std: float, mean: Floats, std: Floats, first: Samples) -> None:
    """Put the tip where the first sample says it is."""
    moving = float(first.velocity[0])
    mean[:3] = first.position[0], moving if np.isfinite(moving) else 0.0, 0.0
    std[:3] = position_std, velocity_std if np.isfinite(moving) else 0.1, _ACCELERATION_STD


def _resume(process: KinematicProcess, carry: Carry, first: Samples) -> tuple[Floats, bool]:
    """State after a pause: motion anew, surface and material as they were."""
    assert carry.state is not None
    n = process.states
    mean, std = carry.state[:n].copy(), np.zeros(n)
    before = carry.state[n : n + n * n].reshape(n, n)
    _place(5e-6, 1e-3, mean, std, first)
    covariance = np.zeros((n, n))
    covariance[3:, 3:] = before[3:, 3:]
    covariance[:3, :3] = np.diag(std[:3] ** 2)
    return np.concatenate([mean, covariance.ravel(), [0.0]]), True
