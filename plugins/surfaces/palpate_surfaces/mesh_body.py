"""A body of triangles in its own frame: nearest points, points along a ray, and the patch of surface around each."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_surfaces.surface_patch import SurfacePatch, fit_patches

# Choices.
_MIN_VERTICES = 20  # to which a cubic of 10 coefficients is fitted
_MAX_VERTICES = 300  # of more, every second, third, ... counts
_MIN_FACING_COSINE = 0.5  # between the normals of a point and of a vertex on its side of the body
_EDGE_SHARE = 1e-7  # barycentric coordinate below which a point lies on an edge
_MAX_SEARCHED = 64  # nearest vertices, among which those of one side are searched
_POINTS_AT_ONCE = 100  # that are searched together: far from the body hundreds of triangles count for each
_PATCHES_AT_ONCE = 500  # that are fitted together
_MILLIMETRE = 1e-3  # [m]

Faces = NDArray[np.int64]


@dataclass(frozen=True)
class MeshBody:
    """Triangles, with the normal and curvatures of the vertices within a distance of a point."""

    triangles: Any  # trimesh.Trimesh [m]
    neighbourhood: float  # [m]

    @property
    def middle(self) -> Floats:
        """Middle (3,) [m] of the bounds."""
        return np.asarray(self.triangles.bounds.mean(axis=0))

    @property
    def size(self) -> float:
        """Largest extent [m]."""
        return float(np.ptp(self.triangles.bounds, axis=0).max())

    def nearest(self, points: Floats) -> tuple[Floats, Faces]:
        """Return the points (n, 3) of the triangles nearest to points (n, 3) [m], and the triangle of each."""
        from trimesh import proximity

        if not len(points):
            return points, np.zeros(0, np.int64)
        closest_point: Any = proximity.closest_point
        feet, faces = np.empty(points.shape), np.empty(len(points), np.int64)
        for first in range(0, len(points), _POINTS_AT_ONCE):
            rows = slice(first, first + _POINTS_AT_ONCE)
            feet[rows], _, faces[rows] = closest_point(self._in_millimetres, points[rows] / _MILLIMETRE)
        return feet * _MILLIMETRE, faces

    def first_along(self, origins: Floats, direction: Floats) -> tuple[Floats, Faces]:
        """Return the points (n, 3) where rays from origins (n, 3) [m] first meet a triangle, and the triangles (n,).

        `direction` is a unit vector (3,). A ray that meets none has its origin and -1.
        """
        feet, faces = origins.copy(), np.full(len(origins), -1, np.int64)
        hits, rays, hit_faces = self._in_millimetres.ray.intersects_location(
            origins / _MILLIMETRE, np.tile(direction, (len(origins), 1)), multiple_hits=True
        )
        hits = hits * _MILLIMETRE
        distances = (hits - origins[rays]) @ direction if len(rays) else np.zeros(0)
        for hit in np.argsort(-distances, kind="stable"):  # the nearest of a ray is written last
            feet[rays[hit]], faces[rays[hit]] = hits[hit], hit_faces[hit]
        return feet, faces

    def on_the_rim(self, feet: Floats, faces: Faces) -> NDArray[np.bool_]:
        """Return True (n,) for points (n, 3) of triangles (n,) on an edge that belongs to one triangle only."""
        from trimesh import triangles

        if not len(feet) or self.triangles.is_watertight:
            return np.zeros(len(feet), bool)
        points_to_barycentric: Any = triangles.points_to_barycentric
        shares = points_to_barycentric(self.triangles.triangles[faces], feet)
        # On the edge opposite to a corner that corner has no share.
        return np.asarray(((shares < _EDGE_SHARE) & self._open_edges[faces]).any(axis=1))

    @cached_property
    def _open_edges(self) -> NDArray[np.bool_]:
        """(faces, 3) True where the edge opposite to a corner belongs to no other triangle."""
        faces = self.triangles.faces
        edges = np.sort(np.stack([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]], axis=1))
        _, edge_index, counts = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
        return np.asarray((counts[edge_index.ravel()] == 1).reshape(-1, 3))

    @cached_property
    def _in_millimetres(self) -> Any:
        """The triangles; trimesh takes squared distances for equal that differ by 1e-8, which are 0.1 mm in metres."""
        import trimesh

        return trimesh.Trimesh(self.triangles.vertices / _MILLIMETRE, self.triangles.faces, process=False)

    @cached_property
    def _vertex_tree(self) -> Any:
        """The vertices as scipy's KDTree."""
        from scipy.spatial import KDTree

        return KDTree(self.triangles.vertices)

    def patches(self, feet: Floats, faces: Faces) -> SurfacePatch:
        """Return the patches of surface around points (n, 3) of triangles (n,).

        Those with as many vertices are fitted together, in parts of limited size.
        """
        outwards, vertices = self._face_normals[faces], np.asarray(self.triangles.vertices)
        neighbours = self._neighbours(feet, outwards)
        counts = np.array([len(rows) for rows in neighbours])
        parts, order = [], []
        for count in np.unique(counts).tolist():
            equal_rows = np.flatnonzero(counts == count)
            for rows in np.array_split(equal_rows, _ceil_ratio(len(equal_rows), _PATCHES_AT_ONCE)):
                order.append(rows)
                neighbour_vertices = vertices[np.array([neighbours[row] for row in rows])]
                parts.append(fit_patches(feet[rows], outwards[rows], neighbour_vertices))
        # Back in the order of the points.
        inverse_order = np.argsort(np.concatenate(order))
        names = [field.name for field in fields(SurfacePatch)]
        return SurfacePatch(
            **{name: np.concatenate([getattr(part, name) for part in parts])[inverse_order] for name in names}
        )

    def _neighbours(self, feet: Floats, outwards: Floats) -> list[Faces]:
        """Return the vertices for the patch around each point (n, 3): those within the distance, or the nearest ones.

        Only vertices count whose normals look to the side of a point's, `outwards` (n, 3). Where fewer than 20 are
        within the distance, twice as many nearest ones are searched, and again, up to 64.
        """
        nearby = self._vertex_tree.query_ball_point(feet, self.neighbourhood, return_sorted=True)
        neighbours = [
            self._facing(np.array(rows, np.int64), normal) for rows, normal in zip(nearby, outwards, strict=True)
        ]
        searched, vertex_count = _MIN_VERTICES, len(self.triangles.vertices)
        while searched < min(_MAX_SEARCHED, vertex_count):
            sparse = [row for row, vertices in enumerate(neighbours) if len(vertices) < _MIN_VERTICES]
            if not sparse:
                break
            searched *= 2
            nearest = self._vertex_tree.query(feet[sparse], min(searched, vertex_count))[1]
            for row, vertices in zip(sparse, nearest, strict=True):
                neighbours[row] = self._facing(vertices, outwards[row])[:_MIN_VERTICES]
        return [vertices[:: _ceil_ratio(len(vertices), _MAX_VERTICES)] for vertices in neighbours]

    def _facing(self, vertices: Faces, normal: Floats) -> Faces:
        """Return those of vertices (m,) whose normals look to the side of a normal (3,)."""
        return np.asarray(vertices[self._vertex_normals[vertices] @ normal > _MIN_FACING_COSINE])

    @cached_property
    def _face_normals(self) -> Floats:
        return np.array(self.triangles.face_normals)

    @cached_property
    def _vertex_normals(self) -> Floats:
        return np.array(self.triangles.vertex_normals)


def _ceil_ratio(count: int, size: int) -> int:
    """Return how many parts of at most `size` a count needs."""
    return -(-count // size)
