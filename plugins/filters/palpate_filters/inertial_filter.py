"""Settings that the filters on the inertial process share, and the tracker that follows from them."""

from __future__ import annotations

import math
from abc import ABC
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from palpate import (
    ConfigurationError,
    Damping,
    Estimator,
    Floats,
    Force,
    Length,
    Problem,
    Samples,
    Speed,
    Time,
    Tracker,
)
from pydantic import Field

from palpate_filters.adaptive_fading import AdaptiveFading
from palpate_filters.filter_tracker import RecursiveTracker
from palpate_filters.first_guess import first_guess
from palpate_filters.inertial_step import Prediction, inertial_step, state_layout
from palpate_filters.process_models import InertialProcess
from palpate_filters.recursion import Carry, FilterStart, Recursion
from palpate_filters.starting_fit import fit_start, fittable
from palpate_filters.step_limits import FIT_SPREAD, MISSING_ABOVE, RESUME_STD

# [s/m], relative scatter of E over the scatter of the rate of a skin that rises under the tip, of a filter whose
# parameters have derivatives. Measured: no false lump in 56 simulated sweeps over 0.05 to 0.3 mm of roughness at
# 2 to 6 mm/s.
_RELIEF_SENSITIVITY = 120.0
_NO_FADING = (math.inf, 1.0, 0.0, 0.0)  # theta, alpha_max, step up, step down


class PaperStart(Estimator, ABC):
    """Settings of noise and start on the inertial process.

    Defaults are the paper's: x0 = [1 mm, v0, 0.1 N/mm^1.5, 0.01 N s/mm^1.5], P0 = diag(5, 1, 1, 1), read as the force
    and the damping of the material at a depth of 1 mm so that they apply to every tip and model.
    """

    motion: ClassVar[Literal["position", "velocity", "both"]] = "velocity"
    force_std: Force = Field(default=0.05, gt=0, description="standard deviation sigma_u of the force")
    velocity_std: Speed = Field(default=0.67e-3, gt=0, description="standard deviation sigma_vel of the velocity")
    start_depth: Length = Field(default=1e-3, gt=0, description="first guess of the depth")
    start_depth_std: Length = Field(default=math.sqrt(5) * 1e-3, gt=0, description="its standard deviation")
    start_rate_std: Speed = Field(
        default=1e-3, gt=0, description="standard deviation of the first rate, which is measured"
    )
    start_force: Force = Field(default=0.1, gt=0, description="first guess of the elastic force at a depth of 1 mm")
    start_force_std: Force = Field(default=1.0, gt=0, description="its standard deviation")
    start_damping: Damping = Field(
        default=10.0, gt=0, description="first guess of the force per speed at a depth of 1 mm"
    )
    start_damping_std: Damping = Field(default=1000.0, gt=0, description="its standard deviation")
    first_guess: dict[str, float | str] = Field(
        default={}, description='first guesses by parameter name, such as { elasticity = "50 kPa" }'
    )
    first_guess_std: dict[str, float | str] = Field(
        default={}, description="their standard deviations, by parameter name"
    )


class InertialFilter(PaperStart, ABC):
    """Settings that every compiled filter on the inertial process has."""

    noise: Literal["given", "measure"] = Field(
        default="given", description='"measure": take both from the standstill before a live motion, else from free air'
    )
    start_from: Literal["guess", "fit"] = Field(
        default="guess", description='"fit": a variable-projection fit of the first start_duration of contact'
    )
    start_duration: Time = Field(default=0.5, gt=0, description="length of the fit; nothing is estimated before")
    order: int = Field(
        default=0, ge=0, le=4, description="evolution order: number of time derivatives of the parameters as states"
    )
    evolution_time: Time = Field(
        default=1.0, gt=0, description="first std of a k-th derivative: that of the parameter over this to the power k"
    )
    derivative_std: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="first std of a derivative, per s^k and as a multiple of the parameter's; replaces evolution_time",
    )

    @property
    def declared_noise(self) -> tuple[float, float] | None:
        """See `palpate.Estimator`."""
        return (self.force_std, self.velocity_std) if self.noise == "given" else None


@dataclass(frozen=True)
class Start:
    """The first state of a filter: mean and standard deviation."""

    mean: Floats
    std: Floats


def mass_of(problem: Problem) -> float:
    """Return the tip's mass [kg], which may be 0; raises ConfigurationError where none is declared."""
    if problem.tip_mass is None:
        raise ConfigurationError(
            'the tip\'s mass is not declared; this filter needs it: set [alignment] tip_mass, such as "140 g"'
        )
    return problem.tip_mass


def moved_mass(problem: Problem) -> float:
    """Return the mass [kg] that the force accelerates; raises ConfigurationError where none is declared, or it is 0."""
    mass = mass_of(problem)
    if mass == 0:
        raise ConfigurationError(
            "the tip's mass is 0, and this filter lets the force accelerate it: take an estimator that measures the "
            "motion, such as kinematic-ekf or casadi-fit"
        )
    return mass


