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

ROBOT_FORCE = 0.05  # [N] below which a robot's force is its tip's inertia, whatever the noise (decision 0375)
TOUCH_SIGMAS = 10.0  # of the noise, that count as touch where they are less than that; a choice (decision 0375)
FIRST_READINGS = 64  # samples from which the noise is estimated; a choice
MIN_AIR = 10  # samples of a line through the air; a choice
_MAX_BEND_RATIO = 1.5  # times the noise of its beginning, that a line through all of the air leaves; a choice


def may_decide(settings: AlignmentSettings) -> bool:
    """Return True if a record's own noise may say what counts as touch, once there are readings enough."""
    return settings.touch_force == "noise" or (settings.tip_mass == 0 and settings.touch_force is None)


def decides(samples: Samples) -> bool:
    """Return True if the first readings of a record scatter by far less than a robot's force."""
    first = samples.force[:FIRST_READINGS]
    finite = first[np.isfinite(first)]
    if len(first) < FIRST_READINGS or len(finite) <= FIRST_READINGS // 2:
        return False
    return TOUCH_SIGMAS * white_noise(finite) < ROBOT_FORCE


def record_tare(settings: AlignmentSettings, air: Samples, step: float) -> Tare | None:
    """Return the tare of a record by its samples in air, before a touch, whose force has a resolution of a `step` [N].

    What is subtracted is that of the first `tare_duration`, or of as many readings as determine the noise. None where
    the air is too short, or has no noise.
    """
    air = air[np.isfinite(air.force)]
    if len(air) < MIN_AIR:
        return None
    # The line through all of the air, unless the air is bent.
    end = max(settings.tare_duration, float(air.time[min(FIRST_READINGS, len(air)) - 1]))
    beginning, whole = _air_line(air[air.time <= end]), _air_line(air)
    line = whole if whole.noise <= _MAX_BEND_RATIO * beginning.noise else beginning
    # Rounding to a step has the variance step^2 / 12.
    line = replace(line, noise=max(line.noise, step / math.sqrt(12.0)))
    if not line.noise > 0.0:
        return None
    if settings.tare == "free-air":
        air_line = line.less(beginning.level)
        return Tare(
            offset=beginning.level,
            offset_std=beginning.level_std,
            noise=beginning.noise,
            until=beginning.until,
            air=air_line,
        )
    offset = 0.0 if settings.tare == "none" else float(settings.tare)
    return Tare(offset, settings.tare_uncertainty, None, air=line.less(offset))


def _air_line(air: Samples) -> AirLine:
    """Return the line of the force over time by least squares; its uncertainties allow for noise that is not white."""
    # Rounded once, so that a filter on another machine finds the same bits whatever order it adds in.
    mean_time, level = (math.fsum(values.tolist()) / len(air) for values in (air.time, air.force))
    time = air.time - mean_time
    time_square = float(time @ time)
    slope = float(time @ air.force) / time_square
    residual: Floats = air.force - level - slope * time
    variance = float(residual @ residual) / (len(air) - 2)  # two unknowns: level and slope
    mean_variance = variance * samples_as_one(residual)
    level_std, slope_std = math.sqrt(mean_variance / len(air)), math.sqrt(mean_variance / time_square)
    return AirLine(
        middle=mean_time,
        level=level,
        level_std=level_std,
        slope=slope,
        slope_std=slope_std,
        noise=math.sqrt(variance),
        until=float(air.time[-1]),
    )


def tare_in_contact(settings: AlignmentSettings, noise: float) -> Tare | None:
    """Return the stated tare of a record that begins in contact, and the noise [N] of its readings.

    None where no tare is stated.
    """
    if settings.tare == "free-air":
        return None
    offset = 0.0 if settings.tare == "none" else float(settings.tare)
    return Tare(
        offset,
        settings.tare_uncertainty,
        None,
        air=AirLine(middle=0.0, level=0.0, level_std=0.0, slope=0.0, slope_std=0.0, noise=noise, until=0.0),
    )
