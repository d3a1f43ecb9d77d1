"""A force that stands at the limit of its sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LastDigit

from palpate_kit.numerics.tip_travel import noise_of

FEWEST_AT_LIMIT = 10  # equal readings at the end of the range, in contact: the sensor is saturated
HEIGHT_SIGMAS = 8.0  # standard deviations of the height: the range of normal values of a tip at rest
MOST_STEPS = 1.5  # of the last digit, that a force at rest may have changed by: one, and what the slope is off
_UPPER_HALF = 0.5  # of the largest force; the slope of a contact law is steepest above it
TIMES_BELOW = 4.0  # times those of the next smaller value, which coarse readings stand at as often


def force_limit(force: Floats) -> float | None:
    """Return the largest reading (n,) [N] where a force stands at it, as at the limit of a sensor; else None.

    It stands there if at least 10 readings are the largest, and four times as many as have the next smaller value.
    Coarse readings stand at the value below it as well.
    """
    readings = force[np.isfinite(force)]
    if not len(readings):
        return None
    largest = float(readings.max())
    count = np.count_nonzero(readings == largest)
    if count < FEWEST_AT_LIMIT:
        return None
    # The next smaller reading.
    below = readings[readings < largest]
    count_below = np.count_nonzero(below == below.max()) if len(below) else 0
    return largest if count >= TIMES_BELOW * count_below else None


def at_limit(force: Floats, height: Floats, rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (n,) which samples are at the limit of the force (n,) [N] of some rows (n,), at heights (n,) [m]."""
    limit = force_limit(force[rows])
    limited = np.asarray(force == limit)
    if limit is None or _stands_with_tip(force, height, rows & limited, rows & ~limited):
        return np.zeros(len(force), bool)
    return limited


def _stands_with_tip(force: Floats, height: Floats, limited: NDArray[np.bool_], free: NDArray[np.bool_]) -> bool:
    """Return True if a force without noise stands because the tip does: no digit of it would have changed.

    `limited` and `free` (n,) are the samples at the limit and the others. By the slope of the force over the height in
    the upper half of the other samples, and the way of the tip meanwhile.
    """
    digit = LastDigit.of(force[limited | free])
    if not digit.exceeds_noise(force[free]):
        return False
    # The force that the way of the tip would have changed by, with the slope in the upper half.
    upper = free & (force > _UPPER_HALF * float(np.max(force[free])))
    way = float(np.ptp(height[upper]))
    slope = (float(np.ptp(force[upper])) + digit.step) / way if way > 0.0 else np.inf
    moved = float(np.ptp(height[limited])) - HEIGHT_SIGMAS * noise_of(height)
    return moved <= 0.0 or slope * moved <= MOST_STEPS * digit.step
