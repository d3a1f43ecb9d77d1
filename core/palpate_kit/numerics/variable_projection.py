"""Variable projection: what a force is linear in is solved for at each place of a search over the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from palpate import Floats

from palpate_kit.numerics.least_squares import bounded_quadratic

_RIDGE = 1e-12  # of the squares of a column: keeps columns that are multiples of each other solvable
_ROUNDS = 6  # grids, each about the best place of the one before: a choice, 6^-5 of a spacing at the end
_FINER_RATIO, _FINER_HEIGHT = 3, 6  # steps of a finer grid within one of the grid before, to each side
_RATIOS = np.linspace(-1.0, 1.0, 2 * _FINER_RATIO + 1)
_HEIGHTS = np.linspace(-1.0, 1.0, 2 * _FINER_HEIGHT + 1)


@dataclass(frozen=True)
class LinearPart:
    """Solution of a linear least-squares problem; squares are infinite where columns are not finite."""

    squares: float
    unknowns: Floats


def linear_part(matrix: Floats, target: Floats, low: Floats | None = None, high: Floats | None = None) -> LinearPart:
    """Return the unknowns (k,) that minimise |target - matrix x|^2, with a target (n,) and a matrix (n, k).

    Its columns may differ by many powers of ten in size. With bounds (k,) the unknowns are within these: a quadratic
    programme if the free minimum is not.
    """
    scale = np.sqrt((matrix**2).sum(axis=0))
    if not (np.isfinite(scale).all() and np.isfinite(target).all()):
        return LinearPart(np.inf, np.zeros(len(scale)))
    scale[scale == 0] = 1.0
    scaled_columns = matrix / scale
    unknowns = np.linalg.lstsq(scaled_columns, target, rcond=None)[0] / scale
    if low is not None and high is not None and (np.any(unknowns < low) or np.any(unknowns > high)):
        low_scaled, high_scaled = low * scale, high * scale
        origin = np.clip(0.0, low_scaled, high_scaled)
        slope = -(scaled_columns.T @ (target - scaled_columns @ origin))
        normal_matrix = scaled_columns.T @ scaled_columns + _RIDGE * np.eye(len(scale))
        # Quadratic programme about the point of the bounds that is nearest to 0.
        scaled_unknowns = origin + bounded_quadratic(normal_matrix, slope, low_scaled - origin, high_scaled - origin)
        unknowns = np.clip(scaled_unknowns / scale, low, high)
    residual = target - matrix @ unknowns
    return LinearPart(float(residual @ residual), unknowns)


def best_place(
    squares: Callable[[float, float, int], float], ratios: Floats, heights: Floats, *, held: bool = False
) -> tuple[float, float]:
    """Return the ratio and the height of the least squares: on a grid, then on finer ones about the best place of each.

    `ratios` are a geometric series, `heights` an arithmetic one; heights that are `held` stay. `squares` is the
    function of ratio, height and the number of grids that are still to come.
    """
    factor, width = float(ratios[1] / ratios[0]), 0.0 if held else float(np.ptp(heights)) / (len(heights) - 1)
    best = (float(ratios[0]), float(heights[0]))
    for grids_left in reversed(range(_ROUNDS)):
        places = product(ratios.tolist(), heights.tolist())
        best = min(places, key=lambda place: squares(place[0], place[1], grids_left))
        ratios = best[0] * factor**_RATIOS
        heights = heights[:1] if held else best[1] + width * _HEIGHTS
        factor, width = factor ** (1 / _FINER_RATIO), width / _FINER_HEIGHT
    return best
