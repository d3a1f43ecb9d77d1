"""The last seconds of a track in full, and what can be read in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.vectors import Floats

_PARTS = 12  # of the tail, whose steps show a random walk
_SIGMAS = 3.0
_LONG = 20.0  # lengths of the tail, from which on what a filter gains in one is small against its walk
_SLOPE_SAMPLES = 5  # velocity is differenced over so many samples to either side


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
        """The part from a time [s] on."""
        rows = self.time >= begin
        if rows.all():
            return self
        return Tail(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def last(self, seconds: float) -> Tail:
        """The part from so long before the end on."""
        return self.since(float(self.time[-1]) - seconds)

    def unsettled(self, values: Floats, tracked: float) -> Floats:
        """Time tracked [s] times slope of each column of values (n, k): what may be left of its way to rest (k,).

        The error of a filter that settles dies away like a power of time, x(t) = x + c/t^p, so that this is p times
        what is left of it, whatever c is. The filter's own standard deviation knows nothing of that. After a
        long time, a slope that a random walk has by chance says nothing of a way to rest, and counts as none.
        """
        if len(self.time) < 10:
            return np.zeros(values.shape[1])
        values = np.where(np.ptp(values, axis=0) == 0, 0.0, values)  # a slope of one number over and over is rounding
        # Sums, not a linear solve: libraries for that do not promise the same bits twice.
        since = (self.time - self.time.mean())[:, None]
        slopes = (since * (values - values.mean(axis=0))).sum(axis=0) / (since**2).sum()
        if tracked < _LONG * float(self.time[-1] - self.time[0]):
            return np.asarray(np.abs(slopes) * tracked)
        chance = _SIGMAS * self.slope_of_a_walk(values)
        return np.asarray(np.where(np.abs(slopes) > chance, np.abs(slopes) * tracked, 0.0))

    @staticmethod
    def mean(values: Floats) -> Floats:
        """Mean (k,) of the columns of values (n, k); of one number over and over that number."""
        return np.asarray(np.where(np.ptp(values, axis=0) == 0, values[0], values.mean(axis=0)))

    def slope_of_a_walk(self, values: Floats) -> Floats:
        """Standard deviation (k,) of the slope of a random walk with the steps that the values make.

        Steps are those between the means of parts of the tail. A walk with variance q per second has, over a stretch of
        length T, a least-squares slope of variance 1.2 q/T; the means of parts of length h differ by 2/3 q h.
        """
        parts = [part for part in np.array_split(np.arange(len(self.time)), _PARTS) if len(part)]
        means = np.array([values[part].mean(axis=0) for part in parts])
        span = float(self.time[-1] - self.time[0])
        if len(means) < 3 or span <= 0:
            return np.zeros(values.shape[1])
        steps = np.diff(means, axis=0)
        steps = steps - steps.mean(axis=0)  # what is common to all is the slope that is asked about
        square = (steps**2).sum(axis=0) / (len(steps) - 1)
        return np.asarray(np.sqrt(1.2 * 1.5 * square * len(means)) / span)

    def force_rms(self, tip_mass: float) -> float:
        """RMS [N] of measured force less inertia of the tip less the model's force; NaN where that is unknown."""
        n = _SLOPE_SAMPLES
        if len(self.time) <= 2 * n:
            return float("nan")
        # Height and depth count in opposite directions: u = F + m d'' = F - m z''.
        residual = (self.force - self.model_force + tip_mass * acceleration(self.time, self.velocity))[n:-n]
        residual = residual[np.isfinite(residual)]
        return float(np.sqrt(np.mean(residual**2))) if len(residual) else float("nan")


def acceleration(time: Floats, velocity: Floats) -> Floats:
    """Acceleration (n,) [m/s^2] from a velocity (n,) [m/s], differenced over a few samples; NaN at both ends."""
    n = _SLOPE_SAMPLES
    slope = np.full(len(time), np.nan)
    if len(time) > 2 * n:
        slope[n:-n] = (velocity[2 * n :] - velocity[: -2 * n]) / (time[2 * n :] - time[: -2 * n])
    return slope
