"""A body of triangles in its own frame: nearest points, points along a ray, and the patch of surface around each."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_surfaces.surface_patch import SurfacePatch, fit_patches

_FEWEST = 20  # vertices to which a cubic is fitted
_MOST = 300  # of more, every second, third, ... counts
_FACING = 0.5  # cosine between the normals of a point and of what belongs to its side of the body
_ON_AN_EDGE = 1e-7  # of a triangle
_ENOUGH = 64  # vertices, among which so many are on one side
_ASKED = 100  # points whose nearest are looked for at once: far from the body hundreds of triangles count for each
_TOGETHER = 500  # patches that are fitted at once
_MILLIMETRE = 1e-3  # [m]

Faces = NDArray[np.int64]


@dataclass(frozen=True)
class MeshBody:
    """Triangles, of which those within a distance of a point show its normal and curvatures."""

    triangles: Any  # trimesh.Trimesh [m]
    neighbourhood: float  # [m]

    @property
    def middle(self) -> Floats:
        """(3,) [m] of its bounds."""
        return np.asarray(self.triangles.bounds.mean(axis=0))

    @property
    def size(self) -> float:
        """Largest extent [m]."""
        return float(np.ptp(self.triangles.bounds, axis=0).max())

    def nearest(self, points: Floats) -> tuple[Floats, Faces]:
        """Points (n, 3) of the triangles nearest to points (n, 3) [m], and the triangle of each."""
        from trimesh import proximity

        if not len(points):
            return points, np.zeros(0, np.int64)
        closest_point: Any = proximity.closest_point
        feet, faces = np.empty(points.shape), np.empty(len(points), np.int64)
        for begin in range(0, len(points), _ASKED):
            rows = slice(begin, begin + _ASKED)
            feet[rows], _, faces[rows] = closest_point(self._in_millimetres, points[rows] / _MILLIMETRE)
        return feet * _MILLIMETRE, faces

    def first_along(self, origins: Floats, direction: Floats) -> tuple[Floats, Faces]:
        """Where rays from points (n, 3) along a unit vector (3,) first meet a triangle, and which; -1 where none."""
        feet, faces = origins.copy(), np.full(len(origins), -1, np.int64)
        places, rays, hits = self._in_millimetres.ray.intersects_location(
            origins / _MILLIMETRE, np.tile(direction, (len(origins), 1)), multiple_hits=True
        )
        places = places * _MILLIMETRE
        way = (places - origins[rays]) @ direction if len(rays) else np.zeros(0)
        for row in np.argsort(-way, kind="stable"):  # the nearest is written last
            feet[rays[row]], faces[rays[row]] = places[row], hits[row]
        return feet, faces

    def on_the_rim(self, feet: Floats, faces: Faces) -> NDArray[np.bool_]:
        """(n,) whether points (n, 3) of triangles lie on an edge that belongs to one triangle only."""
        from trimesh import triangles

        if not len(feet) or self.triangles.is_watertight:
            return np.zeros(len(feet), bool)
        points_to_barycentric: Any = triangles.points_to_barycentric
        shares = points_to_barycentric(self.triangles.triangles[faces], feet)
        # The edge across from a corner is the one where that corner has no share.
        return np.asarray(((shares < _ON_AN_EDGE) & self._open_edges[faces]).any(axis=1))

    @cached_property
    def _open_edges(self) -> NDArray[np.bool_]:
        """(faces, 3) whether the edge across from each corner belongs to no other triangle."""
        faces = self.triangles.faces
        across = np.sort(np.stack([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]], axis=1))
        _, place, counts = np.unique(across.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
        return np.asarray((counts[place.ravel()] == 1).reshape(-1, 3))

    @cached_property
    def _in_millimetres(self) -> Any:
        """The triangles; trimesh takes squared distances for equal that differ by 1e-8, which are 0.1 mm in metres."""
        import trimesh

        return trimesh.Trimesh(self.triangles.vertices / _MILLIMETRE, self.triangles.faces, process=False)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import KDTree

        return KDTree(self.triangles.vertices)

    def patches(self, feet: Floats, faces: Faces) -> SurfacePatch:
        """Return the patches of surface around points (n, 3) of triangles; those with as many vertices are fitted
        together."""
        outwards, vertices = self._face_normals[faces], np.asarray(self.triangles.vertices)
        near = self._neighbours(feet, outwards)
        counts = np.array([len(rows) for rows in near])
        parts, order = [], []
        for count in np.unique(counts).tolist():
            same = np.flatnonzero(counts == count)
            for some in np.array_split(same, -(-len(same) // _TOGETHER)):
                order.append(some)
                around = vertices[np.array([near[row] for row in some])]
                parts.append(fit_patches(feet[some], outwards[some], around))
        back = np.argsort(np.concatenate(order))
        columns = {one.name: [getattr(part, one.name) for part in parts] for one in fields(SurfacePatch)}
        return SurfacePatch(**{key: np.concatenate(column)[back] for key, column in columns.items()})

    def _neighbours(self, feet: Floats, outwards: Floats) -> list[Faces]:
        """Vertices for the patch around each of the points: those within the distance, or the nearest ones."""
        around = self._tree.query_ball_point(feet, self.neighbourhood, return_sorted=True)
        near = [self._facing(np.array(rows, np.int64), out) for rows, out in zip(around, outwards, strict=True)]
        wanted, most = _FEWEST, len(self.triangles.vertices)
        while wanted < min(_ENOUGH, most) and (few := [row for row, own in enumerate(near) if len(own) < _FEWEST]):
            wanted *= 2
            nearest = self._tree.query(feet[few], min(wanted, most))[1]
            for row, rows in zip(few, nearest, strict=True):
                near[row] = self._facing(rows, outwards[row])[:_FEWEST]
        return [rows[:: -(-len(rows) // _MOST)] for rows in near]

    def _facing(self, rows: Faces, outwards: Floats) -> Faces:
        return np.asarray(rows[self._vertex_normals[rows] @ outwards > _FACING])

    @cached_property
    def _face_normals(self) -> Floats:
        return np.array(self.triangles.face_normals)

    @cached_property
    def _vertex_normals(self) -> Floats:
        return np.array(self.triangles.vertex_normals)
