"""Where contact begins on the way down: free air, then a force that rises with a power of the depth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from palpate.vectors import Floats

_GRID = 41  # heights that are tried together
_STEPS = np.arange(float(_GRID))
_LEVELS = 4  # each a twentieth of the one before
_FEWEST = 20  # samples
_MOST = 4000  # samples; more are thinned
_LEAST_SHARE = 2e-3  # of all heights from the surface to the deepest sample; less is not a way down
_LEAST_NOISE = 4.0  # standard deviations of the height: the same
_MOST_WAY = 2e-5  # [m] of a robot, which is a way down however far it has come
_PARTS = 8
_GAIN = 25.0  # of the sum of squares in units of the noise's variance; constant force reaches 15 once in 1000


@dataclass(frozen=True)
class ChangePoint:
    """A two-piece law F = b for z >= z_s, b + c (z_s - z)^1.5 below, fitted by least squares.

    The power is that of a sphere: free, it would cost more scatter than it takes bias of other tips.
    """

    surface: float  # [m] z_s
    offset: float  # [N] b
    rms: float  # [N] of what the law leaves
    rise: float  # [N] of the law, to the deepest sample


def change_point(position: Floats, force: Floats) -> ChangePoint | None:
    """Return the surface in a stretch of samples (n,) [m], [N]; None where a constant force explains them as well.

    For every height, offset and rise follow linearly; the height is searched on a grid that narrows (Golub and Pereyra
    1973). Readings that are not finite are left out.
    """
    known = np.isfinite(position) & np.isfinite(force)
    z, f = (position, force) if known.all() else (position[known], force[known])
    if len(z) < _FEWEST:
        return None
    top, bottom = float(z.max()), float(z.min())
    least = shortest_descent(z, top - bottom)
    if not top - bottom > least:
        return None
    step = -(-len(z) // _MOST)
    z, f = z[::step], f[::step]
    top, bottom = float(z.max()), float(z.min())
    centred = f - f.mean()
    total = float((centred**2).sum())
    best, count, held, pulls = (total, top), len(z), z, centred
    low, high = bottom, top
    for _ in range(_LEVELS):
        heights = _STEPS * ((high - low) / (_GRID - 1)) + low
        heights[-1] = high
        below = held < high  # the law does not hold for the others, whatever the height
        held, pulls = held[below], pulls[below]
        sums = _left(held, pulls, count, total, heights)
        at = int(np.argmin(sums))
        best = min(best, (float(sums[at]), float(heights[at])))
        low, high = float(heights[max(at - 1, 0)]), float(heights[min(at + 1, _GRID - 1)])
    left, surface = best
    noise = max(left, 0.0) / (count - 3)  # rounding leaves less than nothing of a law without noise
    shape = np.maximum(surface - z, 0.0)
    shape *= np.sqrt(shape)
    spread = float(((shape - shape.mean()) ** 2).sum())
    slope = float((shape * centred).sum()) / spread if spread > 0 else 0.0
    offset = float(f.mean()) - slope * float(shape.mean())
    if surface - bottom < least or total - left <= _GAIN * noise * samples_as_one(f - offset - slope * shape):
        return None
    return ChangePoint(surface, offset, float(np.sqrt(noise)), slope * float(shape.max()))


def shortest_descent(height: Floats, reach: float) -> float:
    """Way [m] below which heights (n,) that cover a reach [m] do not go down: by their noise, and by their reach."""
    return min(max(_LEAST_SHARE * reach, _LEAST_NOISE * white_noise(height)), _MOST_WAY)


def white_noise(values: Floats) -> float:
    """Standard deviation of white noise that would give the third differences of values (n,), n > 3."""
    third = values[3:] - values[:-3] - 3.0 * (values[2:-1] - values[1:-2])
    return float(np.sqrt(np.mean(third * third) / 20.0))


def samples_as_one(residual: Floats, parts: int = _PARTS) -> float:
    """Return how many samples count as one, from the scatter of the means of parts, of eighths; at least 1."""
    edges, sizes = even_parts(len(residual), parts)
    means = np.add.reduceat(residual, edges) / sizes
    variance = float(residual @ residual) / len(residual)
    return max(float(means @ means) / parts * len(residual) / parts / variance, 1.0) if variance > 0 else 1.0


@lru_cache(64)
def even_parts(count: int, parts: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where parts of equal length begin, the first ones longer by one, and how long they are: of `count` samples."""
    each, longer = divmod(count, parts)
    edges = each * np.arange(parts + 1) + np.minimum(np.arange(parts + 1), longer)
    return edges[:-1], np.diff(edges)


def _left(z: Floats, centred: Floats, count: int, total: float, heights: Floats) -> Floats:
    """Sum of squares that is left (k,) for every height; the total where the force would fall with depth.

    Of `count` samples, those that are below any of the heights.
    """
    shape = heights[:, None] - z
    np.maximum(shape, 0.0, out=shape)
    shape *= np.sqrt(shape)
    # `centred` has no mean, so that none need be taken from the shape for their product.
    square = np.einsum("ij,ij->i", shape, shape) - shape.sum(axis=1) ** 2 / count
    product = shape @ centred
    rises = (square > 0) & (product > 0)
    return np.asarray(total - np.where(rises, product**2 / np.where(rises, square, 1.0), 0.0))
