"""Relief: what a skin that is not flat adds to the scatter of a track which takes it for flat."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate_maps.path_reader import Path2D

_WIDTH = 4e-3  # [m] of the pieces between which the skin's slope is taken
_FEWEST = 5  # samples of a piece
_LONGEST = 3.0  # median intervals; a longer one ends a line


def relief_scatter(path: Path2D, standing: NDArray[np.bool_]) -> float:
    """Standard deviation of a parameter along the way, relative, due to the skin's slopes; 0 where none is given.

    An estimator that gives its sensitivity [s/m] takes the tip's velocity for that of the depth, so that a slope s
    under a tip that goes v sideways is a velocity s v that nothing explains but another stiffness. Its surface, height
    and depth together, follows the skin nevertheless, and shows s: the slope between pieces of 4 mm.
    """
    if path.surface is None or not path.relief_sensitivity or not (~standing).any():
        return 0.0
    moving = np.flatnonzero(~standing & np.isfinite(path.surface))
    if not len(moving):
        return 0.0
    time, place, surface = path.time[moving], path.place[moving], path.surface[moving]
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    lines = np.r_[0, np.flatnonzero(np.diff(time) > _LONGEST * usual) + 1, len(time)]
    speeds: list[float] = []
    for first, last in pairwise(lines.tolist()):
        way = np.hypot(*(place[first:last] - place[first]).T)
        piece = np.floor(way / _WIDTH).astype(int)
        count = np.maximum(np.bincount(piece), 1)
        enough = np.bincount(piece) >= _FEWEST
        height, when = (np.bincount(piece, v[first:last]) / count for v in (surface, time))
        found = (np.diff(height[enough]) / np.maximum(np.diff(when[enough]), usual)).tolist()
        speeds += found
    return path.relief_sensitivity * float(np.std(speeds)) if len(speeds) > 1 else 0.0
