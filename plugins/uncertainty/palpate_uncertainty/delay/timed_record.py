"""A record on which a delay is looked for, and how it answers to the numbers of a law of the material."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, TrackEvidence
from palpate_kit.numerics.local_cubic import cubic_weights, local_cubic
from palpate_kit.numerics.normal_equations import linear_regression

from palpate_uncertainty.refit import Course, make_course

# They apply to a delay that nobody has stated, in a motion of several lines and over 1000 samples.
LATEST = 0.03  # [s] of a delay that is looked for (choice); as much is left out at each end of a run
_WINDOWS = (5, 7, 9, 11, 15, 19, 25, 31, 41)  # samples of the local cubic for rate and acceleration (choice)
# The shortest window that leaves no more noise than this does not bend fast motions.
_MAX_NOISE_SHARE = 0.02  # of the RMS rate, that noise may be (choice)
# Choices: steps of the central differences, far above rounding, far below the curvature of the force.
SURFACE_STEP = 1e-6  # [m], step of the surface for its slope (choice)
_DELAY_STEP = 1e-4  # [s], step of the delay for its slope (choice)
_NONLINEAR_STEP = 1e-3  # of exponents and logarithms of times
_THIRD_DIFFERENCE_POWER = 20.0  # variance of third differences of white noise of variance 1: 1 + 9 + 9 + 1

# Forces (n, c) [N] of units along a motion, by the surface [m] and the nonlinear parameters of a law.
Columns = Callable[[Course, float, Floats], Floats]


@dataclass(frozen=True)
class ResponseLaw:
    """The force of a material: a weighted sum of columns, which depend on parameters in which it is not linear."""

    name: str
    columns: Columns
    start: tuple[float, ...] = ()  # nonlinear parameters at which a fit begins
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()


@dataclass(frozen=True)
class TimedRecord:
    """The samples of a track, its motion without most of its noise."""

    course: Course  # with an acceleration of the same window as the rate
    surface: float  # [m]
    force: Floats  # (n,) [N] as it was read
    mass: float  # [kg]
    inertia: Floats  # (n,) [N] as late as the force, as far as that is known
    rows: NDArray[np.int64]  # that are fitted
    step: float  # [s]

    @classmethod
    def of(cls, track: TrackEvidence) -> TimedRecord:
        """Return the record of a track: its samples in contact, whose motion is smoothed over the same window."""
        course = make_course(track, track.kept.used)
        step = float(np.median(np.diff(course.time)))
        rate, acceleration, width = _smooth_motion(track, course, step)
        # Samples whose motion is smoothed and delayed within one run.
        margin = max(round(LATEST / step), width)
        is_inside = np.zeros(len(course.time), bool)
        is_inside[margin:-margin] = course.runs[2 * margin :] == course.runs[: -2 * margin]
        rows = np.flatnonzero(is_inside & course.used & np.isfinite(track.kept.force))
        mass = track.tip_mass or 0.0
        motion = replace(course, height=track.kept.position, rate=rate, acceleration=acceleration)
        return cls(
            course=motion,
            surface=track.surface,
            force=track.kept.force,
            mass=mass,
            inertia=mass * motion.acceleration,
            rows=rows,
            step=step,
        )

    def late(self, delay: float) -> Course:
        """Return the motion `delay` [s] ago, as a Taylor series in its own derivatives.

        The viscous force has the noise of the same derivatives, which therefore does not look like a delay (0153).
        """
        course = self.course
        velocity_change = delay * course.acceleration
        height = course.height + delay * (course.rate - 0.5 * velocity_change)
        return replace(course, height=height, rate=course.rate - velocity_change)

    def with_inertia(self, delay: float) -> TimedRecord:
        """Return the record with an inertia that is `delay` [s] late, as the force is."""
        time, acceleration = self.course.time, self.course.acceleration
        return replace(self, inertia=self.mass * np.interp(time - delay, time, acceleration))

    def solved(self, law: ResponseLaw, surface: float, delay: float, nonlinear: Floats) -> tuple[Floats, Floats]:
        """Return the weights (c,) of a law's columns by least squares, and the residual (r,) [N]."""
        columns = law.columns(self.late(delay), surface, nonlinear)[self.rows]
        regression = linear_regression(columns, (self.force - self.inertia)[self.rows])
        return regression.weights, regression.residual

    def slopes(
        self, law: ResponseLaw, surface: float, delay: float, nonlinear: Floats, weights: Floats
    ) -> tuple[float, Floats]:
        """Return the standard deviation [N] of the residual and the force's slopes (r, c + 2 + m).

        The columns are those of the c weights, the surface [m], the delay [s] and the m nonlinear parameters.
        """

        def force(surface: float, delay: float, nonlinear: Floats) -> Floats:
            return np.asarray((law.columns(self.late(delay), surface, nonlinear) @ weights)[self.rows])

        def slope(surface_step: float, delay_step: float, nonlinear_step: Floats, width: float) -> Floats:
            """Return the central difference of the force, of `width` from one side to the other."""
            above = force(surface + surface_step, delay + delay_step, nonlinear + nonlinear_step)
            below = force(surface - surface_step, delay - delay_step, nonlinear - nonlinear_step)
            return (above - below) / width

        # The force is linear in the weights; all other slopes are by differences.
        no_step = np.zeros(len(nonlinear))
        columns = list(law.columns(self.late(delay), surface, nonlinear)[self.rows].T)
        columns.append(slope(SURFACE_STEP, 0.0, no_step, 2 * SURFACE_STEP))
        columns.append(slope(0.0, _DELAY_STEP, no_step, 2 * _DELAY_STEP))
        for i in range(len(nonlinear)):
            step = no_step.copy()
            step[i] = _NONLINEAR_STEP
            columns.append(slope(0.0, 0.0, step, 2 * _NONLINEAR_STEP))
        residual = (self.force - self.inertia)[self.rows] - force(surface, delay, nonlinear)
        return float(np.std(residual)), np.column_stack(columns)


