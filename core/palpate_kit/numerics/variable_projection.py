"""Variable projection: what a force is linear in is solved for at each place of a search over the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from palpate import Floats

_ROUNDS = 6  # grids, each about the best place of the one before
_RATIOS, _HEIGHTS = np.linspace(-1.0, 1.0, 7), np.linspace(-1.0, 1.0, 13)  # places of a finer grid


@dataclass(frozen=True)
class LinearPart:
    """Unknowns (k,) that leave the least squares, and these; infinite where the first is not above 0."""

    squares: float
    unknowns: Floats


def linear_part(matrix: Floats, target: Floats) -> LinearPart:
    """The least squares of target (n,) less columns (n, k), which may differ by many powers of ten in size."""
    scale = np.sqrt((matrix**2).sum(axis=0))
    if not np.isfinite(scale).all():
        return LinearPart(np.inf, np.zeros(len(scale)))
    scale[scale == 0] = 1.0
    found = np.linalg.lstsq(matrix / scale, target, rcond=None)[0] / scale
    left = float(((target - matrix @ found) ** 2).sum())
    return LinearPart(left if found[0] > 0 else np.inf, found)


def best_place(
    squares: Callable[[float, float, int], float], ratios: Floats, heights: Floats, *, held: bool = False
) -> tuple[float, float]:
    """The ratio and the height of the least squares: on a grid, then on finer ones about the best place of each.

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
