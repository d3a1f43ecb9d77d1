"""Local cubics over a symmetric window (Savitzky and Golay 1964), without the import of scipy, which takes longer."""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np
from palpate import Floats

_ORDER = 3


@cache
def cubic_weights(width: int, derivative: int = 0) -> Floats:
    """Weights (width,) of neighbours, the latest first, in value or derivative of their cubic [per sample]."""
    places = np.arange(-(width // 2), width - width // 2, dtype=float)[::-1]
    wanted = np.zeros(_ORDER + 1)
    wanted[derivative] = factorial(derivative)
    weights = np.linalg.lstsq(places ** np.arange(_ORDER + 1)[:, None], wanted, rcond=None)[0]
    weights = 0.5 * (weights - weights[::-1]) if derivative % 2 else 0.5 * (weights + weights[::-1])
    weights.flags.writeable = False
    return weights


def local_cubic(values: Floats, width: int, derivative: int = 0) -> Floats:
    """Value or derivative [per sample] (n,) of the cubic around each; at both ends that of the outermost window."""
    half = width // 2
    found = np.empty(len(values))
    found[half : len(values) - half] = np.convolve(values, cubic_weights(width, derivative), "valid")
    first, last = _end_weights(width, derivative)
    found[:half] = first @ values[:width]
    found[len(values) - half :] = last @ values[-width:]
    return found


@cache
def _end_weights(width: int, derivative: int) -> tuple[Floats, Floats]:
    """Weights (width // 2, width) of a window in value or derivative [per sample] of its cubic at its first and last
    places."""
    half = width // 2
    size = max(half, 1)
    places = (np.arange(width) - (width - 1) / 2) / size
    fit = np.linalg.pinv(places[:, None] ** np.arange(_ORDER + 1))
    falling = np.array(
        [factorial(k) / factorial(k - derivative) if k >= derivative else 0.0 for k in range(_ORDER + 1)]
    )
    powers = np.maximum(np.arange(_ORDER + 1) - derivative, 0)
    values = (places[:, None] ** powers) * falling / float(size) ** derivative @ fit
    return values[:half], values[width - half :]
