"""Free air before a press, of a record whose own noise says what counts as touch."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate.alignment.change_point import change_point, samples_as_one, white_noise
from palpate.alignment.held_samples import FIRST_SAMPLES
from palpate.alignment.settings import AlignmentSettings
from palpate.estimation import Samples
from palpate.vectors import Floats

ROBOT_FORCE = 0.05  # [N] below which a robot's force is its tip's inertia, whatever the noise
_SIGMAS = 10.0  # of the noise, that is less than that
_FEWEST = 10  # samples


@dataclass(frozen=True)
class FreeAir:
    """The force in free air by a line over time: its level, its slope, and how far readings scatter about it."""

    middle: float  # [s]
    level: float  # [N] there
    level_std: float  # [N]
    slope: float  # [N/s]
    slope_std: float  # [N/s]
    noise: float  # [N] standard deviation of one reading
    until: float  # [s]

    def less(self, offset: float) -> FreeAir:
        """The same of a force less an offset [N]."""
        return replace(self, level=self.level - offset)

    def at(self, time: Floats) -> Floats:
        """Force (n,) [N] at times [s]."""
        return self.level + self.slope * (time - self.middle)

    def spread(self, time: Floats) -> Floats:
        """By how much (n,) [N] the line may be off at times [s], by three standard uncertainties of its slope."""
        return 3.0 * self.slope_std * np.abs(time - self.middle)


def decides(settings: AlignmentSettings, samples: Samples) -> bool:
    """Whether a record's own noise says what counts as touch, and not what a robot's tip makes of its own motion.

    So it is where nothing hangs behind the sensor, and the first readings scatter by far less than a robot's force.
    """
    if settings.tip_mass != 0 or settings.touch_force is not None:
        return False
    first = samples.force[:FIRST_SAMPLES]
    known = first[np.isfinite(first)]
    return len(known) == FIRST_SAMPLES and 0 < _SIGMAS * white_noise(known) < ROBOT_FORCE


def free_air(samples: Samples) -> FreeAir | None:
    """The air before contact on the way down; None where there is too little."""
    down = samples[: int(np.nanargmin(samples.position)) + 1] if len(samples) else samples
    known = np.isfinite(down.force) & np.isfinite(down.position)
    down = down[known]
    found = change_point(down.position, down.force)
    below = down.position < found.surface if found is not None else np.zeros(len(down), bool)
    air = down[: int(np.argmax(below))] if below.any() else down
    if len(air) < _FEWEST:
        return None
    # Rounded once, so that a filter on another machine finds the same bits whatever order it adds in.
    middle, level = (math.fsum(values.tolist()) / len(air) for values in (air.time, air.force))
    time = air.time - middle
    power = float(time @ time)
    slope = float(time @ air.force) / power
    left = air.force - level - slope * time
    variance = float(left @ left) / (len(air) - 2)
    together = samples_as_one(left)
    stds = (math.sqrt(variance * together / size) for size in (len(air), power))
    level_std, slope_std = stds
    return FreeAir(middle, level, level_std, slope, slope_std, math.sqrt(variance), float(air.time[-1]))
