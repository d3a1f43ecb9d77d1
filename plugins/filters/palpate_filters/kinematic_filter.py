"""The kinematic filter: position, velocity and force measured, the surface and the material found."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from palpate import Floats, Problem, Samples, Tracker

from palpate_filters.filter_tracker import RecursiveTracker
from palpate_filters.inertial_filter import mass_of
from palpate_filters.kinematic_settings import KinematicSettings, drift_of, fits, has_bias
from palpate_filters.kinematic_start import fresh_state, guess_of, resumed_state
from palpate_filters.kinematic_step import kinematic_step
from palpate_filters.process_models import KinematicProcess
from palpate_filters.recursion import Carry, FilterStart, Recursion

_REFERENCE_SPEED = 4e-3  # [m/s], the sweep for which the densities are given
_LONGER = 2.0  # start_durations: surface, stiffness and bias are separated by the force's curvature alone


class KinematicFilter(KinematicSettings):
    """The kinematic filter: states the tip's motion, the surface, and the material's parameters as logarithms.

    Process: `palpate.KinematicProcess`. All that is measured is treated as measured: position, velocity and force. So
    the noise of the force does not drive the state, which is what biases viscosity in the paper's filter.
    Source: Kalman filtering of kinematics with white jerk (Bar-Shalom, Li and Kirubarajan 2001, section 6.2).
    """

    def start(self, problem: Problem) -> Tracker:
        """A tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        return RecursiveTracker(kinematic_recursion(self, problem), filter_start(self, problem), details=causes(self))


def causes(settings: KinematicSettings) -> dict[str, list[str]]:
    """What the filter's own standard deviation contains already: the tare, where its offset is a state."""
    return {"included": ["tare"]} if has_bias(settings) else {}


def filter_start(settings: KinematicSettings, problem: Problem) -> FilterStart:
    """How the filter gets under way."""
    window = settings.start_duration * (_LONGER if has_bias(settings) else 1.0) if fits(settings) else 0.0
    return FilterStart(window, settings.noise == "measure", problem.standstill)


def kinematic_recursion(
    settings: KinematicSettings,
    problem: Problem,
    *,
    with_state: bool = False,
    known: Callable[[Samples], Floats] | None = None,
) -> Recursion:
    """The filter as its tracker needs it, linearised at states (m, n) that are `known` of samples, where given."""
    mass_of(problem)
    process = kinematic_process(settings, problem)
    guess = guess_of(settings, process, problem)
    count = len(problem.model.parameters)

    def numbers(force_std: float | None, velocity_std: float | None) -> Floats:
        start = [settings.start_depth, *process.on_chart(guess.tolist(), math.log)]
        std = [2.0 * settings.start_depth, *([settings.start_spread] * count)]
        return np.array([*noises(settings, force_std, velocity_std), *start, *std])

    def begin(carry: Carry, first: Samples, patient: bool) -> tuple[Floats, bool] | None:
        if carry.state is not None:
            return resumed_state(process, carry, first)
        return fresh_state(settings, process, guess, first, patient)

    iterations = settings.iterations if known is None else 1
    step = kinematic_step(
        process, iterations=iterations, student=settings.student, with_state=with_state, linearised=known is not None
    )
    if known is None:
        return Recursion(step, count, numbers, begin, _inputs)
    return Recursion(step, count, numbers, begin, lambda part, time: np.hstack([_inputs(part, time), known(part)]))


def kinematic_process(settings: KinematicSettings, problem: Problem) -> KinematicProcess:
    """The process that the settings ask for."""
    biased = has_bias(settings)
    sweeping, drifting = settings.sweep_speed > 0, drift_of(settings) > 0
    return KinematicProcess(problem.model, problem.tip_mass, sweeping, biased, drifting)


def noises(settings: KinematicSettings, force_std: float | None, velocity_std: float | None) -> list[float]:
    """The noises of `palpate_filters.kinematic_step`, in their order."""
    pace = settings.sweep_speed / _REFERENCE_SPEED
    walks = [settings.surface_walk * pace, settings.slope_walk * pace**3]
    walks += [settings.stiffness_walk * pace, settings.stiffness_trend * pace**3, settings.ratio_walk * pace]
    measured = [force_std or settings.force_std, settings.position_std, velocity_std or settings.velocity_std]
    return [*measured, settings.jerk, *walks, settings.drift_walk**2]


def _inputs(samples: Samples, interval: Floats) -> Floats:
    rows = np.empty((len(interval), 4))
    rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] = samples.force, samples.position, samples.velocity, interval
    return rows