def _smooth_motion(track: TrackEvidence, course: Course, step: float) -> tuple[Floats, Floats, int]:
    """Return rate (n,) [m/s] and acceleration (n,) [m/s^2] of the depth, and the window [samples] that smooths them.

    `course` numbers the stretches of samples without a gap (`runs`), `step` [s] is the interval of samples. The rate is
    the mean of the height's slope and the velocity, each weighted by the other's noise variance, over the shortest
    window that leaves a noise of 2 % of the RMS rate.
    """
    depth, speed = -track.kept.position, -track.kept.velocity
    max_noise = _MAX_NOISE_SHARE * float(np.sqrt(np.mean(speed[course.used] ** 2)))
    width, slope_variance, speed_variance = _window(white_noise(depth) / step, white_noise(speed), max_noise)
    total_variance = slope_variance + speed_variance
    speed_share = slope_variance / total_variance if total_variance > 0 else 0.0

    # Local cubics within the runs; a run that is shorter than the window keeps its velocity.
    rates, accelerations = [], []
    cuts = np.flatnonzero(np.diff(course.runs)) + 1
    for run_depth, run_speed in zip(np.split(depth, cuts), np.split(speed, cuts), strict=True):
        if len(run_depth) < width:
            rates.append(run_speed)
            accelerations.append(np.zeros_like(run_speed))
            continue
        slope = (1.0 - speed_share) * local_cubic(run_depth, width, 1) / step
        rate = slope + speed_share * local_cubic(run_speed, width)
        rates.append(rate)
        accelerations.append(local_cubic(rate, width, 1) / step)
    return np.concatenate(rates), np.concatenate(accelerations), width


def _window(slope_noise: float, speed_noise: float, max_noise: float) -> tuple[int, float, float]:
    """Return the window [samples], and the variances [m^2/s^2] of the height's slope and of the velocity over it.

    The noises [m/s] are those of single samples. The mean of both, weighted by their information, has the variance
    a b/(a + b).
    """
    width, slope_variance, speed_variance = 1, 0.0, 0.0
    for width in _WINDOWS:
        slope_variance = (slope_noise * float(np.linalg.norm(cubic_weights(width, 1)))) ** 2
        speed_variance = (speed_noise * float(np.linalg.norm(cubic_weights(width)))) ** 2
        if slope_variance * speed_variance < max_noise**2 * (slope_variance + speed_variance):
            break
    return width, slope_variance, speed_variance


def white_noise(values: Floats) -> float:
    """Return the standard deviation of white noise that would give the third differences of a record."""
    return float(np.sqrt(np.mean(np.diff(values, 3) ** 2) / _THIRD_DIFFERENCE_POWER))
