"""The force that counts as touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_report import AirLine, Tare
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.air_line import ROBOT_FORCE, TOUCH_SIGMAS

SAMPLES_IN_A_ROW = 3  # that must agree before contact begins or ends; a choice

_PAPER_NOISE = 0.05  # [N] standard deviation of the paper's sensor; where no free air shows the noise
_ROBOT_SIGMAS = 5.0  # of the noise of a robot's force that count as touch; a choice
_DRIFT_SHARE = 0.1  # of the threshold, that a drift may take before the threshold rises with it; a choice
_ROBOT_RISE = 0.03  # [N] least rise of the mean over 0.1 s of a robot's force that counts as contact (decision 0104)
_RISE_SIGMAS = 0.6  # of the noise: the same of a record whose own noise says what counts as touch; 0.03 N of 0.05 N


@dataclass(frozen=True)
class ContactThreshold:
    """Force that counts as touch: beyond the noise, and beyond what the sensor's zero may drift by."""

    force: float  # [N]
    drift: float = 0.0  # [N/s]
    least_rise: float = _ROBOT_RISE  # [N] by which a slow rise shows
    air: AirLine | None = None  # that the force is compared with; None: with none

    @classmethod
    def of(cls, settings: AlignmentSettings, tare: Tare | None) -> ContactThreshold:
        """Return the stated threshold, else that of the noise in free air."""
        if isinstance(settings.touch_force, float):
            return cls(settings.touch_force, settings.drift)
        if tare is not None and (air := tare.air) is not None:
            return cls(TOUCH_SIGMAS * air.noise, 0.0, _RISE_SIGMAS * air.noise, air)
        noise = tare.noise if tare and tare.noise else _PAPER_NOISE
        return cls(max(_ROBOT_SIGMAS * noise, ROBOT_FORCE), settings.drift)

    @property
    def noise(self) -> float:
        """Standard deviation [N] of a force for which this is the threshold."""
        return self.force / _ROBOT_SIGMAS if self.air is None else self.air.noise

    def at(self, time: Floats) -> Floats:
        """Return the force (n,) [N] that counts as touch at a time [s]; a drift beyond its share raises it."""
        if self.air is not None:
            return self.air.at(time) + self.force + self.air.spread(time)
        return np.maximum(self.force, (1.0 - _DRIFT_SHARE) * self.force + self.drift * time)

    @property
    def hysteresis(self) -> float:
        """Force [N] below that which counts as touch, at which contact ends: half of the threshold."""
        return 0.5 * self.force

    def above_air(self, samples: Samples) -> Floats:
        """Return the force (n,) [N] of samples above the line through the air; unchanged without one."""
        return samples.force if self.air is None else samples.force - self.air.at(samples.time)


def run_lengths(condition: NDArray[np.bool_], before: int) -> NDArray[np.int64]:
    """Return how many samples in a row meet a condition, up to each of them (n,).

    The latest `before` samples of the block before met it, too.
    """
    index = np.arange(len(condition))
    last_failure = np.maximum.accumulate(np.where(condition, -1, index))
    return np.where(last_failure < 0, index + 1 + before, index - last_failure)
