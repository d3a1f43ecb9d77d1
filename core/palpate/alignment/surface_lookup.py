"""The surface below the tip, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.part_answer import answer_of
from palpate.surface import Surface
from palpate.vectors import Floats

_ASIDE = 50e-6  # [m] across the normal within which the plane that was found counts: a sag of 25 nm on 50 mm
_HIGHER = 0.2  # of the height above it, in air, likewise


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


@dataclass(frozen=True)
class _TangentPlane:
    foot: tuple[float, ...] = (0.0, 0.0, 0.0)
    normal: tuple[float, ...] = (0.0, 0.0, 1.0)
    curvature: tuple[float, ...] = (0.0, 0.0, 0.0)  # both, and the uncertainty of their mean
    known: float = np.nan

    def height(self, place: tuple[float, ...]) -> tuple[float, float]:
        """Height [m] of a place above it, and the square of how far aside of the foot that is [m^2]."""
        away = [x - f for x, f in zip(place, self.foot, strict=True)]
        height = sum(x * n for x, n in zip(away, self.normal, strict=True))
        return height, sum(x * x for x in away) - height * height


class SurfaceLookup:
    """Asks a surface for places in their order, one by one, whenever the tip has gone aside of the last one.

    So a sample's plane does not depend on how a record is cut, and a mesh is asked once for a press and not 500 times a
    second. Where a surface is not known the plane before goes on, and no force counts.
    """

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self._plane = _TangentPlane()

    def planes(self, place: Floats, count: int) -> LocalPlanes:
        """Below places (n, 3) [m]; those after the first `count` are asked for again, as the first ones of the next."""
        columns, kept = np.empty((len(place), 8)), self._plane
        for i, where in enumerate(map(tuple, place.tolist())):
            self._plane = self._below(where)
            plane = self._plane
            columns[i] = (*plane.normal, plane.height(where)[0], *plane.curvature, plane.known)
            if i == count - 1:
                kept = plane
        self._plane = kept
        return LocalPlanes(columns[:, :3], columns[:, 3], columns[:, 4:6], columns[:, 6], columns[:, 7])

    def _below(self, place: tuple[float, ...]) -> _TangentPlane:
        plane = self._plane
        if not all(np.isfinite(place)):
            return plane
        height, aside = plane.height(place)
        if plane.known == 1.0 and aside <= (_ASIDE + _HIGHER * max(height, 0.0)) ** 2:
            return plane
        points = answer_of(self._surface, lambda: self._surface.nearest(np.array([place])))
        if points.unknown or not np.isfinite(points.normal).all() or not np.isfinite(points.position).all():
            return _TangentPlane(plane.foot, plane.normal)
        foot, normal = points.position[0].tolist(), points.normal[0].tolist()
        curvature = (*points.curvature[0].tolist(), float(points.curvature_std[0].mean()))
        return _TangentPlane(tuple(foot), tuple(normal), curvature, 1.0)
