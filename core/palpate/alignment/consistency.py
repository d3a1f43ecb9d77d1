"""Position against velocity: whether the velocity channel is late without saying so."""

from __future__ import annotations

import numpy as np

from palpate.estimation import Floats, Samples

_SPAN = 10  # samples in one stretch; 20 ms at 500 Hz, short against a palpation's period and long against noise
_LONGEST = 0.03  # [s]; longer stretches blur the acceleration of a palpation


class VelocityCheck:
    """Compares the mean velocity of stretches with the way that the position went in them.

    Without noise and delay the two are equal, exactly. A velocity that is late by tau is v(t) = z'(t - tau), so their
    difference is -tau z'' to first order; tau follows by least squares over all stretches.
    """

    def __init__(self) -> None:
        self._waiting: list[Samples] = []
        self._held = 0
        self._stretches: list[Floats] = []  # rows of mean velocity, mean slope of position, duration

    def feed(self, samples: Samples) -> None:
        """Take in a block of samples."""
        self._waiting.append(samples)
        self._held += len(samples)
        whole = (self._held - 1) // _SPAN
        if whole < 1:
            return
        block = Samples.joined(self._waiting)
        rows = np.arange(whole)[:, None] * _SPAN + np.arange(_SPAN + 1)
        time, position, velocity = block.time[rows], block.position[rows], block.velocity[rows]
        step = np.diff(time, axis=1)
        duration = time[:, -1] - time[:, 0]
        mean = ((velocity[:, 1:] + velocity[:, :-1]) / 2 * step).sum(axis=1) / duration
        slope = (position[:, -1] - position[:, 0]) / duration
        even = step.max(axis=1) < 3 * duration / _SPAN  # no gap within
        self._stretches.append(np.column_stack([np.where(even, mean, np.nan), slope, duration]))
        self._waiting = [block[whole * _SPAN :]]
        self._held -= whole * _SPAN

    @property
    def delay(self) -> tuple[float, float] | None:
        """Lateness of velocity against position and its standard uncertainty [s]; None where it cannot be told."""
        if not self._stretches:
            return None
        mean, slope, duration = np.concatenate(self._stretches).T
        if len(mean) < 20 or np.median(duration) > _LONGEST:
            return None
        acceleration = (mean[2:] - mean[:-2]) / (2 * duration[1:-1])
        apart = (mean - slope)[1:-1]
        known = np.isfinite(acceleration) & np.isfinite(apart)
        acceleration, apart = acceleration[known], apart[known]
        power = float(np.sum(acceleration**2))
        if len(apart) < 10 or power == 0:
            return None
        late = -float(np.sum(apart * acceleration)) / power
        residual = apart + late * acceleration
        return late, float(np.sqrt(np.sum(residual**2) / (len(apart) - 1) / power))
