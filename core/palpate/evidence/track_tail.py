"""The last seconds of a track in full: settling, random walk, residual force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.vectors import Floats

_PARTS = 12  # a choice: of the tail, whose steps show a random walk
_CHANCE_SIGMAS = 3.0  # a choice: a slope within so many standard deviations of a random walk is chance
_LONG = 20.0  # lengths of the tail, a choice: after so long a filter's gain in one is small against its walk
_SLOPE_SAMPLES = 5  # a choice: velocity is differenced over so many samples to either side
_MIN_SAMPLES = 10  # a choice: a shorter tail has no slope
_MIN_PARTS = 3  # of the tail: fewer have no scatter of steps
# Laws of a random walk with variance q per second (see `Tail.slope_of_a_walk`).
_SLOPE_VARIANCE = 1.2  # of a least-squares slope over q/T, in a stretch of length T
_RATE_BY_STEPS = 1.5  # q over the variance of steps/h, between means of parts of length h


@dataclass(frozen=True, eq=False)
class Tail:
    """The latest tracked samples and their estimates; equal to itself alone."""

    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N] measured
    position: Floats  # (n,) [m]
    velocity: Floats  # (n,) [m/s]
    values: Floats  # (n, k)
    std: Floats  # (n, k)
    surface: Floats  # (n,) [m]
    surface_std: Floats  # (n,) [m]
    model_force: Floats  # (n,) [N]
    nis: Floats  # (n,)
    innovation: Floats  # (n,) normalised, with its sign; NaN where the estimator reports none

    def since(self, begin: float) -> Tail:
        """Return the part from a time [s] on."""
        rows = self.time >= begin
        if rows.all():
            return self
        return Tail(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def last(self, seconds: float) -> Tail:
        """Return the last part of a duration [s]."""
        return self.since(float(self.time[-1]) - seconds)

    def unsettled(self, values: Floats, tracked: float) -> Floats:
        """Return time tracked [s] times slope of each column of values (n, k): the possible remaining way to rest (k,).

        The error of a filter that settles dies away like a power of time, x(t) = x + c/t^p, so that this is p times
        the remaining error, for any c. The filter's own standard deviation does not include that. After a
        long time, a slope that a random walk has by chance shows no way to rest, and does not count.
        """
        if len(self.time) < _MIN_SAMPLES:
            return np.zeros(values.shape[1])
        values = np.where(np.ptp(values, axis=0) == 0, 0.0, values)  # a slope of one number over and over is rounding
        # Sums, not a linear solve: libraries for that do not promise the same bits twice.
        centred = (self.time - self.time.mean())[:, None]
        slopes = (centred * (values - values.mean(axis=0))).sum(axis=0) / (centred**2).sum()
        if tracked < _LONG * float(self.time[-1] - self.time[0]):
            return np.asarray(np.abs(slopes) * tracked)
        chance = _CHANCE_SIGMAS * self.slope_of_a_walk(values)
        return np.asarray(np.where(np.abs(slopes) > chance, np.abs(slopes) * tracked, 0.0))

    @staticmethod
    def mean(values: Floats) -> Floats:
        """Return the mean (k,) of the columns of values (n, k); of one number over and over that number."""
        return np.asarray(np.where(np.ptp(values, axis=0) == 0, values[0], values.mean(axis=0)))

    def slope_of_a_walk(self, values: Floats) -> Floats:
        """Return the standard deviation (k,) of the slope of a random walk with the steps that the values make.

        Steps are those between the means of parts of the tail. A walk with variance q per second has, over a stretch of
        length T, a least-squares slope of variance 1.2 q/T; the means of parts of length h differ by 2/3 q h.
        """
        # Means of the parts of the tail, and the variance of the steps between them.
        parts = [part for part in np.array_split(np.arange(len(self.time)), _PARTS) if len(part)]
        means = np.array([values[part].mean(axis=0) for part in parts])
        span = float(self.time[-1] - self.time[0])
        if len(means) < _MIN_PARTS or span <= 0:
            return np.zeros(values.shape[1])
        steps = np.diff(means, axis=0)
        steps = steps - steps.mean(axis=0)  # their common part is the slope in question
        square = (steps**2).sum(axis=0) / (len(steps) - 1)
        # The slope's variance 1.2 q/T with T the span, q = 3/2 square/h and h = T/parts.
        return np.asarray(np.sqrt(_SLOPE_VARIANCE * _RATE_BY_STEPS * square * len(means)) / span)

    def force_rms(self, tip_mass: float) -> float:
        """Return the RMS [N] of measured force less inertia of the tip less the model's force; NaN where unknown."""
        n = _SLOPE_SAMPLES
        if len(self.time) <= 2 * n:
            return float("nan")
        # Height and depth count in opposite directions: u = F + m d'' = F - m z''.
        residual = (self.force - self.model_force + tip_mass * acceleration(self.time, self.velocity))[n:-n]
        residual = residual[np.isfinite(residual)]
        return float(np.sqrt(np.mean(residual**2))) if len(residual) else float("nan")


def acceleration(time: Floats, velocity: Floats) -> Floats:
    """Return the acceleration (n,) [m/s^2] from a velocity (n,) [m/s], differenced over samples; NaN at both ends."""
    n = _SLOPE_SAMPLES
    slope = np.full(len(time), np.nan)
    if len(time) > 2 * n:
        slope[n:-n] = (velocity[2 * n :] - velocity[: -2 * n]) / (time[2 * n :] - time[: -2 * n])
    return slope
