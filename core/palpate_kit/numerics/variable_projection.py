"""Variable projection: what a force is linear in is solved for at each place of a search over the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from palpate import Floats

from palpate_kit.numerics.least_squares import bounded_quadratic

_RIDGE = 1e-12  # of the squares of a column
_ROUNDS = 6  # grids, each about the best place of the one before
_RATIOS, _HEIGHTS = np.linspace(-1.0, 1.0, 7), np.linspace(-1.0, 1.0, 13)  # places of a finer grid


@dataclass(frozen=True)
class LinearPart:
    """Unknowns (k,) that leave the least squares, and these; infinite where columns are not finite."""

    squares: float
    unknowns: Floats


def linear_part(matrix: Floats, target: Floats, low: Floats | None = None, high: Floats | None = None) -> LinearPart:
    """Return the least squares of target (n,) less columns (n, k), which may differ by many powers of ten in size.

    Within bounds (k,), where they are given: by those of the unknowns that are free of them where that is the least.
    """
    scale = np.sqrt((matrix**2).sum(axis=0))
    if not (np.isfinite(scale).all() and np.isfinite(target).all()):
        return LinearPart(np.inf, np.zeros(len(scale)))
    scale[scale == 0] = 1.0
    unit = matrix / scale
    found = np.linalg.lstsq(unit, target, rcond=None)[0] / scale
    if low is not None and high is not None and (np.any(found < low) or np.any(found > high)):
        least, most = low * scale, high * scale
        middle = np.clip(0.0, least, most)
        slope = -(unit.T @ (target - unit @ middle))
        square = unit.T @ unit + _RIDGE * np.eye(len(scale))
        inside = middle + bounded_quadratic(square, slope, least - middle, most - middle)
        found = np.clip(inside / scale, low, high)
    left = target - matrix @ found
    return LinearPart(float(left @ left), found)


def best_place(
    squares: Callable[[float, float, int], float], ratios: Floats, heights: Floats, *, held: bool = False
) -> tuple[float, float]:
    """Return the ratio and the height of the least squares: on a grid, then on finer ones about the best place of each.

    `ratios` are a geometric series; `squares` are asked with how many grids are left; heights that are `held` stay.
    """
    factor, width = float(ratios[1] / ratios[0]), 0.0 if held else float(np.ptp(heights)) / (len(heights) - 1)
    best = (float(ratios[0]), float(heights[0]))
    for left in reversed(range(_ROUNDS)):
        places = product(ratios.tolist(), heights.tolist())
        best = min(places, key=lambda place: squares(place[0], place[1], left))
        ratios = best[0] * factor**_RATIOS
        heights = heights[:1] if held else best[1] + width * _HEIGHTS
        factor, width = factor ** (1 / 3), width / 6.0
    return best
