"""The distance from a surface around a place, to second order: what lies below a tip that moves a little."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from palpate.part_answer import answer_of
from palpate.surface import Surface
from palpate.vectors import Floats, dot_columns, finite_rows

_REACH = 0.5e-3  # [m] across the normal (0294): a third order of 0.05 um on a radius of 20 mm
_TANGENT = 50e-6  # [m] likewise, where the surface is not known all around: a sag of 25 nm on 50 mm
_HIGHER = 0.2  # of the height above it, in air, is reached as well
_STEP = 1e-3  # [m] of the differences between normals: those of a mesh jump where other vertices count
_AROUND = _STEP * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class DistanceExpansion:
    """d(x + s) = d + n.s + s.H s/2, and the normal n + H s, around a place x at the height d over the surface.

    H has the eigenvalues k/(1 + d k) across the normal, k the principal curvatures, and 0 along it; a step along the
    normal changes it by -(n.s) H^2. The default is unknown everywhere. Source: Gilbarg and Trudinger 2001, section
    14.6.
    """

    place: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) [m]
    height: float = 0.0  # [m]
    normal: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # (3,)
    hessian: Floats = field(default_factory=lambda: np.zeros((3, 3)))  # H [1/m]
    curvature: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [1/m] both, and the uncertainty of their mean
    known: float = np.nan  # 1 where the surface is known, else NaN
    reach: float = 0.0  # [m] within which it counts: across the normal, or where nothing is known in any direction

    def reaches(self, places: Floats) -> NDArray[np.bool_]:
        """Return True (n,) for the places (n, 3) [m] at which it counts; one that is not a number asks for no other."""
        shift = places - self.place
        along = dot_columns(shift.T, self.normal)
        if self.known == 1.0:
            aside = dot_columns(shift.T, shift.T) - along * along
            reach = self.reach + _HIGHER * np.maximum(self.height + along, 0.0)
        else:
            aside, reach = dot_columns(shift.T, shift.T), np.full(len(shift), self.reach)
        return np.asarray(~np.isfinite(aside) | ((reach > 0.0) & (aside <= reach * reach)))

    def planes(self, places: Floats) -> Floats:
        """Return (n, 8) below places (n, 3) [m]: normals, heights [m], curvatures [1/m], their uncertainty, `known`."""
        shift = places - self.place
        missing = ~finite_rows(shift)
        shift[missing] = 0.0
        # The parts of a step s along the normal n and across it, and what n changes by: (H - (n.s) H^2) s.
        along = dot_columns(shift.T, self.normal)
        aside = shift - along[:, None] * self.normal
        turned = _rows(self.hessian, aside)
        turned = turned - along[:, None] * _rows(self.hessian, turned)
        normal = self.normal + turned
        columns = np.empty((len(places), 8))
        columns[:, :3] = normal / np.sqrt(dot_columns(normal.T, normal.T))[:, None]
        columns[:, 3] = self.height + along + 0.5 * dot_columns(aside.T, turned.T)  # d + n.s + s.H s/2
        columns[missing, 3] = np.nan
        columns[:, 4:] = (*self.curvature, self.known)
        return columns


def expand_distance(
    surface: Surface, place: Floats, before: DistanceExpansion, radius: float = 0.0
) -> DistanceExpansion:
    """Return the expansion around a place (3,) [m], by central differences of the normals.

    Where the surface ends the plane `before` goes on, unknown. Of the centre of a sphere the height is less by its
    `radius` [m].
    """
    # The place itself, then one step forwards along each axis, then one step backwards.
    points = answer_of(surface, lambda: surface.nearest(place + _AROUND))
    known = finite_rows(points.normal) & np.isfinite(points.height)
    known[list(points.unknown)] = False
    if not known[0]:
        height = before.height + float(dot_columns(place - before.place, before.normal))
        return DistanceExpansion(place, height, before.normal, reach=_TANGENT)
    curvature = (*points.curvature[0].tolist(), float(points.curvature_std[0].mean()))
    expansion = DistanceExpansion(
        place, float(points.height[0]) - radius, points.normal[0], curvature=curvature, known=1.0
    )
    if not known.all():
        return replace(expansion, reach=_TANGENT)
    # H is the derivative of the normal; its symmetric part, for differences are not exactly so.
    slope = (points.normal[1:4] - points.normal[4:]).T / (2 * _STEP)
    return replace(expansion, hessian=(slope + slope.T) / 2, reach=_REACH)


def _rows(matrix: Floats, vectors: Floats) -> Floats:
    """Return a matrix (3, 3) times each of vectors (n, 3), the same bits whatever other rows there are."""
    return np.stack([dot_columns(vectors.T, row) for row in matrix], axis=-1)
