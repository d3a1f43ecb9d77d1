"""The change point of a way down: free air, then a force that rises with a power of the depth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from palpate.vectors import Floats

# The search for the height (choices): each level spans two steps of the grid of the level before, so that four levels
# resolve 3e-6 of the way.
_GRID_SIZE = 41  # heights that are tried together
_GRID_INDEX = np.arange(float(_GRID_SIZE))  # (41,) 0 to 40
_GRID_LEVELS = 4  # grids, one within the other
_MIN_SAMPLES = 20  # for the three unknowns of the law; a choice
_MAX_SAMPLES = 4000  # a choice: more are thinned
_UNKNOWNS = 3  # of the law: offset, slope and height
_THIRD_DIFFERENCE = 20.0  # variance of third differences of white noise of variance 1: 1 + 9 + 9 + 1
# Contact has to begin so far above the deepest sample: by the range of the heights and by their noise, but never
# farther than a depth that suffices for any robot. Choices.
_MIN_DESCENT = 2e-3  # of the range of the heights
_MIN_DESCENT_NOISE = 4.0  # standard deviations of the height
_SUFFICIENT_DESCENT = 2e-5  # [m] which is a way down whatever the range
_EIGHTHS = 8  # parts of a residual, whose means show what is not white; a choice
_MIN_GAIN = 25.0  # decrease of the sum of squares over the noise's variance; constant force reaches 15 once in 1000


@dataclass(frozen=True)
class ChangePoint:
    """A two-piece law F = b for z >= z_s, b + c (z_s - z)^1.5 below, fitted by least squares.

    The power is that of a sphere: free, it would cost more scatter than it takes bias of other tips (decision 0104).
    """

    surface: float  # [m] z_s
    offset: float  # [N] b
    rms: float  # [N] of the residual
    rise: float  # [N] of the law, to the deepest sample


def change_point(position: Floats, force: Floats) -> ChangePoint | None:
    """Return the surface in a stretch of samples (n,) [m], [N]; None where a constant force explains them as well.

    For every height, offset and slope follow linearly; the height is searched on a grid that narrows (Golub and Pereyra
    1973). Readings that are not finite are left out.
    """
    finite = np.isfinite(position) & np.isfinite(force)
    z, f = (position, force) if finite.all() else (position[finite], force[finite])
    if len(z) < _MIN_SAMPLES:
        return None
    height_range = float(z.max()) - float(z.min())
    min_descent = shortest_descent(z, height_range)
    if not height_range > min_descent:
        return None
    stride = -(-len(z) // _MAX_SAMPLES)  # rounded up: at most so many samples remain
    z, f = z[::stride], f[::stride]

    # The height whose law leaves the least sum of squares; where none leaves less than a constant, the highest.
    centred = f - f.mean()
    constant_cost = float((centred**2).sum())
    cost, surface = _best_height(z, centred, constant_cost)
    bottom = float(z.min())

    # Offset and slope at this height, by linear regression on its shape.
    # Rounding may make the cost of a record without noise negative; the law has three unknowns.
    variance = max(cost, 0.0) / (len(z) - _UNKNOWNS)
    shape = np.maximum(surface - z, 0.0)
    shape *= np.sqrt(shape)  # (z_s - z)^1.5
    shape_square = float(((shape - shape.mean()) ** 2).sum())
    slope = float((shape * centred).sum()) / shape_square if shape_square > 0 else 0.0
    offset = float(f.mean()) - slope * float(shape.mean())

    # Contact explains what a constant does not, by far more than noise that is not white.
    is_deep = surface - bottom >= min_descent
    noise_gain = _MIN_GAIN * variance * samples_as_one(f - offset - slope * shape)
    if not is_deep or constant_cost - cost <= noise_gain:
        return None
    return ChangePoint(surface, offset, float(np.sqrt(variance)), slope * float(shape.max()))


def _best_height(z: Floats, centred: Floats, constant_cost: float) -> tuple[float, float]:
    """Return the height [m] of the law F = b + c (z_s - z)^1.5 that fits best: its sum of squares [N^2], then z_s.

    Of heights z (n,) [m] and forces less their mean (n,) [N]; `constant_cost` [N^2] is the sum of squares of a constant
    force, which is the law with z_s at the lowest sample. Where no height has a smaller one, the highest is returned;
    of equal ones the lowest height.
    """
    count = len(z)  # of all samples, of which `z` loses those in air
    low, high = float(z.min()), float(z.max())
    best = (constant_cost, high)
    for _ in range(_GRID_LEVELS):
        heights = _GRID_INDEX * ((high - low) / (_GRID_SIZE - 1)) + low
        heights[-1] = high
        # Samples above the highest of these heights are in air, whichever it is: their shape is zero.
        below = z < high
        z, centred = z[below], centred[below]
        costs = _costs(z, centred, count, constant_cost, heights)
        best_row = int(np.argmin(costs))
        best = min(best, (float(costs[best_row]), float(heights[best_row])))  # pairs: of equal costs the lower height
        # The next grid spans the steps on both sides of the least.
        low, high = float(heights[max(best_row - 1, 0)]), float(heights[min(best_row + 1, _GRID_SIZE - 1)])
    return best


def _costs(z: Floats, centred: Floats, count: int, constant_cost: float, heights: Floats) -> Floats:
    """Return the sum of squares (k,) [N2] of the law at every height; that of a constant where the slope is negative.

    Of `count` samples, `z` and `centred` are those below any of the heights. With the shape s and the centred force f,
    the slope is s.f / |s - mean s|^2, and the decrease of the sum of squares (s.f)^2 / |s - mean s|^2.
    """
    shape = heights[:, None] - z
    np.maximum(shape, 0.0, out=shape)
    shape *= np.sqrt(shape)
    # The mean of the shape drops out of s.f, as the sum of the centred force is zero.
    shape_square = np.einsum("ij,ij->i", shape, shape) - shape.sum(axis=1) ** 2 / count
    product = shape @ centred
    is_positive = (shape_square > 0) & (product > 0)
    decrease = np.where(is_positive, product**2 / np.where(is_positive, shape_square, 1.0), 0.0)
    return np.asarray(constant_cost - decrease)


def shortest_descent(height: Floats, height_range: float) -> float:
    """Return the way [m] below which heights (n,) of a range [m] do not go down, by their noise and by their range."""
    return min(max(_MIN_DESCENT * height_range, _MIN_DESCENT_NOISE * white_noise(height)), _SUFFICIENT_DESCENT)


def white_noise(values: Floats) -> float:
    """Return the standard deviation of white noise that would give the third differences of values (n,), n > 3.

    The third difference has the variance (1 + 9 + 9 + 1) sigma^2 = 20 sigma^2; any parabola drops out of it.
    """
    third = values[3:] - values[:-3] - 3.0 * (values[2:-1] - values[1:-2])
    return float(np.sqrt(np.mean(third * third) / _THIRD_DIFFERENCE))


def samples_as_one(residual: Floats, parts: int = _EIGHTHS) -> float:
    """Return how many samples count as one: the variance of the means of equal parts over that of white noise, >= 1."""
    edges, sizes = even_parts(len(residual), parts)
    means = np.add.reduceat(residual, edges) / sizes
    variance = float(residual @ residual) / len(residual)
    return max(float(means @ means) / parts * len(residual) / parts / variance, 1.0) if variance > 0 else 1.0


@lru_cache(64)
def even_parts(count: int, parts: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return first index and length of each of the equal parts of `count` samples, the first ones longer by one."""
    length, longer_count = divmod(count, parts)
    edges = length * np.arange(parts + 1) + np.minimum(np.arange(parts + 1), longer_count)
    return edges[:-1], np.diff(edges)
