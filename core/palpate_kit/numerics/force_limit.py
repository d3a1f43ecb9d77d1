"""A force that stands at the limit of its sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

FEWEST_AT_LIMIT = 10  # equal readings at the end of the range, in contact: the sensor is saturated
TIMES_BELOW = 4.0  # times those of the next smaller value, which coarse readings stand at as often


def force_limit(force: Floats) -> float | None:
    """Return the largest reading (n,) [N] where a force stands at it, as at the limit of a sensor; else None.

    Coarse readings stand at the value below it as well.
    """
    values, counts = np.unique(force[np.isfinite(force)], return_counts=True)
    if not len(values) or counts[-1] < max(FEWEST_AT_LIMIT, TIMES_BELOW * counts[-2:-1].sum()):
        return None
    return float(values[-1])


def at_limit(force: Floats, rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (n,) which samples are at the limit of the force (n,) [N] of some rows (n,)."""
    limit = force_limit(force[rows])
    return np.zeros(len(force), bool) if limit is None else np.asarray(force == limit)
