"""Free air before a press, of a record whose own noise says what counts as touch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from palpate.alignment_report import AirLine, Tare
from palpate.alignment_settings import AlignmentSettings
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.change_point import samples_as_one, white_noise

ROBOT_FORCE = 0.05  # [N] below which a robot's force is its tip's inertia, whatever the noise
SIGMAS = 10.0  # of the noise, that count as touch where they are less than that
FIRST_READINGS = 64  # samples from which the noise is estimated
FEWEST_IN_AIR = 10  # samples
_ROUGHER = 1.5  # times the noise of its beginning, that a line through all of the air leaves where it is bent


def may_decide(settings: AlignmentSettings) -> bool:
    """Return True if a record's own noise may say what counts as touch, once there are readings enough."""
    return settings.touch_force == "noise" or (settings.tip_mass == 0 and settings.touch_force is None)


def decides(samples: Samples) -> bool:
    """Return True if the first readings of a record scatter by far less than a robot's force."""
    first = samples.force[:FIRST_READINGS]
    known = first[np.isfinite(first)]
    return (
        len(first) == FIRST_READINGS and len(known) > FIRST_READINGS // 2 and SIGMAS * white_noise(known) < ROBOT_FORCE
    )


def record_tare(settings: AlignmentSettings, air: Samples, step: float) -> Tare | None:
    """The tare of a record by its air before a touch, and the `step` [N] of its force; None where that is too short.

    What is subtracted is that of the first `tare_duration`, or of as many readings as determine the noise.
    """
    air = air[np.isfinite(air.force)]
    if len(air) < FEWEST_IN_AIR:
        return None
    until = max(settings.tare_duration, float(air.time[min(FIRST_READINGS, len(air)) - 1]))
    near, whole = _air_line(air[air.time <= until]), _air_line(air)
    line = whole if whole.noise <= _ROUGHER * near.noise else near
    line = replace(line, noise=max(line.noise, step / math.sqrt(12.0)))
    if not line.noise > 0.0:
        return None
    if settings.tare == "free-air":
        return Tare(near.level, near.level_std, near.noise, near.until, line.less(near.level))
    offset = 0.0 if settings.tare == "none" else float(settings.tare)
    return Tare(offset, settings.tare_uncertainty, None, air=line.less(offset))


def _air_line(air: Samples) -> AirLine:
    # Rounded once, so that a filter on another machine finds the same bits whatever order it adds in.
    middle, level = (math.fsum(values.tolist()) / len(air) for values in (air.time, air.force))
    time = air.time - middle
    power = float(time @ time)
    slope = float(time @ air.force) / power
    left: Floats = air.force - level - slope * time
    variance = float(left @ left) / (len(air) - 2)
    level_std, slope_std = (math.sqrt(variance * samples_as_one(left) / size) for size in (len(air), power))
    return AirLine(middle, level, level_std, slope, slope_std, math.sqrt(variance), float(air.time[-1]))


def tare_in_contact(settings: AlignmentSettings, noise: float) -> Tare | None:
    """Return the stated tare of a record that begins in contact, and the noise [N] of its readings; None if none is
    stated."""
    if settings.tare == "free-air":
        return None
    offset = 0.0 if settings.tare == "none" else float(settings.tare)
    return Tare(offset, settings.tare_uncertainty, None, air=AirLine(0.0, 0.0, 0.0, 0.0, 0.0, noise, 0.0))
