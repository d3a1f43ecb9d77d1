"""Local cubics over a symmetric window (Savitzky and Golay 1964), without the import of scipy, which takes longer."""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np
from palpate import Floats

_ORDER = 3  # of the polynomial: a cubic


@cache
def cubic_weights(width: int, derivative: int = 0) -> Floats:
    """Return the weights (width,) of neighbours, the latest first, in value or derivative of their cubic [per sample].

    They are the shortest w with sum of w_i x_i^k = 0 but k! for k the derivative, at the places x_i of the window.
    """
    places = np.arange(-(width // 2), width - width // 2, dtype=float)[::-1]
    moments = np.zeros(_ORDER + 1)
    moments[derivative] = factorial(derivative)
    weights = np.linalg.lstsq(places ** np.arange(_ORDER + 1)[:, None], moments, rcond=None)[0]
    # Even derivatives have symmetric weights, odd ones antisymmetric: rounding is taken out.
    weights = 0.5 * (weights - weights[::-1]) if derivative % 2 else 0.5 * (weights + weights[::-1])
    weights.flags.writeable = False
    return weights


def local_cubic(values: Floats, width: int, derivative: int = 0) -> Floats:
    """Return value or derivative [per sample] (n,) of the cubic around each; at both ends that of the outermost
    window."""
    half = width // 2
    smooth = np.empty(len(values))
    smooth[half : len(values) - half] = np.convolve(values, cubic_weights(width, derivative), "valid")
    first, last = _end_weights(width, derivative)
    smooth[:half] = first @ values[:width]
    smooth[len(values) - half :] = last @ values[-width:]
    return smooth


@cache
def _end_weights(width: int, derivative: int) -> tuple[Floats, Floats]:
    """Return weights (width // 2, width) of a window in value or derivative [per sample] of its cubic at its ends."""
    half = width // 2
    size = max(half, 1)
    places = (np.arange(width) - (width - 1) / 2) / size
    fit = np.linalg.pinv(places[:, None] ** np.arange(_ORDER + 1))
    derivative_factors = np.array(
        [factorial(k) / factorial(k - derivative) if k >= derivative else 0.0 for k in range(_ORDER + 1)]
    )
    powers = np.maximum(np.arange(_ORDER + 1) - derivative, 0)
    values = (places[:, None] ** powers) * derivative_factors / float(size) ** derivative @ fit
    return values[:half], values[width - half :]
