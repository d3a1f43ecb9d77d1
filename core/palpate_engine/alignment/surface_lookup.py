"""The surface below the tip, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate.surface import Surface
from palpate.vectors import Floats

from palpate_engine.alignment.distance_expansion import DistanceExpansion, expand_distance

_BLOCK = 1000  # places that are compared with the reach at once: a choice, which trades memory for calls
_NORMAL, _HEIGHT, _CURVATURE = slice(0, 3), 3, slice(4, 6)  # columns of the planes of a `DistanceExpansion`
_CURVATURE_STD, _KNOWN, _COLUMNS = 6, 7, 8


@dataclass(frozen=True)
class LocalPlanes:
    """Planes of the surface below places: normals (n, 3), heights (n,) [m] above it, principal curvatures [1/m]."""

    normal: Floats
    height: Floats
    curvature: Floats  # (n, 2)
    curvature_std: Floats  # (n,) of their mean, both off together
    known: Floats  # (n,) 1 where the surface is known, else NaN

    def __getitem__(self, rows: slice) -> LocalPlanes:
        columns = self.normal, self.height, self.curvature, self.curvature_std, self.known
        return LocalPlanes(*(column[rows] for column in columns))


class SurfaceLookup:
    """Asks a surface for places in their order, whenever the tip has left the reach of the last answer.

    So a sample's plane does not depend on how a record is cut, and a mesh is asked once for a press and not 500 times a
    second. Where a surface is not known the plane before goes on, and no force counts. Places are centres of a sphere
    of a `radius` [m], and heights those of its surface.
    """

    def __init__(self, surface: Surface, radius: float = 0.0) -> None:
        self._surface, self._radius = surface, radius
        self._last = DistanceExpansion()

    def planes(self, place: Floats, count: int) -> LocalPlanes:
        """Return the planes below places (n, 3) [m].

        Those after the first `count` are asked for again, as the first ones of the next block.
        """
        columns, row, last = np.empty((len(place), _COLUMNS)), 0, self._last
        while row < len(place):
            length = _length(last.reaches(place[row : row + _BLOCK]))
            if length == 0:  # where it is expanded it reaches
                last = expand_distance(self._surface, place[row], last, self._radius)
                continue
            columns[row : row + length] = last.planes(place[row : row + length])
            if row < count <= row + length:
                self._last = last
            row += length
        curvature_std, known = columns[:, _CURVATURE_STD], columns[:, _KNOWN]
        return LocalPlanes(
            normal=columns[:, _NORMAL],
            height=columns[:, _HEIGHT],
            curvature=columns[:, _CURVATURE],
            curvature_std=curvature_std,
            known=known,
        )


def _length(reached: NDArray[np.bool_]) -> int:
    """Return how many of the first are true."""
    return len(reached) if reached.all() else int(np.argmin(reached))
