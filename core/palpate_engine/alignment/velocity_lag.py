"""Delay of the velocity channel: position against velocity shows one that nobody states."""

from __future__ import annotations

import math

import numpy as np
from palpate.estimation import Samples
from palpate.vectors import Floats

_SPAN = 10  # samples in one stretch; 20 ms at 500 Hz, short against a palpation's period and long against noise
_MAX_WAITING, _MAX_BLOCKS = 4096, 256  # samples, or blocks of them, that are added up at once: a choice, for speed
_MIN_CORRELATION = (
    0.9  # correlation of the slopes of neighbouring stretches, from which on noise makes at most a tenth of them
)
_MAX_DURATION = 0.03  # [s]; longer stretches blur the acceleration of a palpation
_MIN_STRETCHES, _MIN_USABLE = 20, 10  # all, and those without a gap, before a delay is stated: a choice
_MAX_STEP = 3  # usual steps within a stretch; a longer one is a gap: a choice


class VelocityCheck:
    """Compares the mean velocity of stretches with the way that the position went in them.

    Without noise and delay the two are equal, exactly. A velocity that is late by tau is v(t) = z'(t - tau), so their
    difference is -tau z'' to first order; tau follows by least squares over all stretches. Only sums are kept, added up
    in the order of the samples, so that they depend neither on how these were cut into blocks nor grow with the record.
    """

    def __init__(self) -> None:
        self._waiting: list[Samples] = []
        self._held = 0
        self._latest = np.zeros((0, 3))  # mean velocity, mean slope of position, duration
        self._stretches = self._long = self._usable = 0  # all, those that are too long, and those without a gap
        self._power = self._product = self._square = 0.0  # of acceleration and difference
        self._slopes = self._lagged = self._common = 0.0  # of the slope, with the one before, with the velocity

    def feed(self, samples: Samples) -> None:
        """Take in a block of samples."""
        self._waiting.append(samples)
        self._held += len(samples)
        if self._held > _MAX_WAITING or len(self._waiting) > _MAX_BLOCKS:
            self._take_in()

    def _take_in(self) -> None:
        """Add up the stretches that wait."""
        whole = (self._held - 1) // _SPAN
        if whole < 1:
            return
        block = Samples.joined(self._waiting)
        rows = np.arange(whole)[:, None] * _SPAN + np.arange(_SPAN + 1)
        time, position, velocity = block.time[rows], block.position[rows], block.velocity[rows]
        step = np.diff(time, axis=1)
        duration = time[:, -1] - time[:, 0]
        # Mean velocity by the trapezoidal rule, and the slope that the position makes of the same stretch.
        mean = ((velocity[:, 1:] + velocity[:, :-1]) / 2 * step).sum(axis=1) / duration
        slope = (position[:, -1] - position[:, 0]) / duration
        is_even = step.max(axis=1) < _MAX_STEP * duration / _SPAN  # no gap within
        usable_mean = np.where(is_even, mean, np.nan)
        self._add(np.column_stack([usable_mean, slope, duration]))
        self._waiting = [block[np.arange(whole * _SPAN, len(block))]]  # a copy: a view would hold the whole block
        self._held -= whole * _SPAN

    def _add(self, stretches: Floats) -> None:
        """Take in stretches (n, 3): mean velocity [m/s], slope of the position [m/s] and duration [s] of each.

        Each gives the one before its acceleration, from the neighbours on both sides.
        """
        self._stretches += len(stretches)
        self._long += int(np.count_nonzero(stretches[:, 2] > _MAX_DURATION))
        stretches = np.concatenate([self._latest, stretches])
        self._latest = stretches[-2:]
        mean, slope, duration = stretches.T
        # Central difference of the mean velocities of the neighbours, for the stretch between them.
        acceleration, difference = (mean[2:] - mean[:-2]) / (2 * duration[1:-1]), mean[1:-1] - slope[1:-1]
        usable = np.isfinite(acceleration) & np.isfinite(difference)
        if not usable.any():
            return
        acceleration, difference = acceleration[usable], difference[usable]
        self._usable += len(difference)
        self._power = _added(self._power, acceleration * acceleration)
        self._product = _added(self._product, acceleration * difference)
        self._square = _added(self._square, difference * difference)
        # Neighbouring slopes correlate by as much as they are motion and not noise.
        middle_slope, earlier_slope, velocity = slope[1:-1][usable], slope[:-2][usable], mean[1:-1][usable]
        self._slopes = _added(self._slopes, middle_slope * middle_slope)
        self._lagged = _added(self._lagged, middle_slope * earlier_slope)
        self._common = _added(self._common, middle_slope * velocity)

    @property
    def _is_enough(self) -> bool:
        """True if there are stretches that are many and short enough."""
        self._take_in()
        return self._stretches >= _MIN_STRETCHES and 2 * self._long <= self._stretches and self._usable >= _MIN_USABLE

    @property
    def share(self) -> float | None:
        """Ratio of the velocity channel to the derivative of the position [1], by least squares; None if mostly noise.

        Noise of the position lowers it, to `_MIN_CORRELATION` at least.
        """
        if not self._is_enough or self._slopes == 0 or self._lagged < _MIN_CORRELATION * self._slopes:
            return None
        return self._common / self._slopes

    @property
    def delay(self) -> tuple[float, float] | None:
        """Delay of velocity after position and its standard uncertainty [s]; None if it cannot be determined."""
        if not self._is_enough or self._power == 0:
            return None
        late = -self._product / self._power
        residual = max(self._square + late * self._product, 0.0)
        return late, math.sqrt(residual / (self._usable - 1) / self._power)


def _added(total: float, values: Floats) -> float:
    """Return a total and values (n,), one after the other however they are cut."""
    return float(np.cumsum(np.concatenate([[total], values]))[-1])
