"""Relief: what a skin that is not flat adds to the scatter of a track which takes it for flat."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.path_reader import Path2D

_PIECE = 4e-3  # [m] of the way, between which the skin's slope is taken: the width of a site
_MIN_SAMPLES = 5  # of a piece: a choice
_MAX_INTERVALS = 3.0  # median intervals between samples; a longer one ends a line: a choice


def relief_scatter(path: Path2D, standing: NDArray[np.bool_]) -> float:
    """Return the relative standard deviation of a parameter along the way by the skin's slopes; 0 without any.

    `path` has the estimates by time [s] and place [m]. `standing` (n,) is True for the estimates at which the tip stood
    still. An estimator that gives its sensitivity [s/m] takes the tip's velocity for that of the depth, so that a slope
    s under a tip that goes v sideways is a velocity s v that nothing explains but another stiffness. Its surface,
    height and depth together, follows the skin nevertheless, and shows s: the slope between pieces of 4 mm.
    """
    if path.surface is None or not path.relief_sensitivity or not (~standing).any():
        return 0.0
    moving = np.flatnonzero(~standing & np.isfinite(path.surface))
    if not len(moving):
        return 0.0
    time, place, surface = path.time[moving], path.place[moving], path.surface[moving]
    interval = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    lines = np.r_[0, np.flatnonzero(np.diff(time) > _MAX_INTERVALS * interval) + 1, len(time)]
    speeds: list[float] = []
    for first, last in pairwise(lines.tolist()):
        line = slice(first, last)
        speeds += _rising_speeds(time[line], place[line], surface[line], interval)
    return path.relief_sensitivity * float(np.std(speeds)) if len(speeds) > 1 else 0.0


def _rising_speeds(time: Floats, place: Floats, surface: Floats, interval: float) -> list[float]:
    """Return the speeds [m/s] at which the skin rises below a line, from each piece of its way to the next.

    Of mean heights over mean times of the pieces; `interval` [s] is the least time between them.
    """
    way = np.hypot(*(place - place[0]).T)
    piece = np.floor(way / _PIECE).astype(int)
    samples = np.bincount(piece)
    count = np.maximum(samples, 1)
    # Pieces of few samples, at the ends of the line, are left out.
    enough = samples >= _MIN_SAMPLES
    height = (np.bincount(piece, surface) / count)[enough]
    middle = (np.bincount(piece, time) / count)[enough]
    speeds: list[float] = (np.diff(height) / np.maximum(np.diff(middle), interval)).tolist()
    return speeds
