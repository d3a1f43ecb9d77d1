"""The first touch of a record, and the distance of a surface from it."""

from __future__ import annotations

import math

import numpy as np
from palpate import Samples

# Choices.
_MIN_AIR_SAMPLES = 50  # before the touch, from which on the air determines the force's zero and noise
_VISIBLE_SIGMAS = 5.0  # of the air's noise, from which on the force is seen to have risen
_TOUCH_DEPTH_SHARE = 0.4  # depth at 1 sigma over that at 5 sigma; (1/5)^(2/3) = 0.34 of a force by d^1.5


def excess_distance(touch: tuple[float, float] | None, surface: float) -> float:
    """Return how much farther [m] a surface [m] is from a touch (height, tolerance) [m] than the tolerance.

    0 without a touch.
    """
    if touch is None:
        return 0.0
    height, tolerance = touch
    return max(abs(height - surface) - tolerance, 0.0)


def first_touch(samples: Samples) -> tuple[float, float] | None:
    """Return the height [m] of the first touch, and its tolerance [m]; None of a record without free air.

    The tolerance is the depth at which the force is as large as its noise: some 0.4 of the depth at which it is
    five times as large (of a force that goes with d^1.5).
    """
    contact_rows = np.flatnonzero(samples.contact)
    if not len(contact_rows) or contact_rows[0] < _MIN_AIR_SAMPLES:
        return None
    onset = int(contact_rows[0])
    # The force in air before: its zero, and its white noise by first differences, whose variance is twice as large.
    air_force = samples.force[:onset][np.isfinite(samples.force[:onset])]
    if len(air_force) < _MIN_AIR_SAMPLES // 2:
        return None
    noise = float(np.std(np.diff(air_force)) / math.sqrt(2))
    rise = samples.force[onset:] - float(np.median(air_force))
    visible_rows = np.flatnonzero(rise > _VISIBLE_SIGMAS * noise)
    if not len(visible_rows):
        return None
    height = float(np.nanmean(samples.position[onset - 1 : onset + 1]))
    visible_depth = abs(float(samples.position[onset + visible_rows[0]]) - height)
    return height, _TOUCH_DEPTH_SHARE * visible_depth