def inertial_tracker(
    settings: InertialFilter, problem: Problem, prediction: Prediction, fading: AdaptiveFading | None = None
) -> Tracker:
    """Return a tracker of a filter on the inertial process, with adaptive fading where it is given.

    `prediction` is the extended or the unscented Kalman filter's; `problem` has the model and the tip's mass.
    Raises ConfigurationError where no tip mass is declared or a first guess cannot be made.
    """
    process = InertialProcess(problem.model, moved_mass(problem), settings.order)
    start = first_state(settings, process, problem, settings.evolution_time, settings.derivative_std)
    fading_settings = _fading_settings(fading, start)

    def step_settings(force_std: float | None, velocity_std: float | None) -> Floats:
        """Return the settings of the step, with the noises that were measured in place of the stated ones."""
        noise = (force_std or settings.force_std, velocity_std or settings.velocity_std)
        return np.array([*noise, *fading_settings, *start.mean, *start.std])

    def begin(carry: Carry, first: Samples, patient: bool) -> tuple[Floats, bool] | None:
        """Return the state of a stretch, and whether it resumes the last one; see `Recursion.begin`."""
        needs_fit = settings.start_from == "fit" and carry.state is None
        fitted = _fit_first_state(process, start, first) if needs_fit else start
        if fitted is None and patient and fittable(process.model):
            return None
        return _stretch_state(process, fitted or start, carry, first)

    recursion = Recursion(
        step=inertial_step(process, prediction, fading=fading is not None, signed=fading is not None and fading.signed),
        parameters=len(problem.model.parameters),
        settings=step_settings,
        begin=begin,
        inputs=_step_inputs,
    )
    # The window of a fit, the noise at standstill, and what the report has of a filter with fading.
    window = settings.start_duration if settings.start_from == "fit" else 0.0
    filter_start = FilterStart(window, settings.noise == "measure", problem.standstill)
    details = {"relief_sensitivity": _RELIEF_SENSITIVITY} if fading is not None and settings.order else {}
    return RecursiveTracker(recursion, filter_start, details=details)


def _fading_settings(fading: AdaptiveFading | None, start: Start) -> list[float]:
    """Return theta, largest alpha, its steps up and down, then the largest variance of each state; none without it."""
    if fading is None:
        return [*_NO_FADING, *np.full(len(start.std), MISSING_ABOVE)]
    largest_variance = (fading.covariance_cap * start.std) ** 2
    return [fading.theta, fading.alpha_max, fading.step_up, fading.step_down, *largest_variance]


def _step_inputs(samples: Samples, interval: Floats) -> Floats:
    """Return force [N], rate of the depth [m/s] and interval [s] (n, 3) of samples."""
    rows = np.empty((len(interval), 3))
    rows[:, 0] = samples.force
    rows[:, 1] = -samples.velocity
    rows[:, 2] = interval
    return rows


def first_state(
    settings: PaperStart,
    process: InertialProcess,
    problem: Problem,
    evolution_time: float = 1.0,
    derivative_std: float | None = None,
) -> Start:
    """Return the state by the first guess; raises ConfigurationError where the guess gives none.

    Its order is depth, rate, the model's internal states, parameters, then their derivatives order by order. The k-th
    derivative of a parameter has that parameter's deviation times `derivative_std`, else over `evolution_time`^k [s].
    """
    model = process.model
    forces = {
        "elastic": (settings.start_force, settings.start_force_std),
        "viscous": (settings.start_damping, settings.start_damping_std),
    }
    theta, theta_std = first_guess(model, forces, settings.first_guess, settings.first_guess_std, problem.others)
    derivative_stds = []
    for k in range(1, process.order + 1):
        derivative_stds.append(theta_std * derivative_std if derivative_std else theta_std / evolution_time**k)
    memory, derivatives = np.zeros(len(model.memory)), np.zeros(process.order * len(theta))
    # The rate is 0 until it is measured; internal states have a deviation of 1 in their own units.
    mean = np.concatenate([[settings.start_depth, 0.0], memory, theta, derivatives])
    depth_and_rate = [settings.start_depth_std, settings.start_rate_std]
    std = np.concatenate([depth_and_rate, memory + 1.0, theta_std, *derivative_stds])
    return Start(mean, std)


def _fit_first_state(process: InertialProcess, start: Start, window: Samples) -> Start | None:
    """Return a start from the window's fit; None where the fit does not find the parameters."""
    values, depth = process.parameters, process.layout.at("depth")
    fit = fit_start(process.model, process.mass, window, start.mean[values])
    if fit is None:
        return None
    mean, std = start.mean.copy(), start.std.copy()
    mean[depth] = fit.surface - window.position[0]
    std[depth] = min(FIT_SPREAD * fit.surface_std, std[depth])
    mean[values] = fit.theta
    std[values] = np.where(fit.theta_std > 0, np.minimum(FIT_SPREAD * fit.theta_std, std[values]), std[values])
    return Start(mean, std)


def _stretch_state(process: InertialProcess, start: Start, carry: Carry, first: Samples) -> tuple[Floats, bool]:
    """Return the state from which a stretch of contact begins, and whether it resumes the last estimate.

    It is resumed where the first position is below the last surface: the depth is then that below this surface, and the
    material stays. Else the mean and deviations of `start` apply. The order is that of `state_layout`. `carry` has the
    state after the last sample and the surface's height [m] then, `first` the samples that begin the stretch.
    """
    layout, carried = process.layout, state_layout(process)
    # The material's rows are internal states, parameters and their derivatives.
    depth_row, material = layout.at("depth"), layout.span("memory", "derivatives")
    rate, depth = -float(first.velocity[0]), carry.surface - float(first.position[0])
    resumed = carry.state is not None and depth > 0
    mean, covariance = start.mean.copy(), np.diag(start.std**2)
    if resumed:
        assert carry.state is not None
        mean[material] = carry.state[carried["mean"]][material]
        before = carry.state[carried["covariance"]].reshape(covariance.shape)
        covariance[material, material] = before[material, material]
        mean[depth_row] = depth
        covariance[depth_row, depth_row] = before[depth_row, depth_row] + RESUME_STD**2
    mean[layout.at("rate")] = rate if np.isfinite(rate) else 0.0
    force, low_count, factor = 0.0, 0.0, 1.0
    return np.concatenate([mean, covariance.ravel(), [force, low_count, factor]]), resumed
