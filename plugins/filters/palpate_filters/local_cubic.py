"""Local cubics over a symmetric window (Savitzky and Golay 1964), with no more of scipy than they need.

The numbers are those of `scipy.signal`, whose import takes longer than a fit, to the bit.
"""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np
from palpate import Floats

_ORDER = 3


@cache
def cubic_weights(width: int, derivative: int = 0) -> Floats:
    """Weights (width,) of neighbours, the latest first, in value or derivative of their cubic [per sample]."""
    from scipy.linalg import lstsq

    places = np.arange(-(width // 2), width - width // 2, dtype=float)[::-1]
    wanted = np.zeros(_ORDER + 1)
    wanted[derivative] = factorial(derivative)
    solution = lstsq(places ** np.arange(_ORDER + 1)[:, None], wanted)
    assert solution is not None
    weights = np.asarray(solution[0], np.float64)
    weights.flags.writeable = False
    return weights


def local_cubic(values: Floats, width: int, derivative: int = 0) -> Floats:
    """Value or derivative [per sample] (n,) of the cubic around each; at both ends that of the outermost window."""
    from scipy.ndimage import convolve1d

    found = np.asarray(convolve1d(values, cubic_weights(width, derivative), mode="constant"))
    half = width // 2
    for window, rows in ((values[:width], slice(0, half)), (values[-width:], slice(len(values) - half, len(values)))):
        cubic = np.polyder(np.polyfit(np.arange(width), window, _ORDER), derivative)
        begin = 0 if rows.start == 0 else width - half
        found[rows] = np.polyval(cubic, np.arange(begin, begin + half))
    return found
