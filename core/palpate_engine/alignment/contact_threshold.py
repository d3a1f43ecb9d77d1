"""The force that counts as touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_report import AirLine, Tare
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.air_line import ROBOT_FORCE, SIGMAS

SAMPLES_IN_A_ROW = 3  # that must agree before contact is found or lost

_PAPER_NOISE = 0.05  # [N] of a robot: standard deviation of the sensor in the paper; where no free air shows it
_SIGMAS = 5.0
_FOR_DRIFT = 0.1  # of the threshold
_RISE = 0.03  # [N] of a robot, of a tenth of a second's mean; less does not count
_RISE_SIGMAS = 0.6  # of the noise: the same of a record whose own noise says what counts as touch


@dataclass(frozen=True)
class ContactThreshold:
    """Force that counts as touch: beyond the noise, and beyond what the sensor's zero may drift by."""

    force: float  # [N]
    drift: float = 0.0  # [N/s]
    least_rise: float = _RISE  # [N] by which a slow rise shows
    air: AirLine | None = None  # that the force is compared with; None: with none

    @classmethod
    def of(cls, settings: AlignmentSettings, tare: Tare | None) -> ContactThreshold:
        """What the settings say, else five standard deviations of the noise in free air."""
        if isinstance(settings.touch_force, float):
            return cls(settings.touch_force, settings.drift)
        if tare is not None and (air := tare.air) is not None:
            return cls(SIGMAS * air.noise, 0.0, _RISE_SIGMAS * air.noise, air)
        noise = tare.noise if tare and tare.noise else _PAPER_NOISE
        return cls(max(_SIGMAS * noise, ROBOT_FORCE), settings.drift)

    @property
    def noise(self) -> float:
        """Standard deviation [N] of a force for which this is the threshold."""
        return self.force / _SIGMAS if self.air is None else self.air.noise

    def at(self, time: Floats) -> Floats:
        """Force (n,) [N] at a time [s]: the threshold, of which a tenth is for drift, or more."""
        if self.air is not None:
            return self.air.at(time) + self.force + self.air.spread(time)
        return np.maximum(self.force, (1.0 - _FOR_DRIFT) * self.force + self.drift * time)

    def above_air(self, samples: Samples) -> Floats:
        """Force (n,) [N] of samples above the line through the air; unchanged without one."""
        return samples.force if self.air is None else samples.force - self.air.at(samples.time)


def run_lengths(condition: NDArray[np.bool_], before: int) -> NDArray[np.int64]:
    """Return how many samples up to each one meet a condition without interruption, `before` of them in the last
    block."""
    index = np.arange(len(condition))
    broken = np.maximum.accumulate(np.where(condition, -1, index))
    return np.where(broken < 0, index + 1 + before, index - broken)
