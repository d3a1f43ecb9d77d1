"""The kinematic filter: position, velocity and force are measured, surface and material estimated."""

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
_WINDOWS_WITH_BIAS = 2.0  # start_durations, a choice: the force's curvature alone separates surface, stiffness and bias


class KinematicFilter(KinematicSettings):
    """The kinematic filter: states the tip's motion, the surface, and the material's parameters as logarithms.

    Process: `palpate.KinematicProcess`. All that is measured is treated as measured: position, velocity and force. So
    the noise of the force does not drive the state, which is what biases viscosity in the paper's filter.
    Source: Kalman filtering of kinematics with white jerk (Bar-Shalom, Li and Kirubarajan 2001, section 6.2).
    """

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        return RecursiveTracker(kinematic_recursion(self, problem), filter_start(self, problem), details=causes(self))


def causes(settings: KinematicSettings) -> dict[str, list[str]]:
    """Return the causes that the filter's standard deviation includes: the tare, where its offset is a state."""
    return {"included": ["tare"]} if has_bias(settings) else {}


def filter_start(settings: KinematicSettings, problem: Problem) -> FilterStart:
    """Return the window of the filter's start, and the source of its noise."""
    window = 0.0
    if fits(settings):
        window = settings.start_duration * (_WINDOWS_WITH_BIAS if has_bias(settings) else 1.0)
    return FilterStart(window, settings.noise == "measure", problem.standstill)


def kinematic_recursion(
    settings: KinematicSettings,
    problem: Problem,
    *,
    with_state: bool = False,
    known: Callable[[Samples], Floats] | None = None,
) -> Recursion:
    """Return the filter as its tracker needs it: its step, its settings, its start and its inputs.

    `problem` has the model and the tip's mass. With `known`, a function that gives states (m, n) at m samples, the
    force is linearised at these states instead of the filter's own. `with_state` adds mean and covariance to the
    outputs.
    """
    mass_of(problem)
    process = kinematic_process(settings, problem)
    guess = guess_of(settings, process, problem)
    count = len(problem.model.parameters)

    def step_settings(force_std: float | None, velocity_std: float | None) -> Floats:
        """Return the settings of the step, with the noises that were measured in place of the stated ones."""
        # The last groups are for a restart: first depth and chart, and their standard deviations. That of the depth is
        # twice its guess, a choice: it includes a tip that is not in contact yet.
        start = [settings.start_depth, *process.on_chart(guess.tolist(), math.log)]
        std = [2.0 * settings.start_depth, *([settings.start_spread] * count)]
        return np.array([*noises(settings, force_std, velocity_std), *start, *std])

    def begin(carry: Carry, first: Samples, patient: bool) -> tuple[Floats, bool] | None:
        """Return the state of a stretch, and whether it resumes the last one; see `Recursion.begin`."""
        if carry.state is not None:
            return resumed_state(process, carry, first)
        return fresh_state(settings, process, guess, first, patient)

    # At a given state the force is linearised once.
    iterations = settings.iterations if known is None else 1
    step = kinematic_step(
        process, iterations=iterations, student=settings.student, with_state=with_state, linearised=known is not None
    )
    if known is None:
        return Recursion(step=step, parameters=count, settings=step_settings, begin=begin, inputs=_step_inputs)
    return Recursion(
        step=step,
        parameters=count,
        settings=step_settings,
        begin=begin,
        inputs=lambda part, time: np.hstack([_step_inputs(part, time), known(part)]),
    )


def kinematic_process(settings: KinematicSettings, problem: Problem) -> KinematicProcess:
    """Return the process with the states that the settings require."""
    biased = has_bias(settings)
    sweeping, drifting = settings.sweep_speed > 0, drift_of(settings) > 0
    return KinematicProcess(problem.model, problem.tip_mass, sweeping, biased, drifting)


def noises(settings: KinematicSettings, force_std: float | None, velocity_std: float | None) -> list[float]:
    """Return the noises of `palpate_filters.kinematic_step`, in their order.

    The densities are those at the reference speed: those of random walks grow with the speed, those of integrated ones
    with its third power, so that each distance has the same change at any speed.
    """
    pace = settings.sweep_speed / _REFERENCE_SPEED
    walks = [settings.surface_walk * pace, settings.slope_walk * pace**3]
    walks += [settings.stiffness_walk * pace, settings.stiffness_trend * pace**3, settings.ratio_walk * pace]
    measured = [force_std or settings.force_std, settings.position_std, velocity_std or settings.velocity_std]
    return [*measured, settings.jerk, *walks, settings.drift_walk**2]


def _step_inputs(samples: Samples, interval: Floats) -> Floats:
    """Return force [N], height [m], velocity [m/s] and interval [s] (n, 4) of samples."""
    rows = np.empty((len(interval), 4))
    rows[:, 0] = samples.force
    rows[:, 1] = samples.position
    rows[:, 2] = samples.velocity
    rows[:, 3] = interval
    return rows
