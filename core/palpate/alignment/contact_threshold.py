"""The force that counts as touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.alignment.settings import AlignmentSettings
from palpate.alignment.tare import Tare
from palpate.vectors import Floats

SAMPLES_IN_A_ROW = 3  # that must agree before contact is found or lost

_PAPER_NOISE = 0.05  # [N], standard deviation of the sensor in the paper; where there is no free air to measure it in
_SIGMAS = 5.0
_FOR_DRIFT = 0.1  # of the threshold
_LEAST = 0.05  # [N]; a sensor without noise still feels the tip's inertia


@dataclass(frozen=True)
class ContactThreshold:
    """Force that counts as touch: beyond the noise, and beyond what the sensor's zero may drift by."""

    force: float  # [N]
    drift: float = 0.0  # [N/s]

    @classmethod
    def of(cls, settings: AlignmentSettings, tare: Tare | None) -> ContactThreshold:
        """What the settings say, else five standard deviations of the noise in free air."""
        if settings.touch_force is not None:
            return cls(settings.touch_force, settings.drift)
        noise = tare.noise if tare and tare.noise else _PAPER_NOISE
        return cls(max(_SIGMAS * noise, _LEAST), settings.drift)

    @property
    def noise(self) -> float:
        """Standard deviation [N] of a force for which this is the threshold."""
        return self.force / _SIGMAS

    def at(self, time: Floats) -> Floats:
        """Force (n,) [N] at a time [s]: the threshold, of which a tenth is for drift, or more."""
        return np.maximum(self.force, (1.0 - _FOR_DRIFT) * self.force + self.drift * time)


def run_lengths(condition: NDArray[np.bool_], before: int) -> NDArray[np.int64]:
    """How many samples up to each one meet a condition without interruption, `before` of them in the last block."""
    index = np.arange(len(condition))
    broken = np.maximum.accumulate(np.where(condition, -1, index))
    return np.where(broken < 0, index + 1 + before, index - broken)
