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

LATEST = 0.03  # [s] of a delay that is looked for
_WINDOWS = (5, 7, 9, 11, 15, 19, 25, 31, 41)  # samples of the local cubic for rate and acceleration
_MAX_NOISE_SHARE = 0.02  # of the RMS rate: noise that the shortest window leaves, so that fast motions are not bent

Columns = Callable[[Course, float, Floats], Floats]  # forces (n, c) of units along a motion, by surface and numbers


@dataclass(frozen=True)
class ResponseLaw:
    """The answer of a material: forces that it is a sum of, and numbers in which it is not linear."""

    name: str
    columns: Columns
    start: tuple[float, ...] = ()
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
        """Return the record of a track."""
        course = make_course(track, track.kept.used)
        step = float(np.median(np.diff(course.time)))
        rate, bend, width = _motion(track, course, step)
        margin = max(round(LATEST / step), width)
        whole = np.zeros(len(course.time), bool)
        whole[margin:-margin] = course.runs[2 * margin :] == course.runs[: -2 * margin]
        mass = track.tip_mass or 0.0
        rows = np.flatnonzero(whole & course.used & np.isfinite(track.kept.force))
        moved = replace(course, height=track.kept.position, rate=rate, acceleration=bend)
        return cls(moved, track.surface, track.kept.force, mass, mass * moved.acceleration, rows, step)

    def late(self, delay: float) -> Course:
        """Return the motion `delay` ago, by its own derivatives: what noise its rate has is in the viscous force as
        well."""
        course = self.course
        bent = delay * course.acceleration
        return replace(course, height=course.height + delay * (course.rate - 0.5 * bent), rate=course.rate - bent)

    def with_inertia(self, delay: float) -> TimedRecord:
        """With an inertia that is as late as the force."""
        time, bend = self.course.time, self.course.acceleration
        return replace(self, inertia=self.mass * np.interp(time - delay, time, bend))

    def solved(self, law: ResponseLaw, surface: float, delay: float, numbers: Floats) -> tuple[Floats, Floats]:
        """Weights of a law's columns by least squares, and what they leave (r,) [N]."""
        columns = law.columns(self.late(delay), surface, numbers)[self.rows]
        regression = linear_regression(columns, (self.force - self.inertia)[self.rows])
        return regression.weights, regression.residual

    def slopes(
        self, law: ResponseLaw, surface: float, delay: float, numbers: Floats, weights: Floats
    ) -> tuple[float, Floats]:
        """Standard deviation [N] of the residual, and slopes (r, c + 2 + m) in weights, surface, delay and numbers."""

        def force(surface: float, delay: float, numbers: Floats) -> Floats:
            return np.asarray((law.columns(self.late(delay), surface, numbers) @ weights)[self.rows])

        columns = list(law.columns(self.late(delay), surface, numbers)[self.rows].T)
        columns.append((force(surface + 1e-6, delay, numbers) - force(surface - 1e-6, delay, numbers)) / 2e-6)
        columns.append((force(surface, delay + 1e-4, numbers) - force(surface, delay - 1e-4, numbers)) / 2e-4)
        for i in range(len(numbers)):
            step = np.zeros(len(numbers))
            step[i] = 1e-3
            columns.append((force(surface, delay, numbers + step) - force(surface, delay, numbers - step)) / 2e-3)
        left = (self.force - self.inertia)[self.rows] - force(surface, delay, numbers)
        return float(np.std(left)), np.column_stack(columns)


def _motion(track: TrackEvidence, course: Course, step: float) -> tuple[Floats, Floats, int]:
    """Rate and acceleration (n,) of the depth, from height and velocity by their noise, and the window [samples]."""
    height, speed = -track.kept.position, -track.kept.velocity
    usual = _MAX_NOISE_SHARE * float(np.sqrt(np.mean(speed[course.used] ** 2)))
    of_height, of_speed = white_noise(height) / step, white_noise(speed)
    width, slope, value = 1, 0.0, 0.0
    for width in _WINDOWS:
        slope = (of_height * float(np.linalg.norm(cubic_weights(width, 1)))) ** 2
        value = (of_speed * float(np.linalg.norm(cubic_weights(width)))) ** 2
        if slope * value < usual**2 * (slope + value):
            break
    share = slope / (slope + value) if slope + value > 0 else 0.0  # of the velocity
    rates, bends = [], []
    cuts = np.flatnonzero(np.diff(course.runs)) + 1
    for z, v in zip(np.split(height, cuts), np.split(speed, cuts), strict=True):
        if len(z) < width:
            rates.append(v)
            bends.append(np.zeros_like(v))
            continue
        rate = (1.0 - share) * local_cubic(z, width, 1) / step + share * local_cubic(v, width)
        rates.append(rate)
        bends.append(local_cubic(rate, width, 1) / step)
    return np.concatenate(rates), np.concatenate(bends), width


def white_noise(values: Floats) -> float:
    """Standard deviation of white noise that would give the third differences of a record."""
    return float(np.sqrt(np.mean(np.diff(values, 3) ** 2) / 20.0))
