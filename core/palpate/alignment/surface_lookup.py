"""The surface below the tip, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.part_failure import answer_of
from palpate.surface import Surface
from palpate.vectors import Floats

_BLOCK = 64  # places that are asked for at once, always: the bits of an answer may depend on how many there are


@dataclass(frozen=True)
class LocalPlanes:
    """Planes of the surface below places: normals (n, 3), heights (n,) [m] above it, mean curvatures (n,) [1/m]."""

    normal: Floats
    height: Floats
    curvature: Floats
    known: Floats  # (n,) 1 where the surface is known, else NaN

    def __getitem__(self, rows: slice) -> LocalPlanes:
        return LocalPlanes(self.normal[rows], self.height[rows], self.curvature[rows], self.known[rows])


class SurfaceLookup:
    """Asks a surface for places in their order; where it is not known the plane before goes on, and no force counts."""

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self._before = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # foot and normal, the latest that is known

    def planes(self, first: int, place: Floats) -> LocalPlanes:
        """Of places (n, 3) [m], the first of which is that of so many samples before it."""
        columns = np.full((len(place), 9), np.nan)  # foot, normal, height, curvature, known
        blocks = (first + np.arange(len(place))) // _BLOCK
        for block in np.unique(blocks).tolist():
            rows = np.flatnonzero(blocks == block)
            columns[rows] = self._asked(first + rows - block * _BLOCK, place[rows])
        return self._with_gaps(columns, place)

    def _asked(self, slots: Floats, place: Floats) -> Floats:
        """Columns (n, 9) of places in the given slots of a block."""
        found = np.full((len(place), 9), np.nan)
        usable = np.isfinite(place).all(axis=1)
        if not usable.any():
            return found
        block = np.tile(place[usable][0], (_BLOCK, 1))
        block[slots[usable]] = place[usable]
        points = answer_of(self._surface, lambda: self._surface.nearest(block))
        curvature = points.curvature.mean(axis=1)
        values = np.column_stack([points.position, points.normal, points.height, curvature, np.ones(_BLOCK)])
        unknown = [slot for slot in points.unknown if 0 <= slot < _BLOCK]
        values[unknown] = np.nan
        found[usable] = values[slots[usable]]
        found[~np.isfinite(found).all(axis=1)] = np.nan
        return found

    def _with_gaps(self, columns: Floats, place: Floats) -> LocalPlanes:
        for i in np.flatnonzero(np.isnan(columns[:, 8])).tolist():
            foot, normal = np.split(self._before if i == 0 else columns[i - 1, :6], 2)
            away = place[i] - foot
            height = float(away[0] * normal[0] + away[1] * normal[1] + away[2] * normal[2])
            columns[i, :8] = (*foot, *normal, height, 0.0)
        if len(columns) > 1:  # the last one is asked for once more, as the first of what comes next
            self._before = columns[-2, :6].copy()
        return LocalPlanes(columns[:, 3:6], columns[:, 6], columns[:, 7], columns[:, 8])
