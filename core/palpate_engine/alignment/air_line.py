"""Free air before a press, of a record whose own noise says what counts as touch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from palpate.alignment_report import AirLine
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.change_point import change_point, samples_as_one, white_noise

ROBOT_FORCE = 0.05  # [N] below which a robot's force is its tip's inertia, whatever the noise
SIGMAS = 10.0  # of the noise, that count as touch where they are less than that
FIRST_READINGS = 64  # samples that tell how large the noise is
_FEWEST = 10  # samples of air
_TILTED = 5.0  # standard uncertainties of a slope


def may_decide(settings: AlignmentSettings) -> bool:
    """Whether a record's own noise may say what counts as touch, once there are readings enough."""
    return settings.tip_mass == 0 and settings.touch_force is None


def decides(settings: AlignmentSettings, samples: Samples) -> bool:
    """Whether a record's own noise says what counts as touch, and not what a robot's tip makes of its own motion.

    So it is where nothing hangs behind the sensor, and the first readings scatter by far less than a robot's force.
    """
    if not may_decide(settings):
        return False
    first = samples.force[:FIRST_READINGS]
    known = first[np.isfinite(first)]
    return (
        len(first) == FIRST_READINGS
        and len(known) > FIRST_READINGS // 2
        and 0 < SIGMAS * white_noise(known) < ROBOT_FORCE
    )


def air_line(samples: Samples) -> AirLine | None:
    """The air that samples begin with, until contact where they get there; None where there is too little."""
    samples = samples[np.isfinite(samples.force) & np.isfinite(samples.position)]
    air = samples[: _touched(samples)]
    if len(air) < _FEWEST:
        return None
    middle, level, slope, left = _line(air)
    power = float(((air.time - middle) ** 2).sum())
    variance = float(left @ left) / (len(air) - 2)
    together = samples_as_one(left)
    stds = (math.sqrt(variance * together / size) for size in (len(air), power))
    level_std, slope_std = stds
    return AirLine(middle, level, level_std, slope, slope_std, math.sqrt(variance), float(air.time[-1]))


def _touched(samples: Samples) -> int:
    """Index of the first sample below the surface; that after the last where a line explains them as well as a press.

    A tilt that the first quarter tells comes off before: it looks like a press.
    """
    quarter = samples[: len(samples) // 4]
    force = samples.force
    if len(quarter) > _FEWEST:
        middle, level, slope, left = _line(quarter)
        std = float(left.std()) / math.sqrt(float(((quarter.time - middle) ** 2).sum()))
        if abs(slope) > _TILTED * std:
            force = force - level - slope * (samples.time - middle)
    found = change_point(samples.position, force)
    if found is None:
        return len(samples)
    _, _, _, left = _line(replace(samples, force=force))
    below = samples.position < found.surface
    return int(np.argmax(below)) if below.any() and float(left.std()) > found.rms else len(samples)


def _line(air: Samples) -> tuple[float, float, float, Floats]:
    """Middle [s], level [N] there, slope [N/s], and what readings (n,) are off a line over time."""
    # Rounded once, so that a filter on another machine finds the same bits whatever order it adds in.
    middle, level = (math.fsum(values.tolist()) / len(air) for values in (air.time, air.force))
    time = air.time - middle
    slope = float(time @ air.force) / float(time @ time)
    return middle, level, slope, air.force - level - slope * time
