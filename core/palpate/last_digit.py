"""The last digit of a channel: the step of its readings, and what rounding to it does to them.

Rounding by a step q is white noise of standard deviation q/sqrt(12) where the noise of the channel is above q/2 (Widrow
and Kollar 2008, chapter 4). Below, the error keeps its value as long as the signal stays within one step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.vectors import Floats

_QUIET_STEPS = 2.0  # the most that a third difference of rounded readings without noise has
_QUIET_SHARE = 2.0 / 3.0  # of third differences that have no more, where the noise is half a step (normal noise)
# Of the range of the readings: a third difference by the course of a force without noise, over a ramp of 20 samples.
_SMOOTH_SHARE = 3e-5
_BINARY_ROUNDING = 1e-12  # of the largest reading, below which two decimal numbers are the same
_PLATEAU_STEPS = 1.5  # between the levels of a plateau, which differ by one
_ROUNDING = 1.0 + 1e-6  # times a bound that a difference of rounded readings may equal
_ORDER = 3  # of the differences that show noise


@dataclass(frozen=True)
class LastDigit:
    """The step of the readings of a channel."""

    step: float  # [unit of the readings]; 0: none shows

    @classmethod
    def of(cls, values: Floats) -> LastDigit:
        """Return the least difference of two readings (n,) that differ."""
        levels = np.sort(values[np.isfinite(values)])
        steps = np.diff(levels)
        steps = steps[steps > _BINARY_ROUNDING * float(np.max(np.abs(levels), initial=0.0))]
        return cls(float(steps.min()) if len(steps) else 0.0)

    @property
    def noise(self) -> float:
        """Standard deviation of rounding: of a uniform distribution over the step, q/sqrt(12)."""
        return self.step / math.sqrt(12.0)

    def quiet_change(self, span: float) -> float:
        """Return the most that a third difference of readings of this range has where these have no noise."""
        return max(_QUIET_STEPS * self.step, _SMOOTH_SHARE * span) * _ROUNDING

    def exceeds_noise(self, values: Floats) -> bool:
        """Return True if readings (n,) show a noise below half a step, or none at all."""
        if len(values) <= _ORDER:
            return False
        third = np.abs(np.diff(values, _ORDER))
        return float(np.mean(third <= self.quiet_change(float(np.ptp(values))))) >= _QUIET_SHARE

    def plateau_sizes(self, values: Floats) -> Floats:
        """Return the number of readings (n,) in the plateau of each: neighbours that differ by one step at most.

        Noise far below a step makes readings go to and fro between two levels, which are one plateau.
        """
        # A plateau ends at the change that would make its levels differ by more.
        reach, sizes = _PLATEAU_STEPS * self.step, np.ones(len(values))
        changes = np.flatnonzero(np.append(True, np.diff(values) != 0.0)[: len(values)])
        begin, lowest, highest = 0, math.inf, -math.inf
        for place, level in zip(changes.tolist(), values[changes].tolist(), strict=True):
            lowest, highest = min(lowest, level), max(highest, level)
            if highest - lowest > reach:
                sizes[begin:place] = place - begin
                begin, lowest, highest = place, level, level
        sizes[begin:] = len(values) - begin
        return sizes
