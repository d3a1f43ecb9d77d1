"""The mesh: a skin of triangles, scanned or designed, at a pose that touches have registered."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import numpy as np
from palpate import Angle, Depth, Floats, InputFile, Length, Surface, SurfacePoints
from pydantic import Field, model_validator

from palpate_surfaces.mesh_body import Faces, MeshBody
from palpate_surfaces.mesh_file import read_mesh
from palpate_surfaces.pose import UncertainPose
from palpate_surfaces.registration_file import file_digest, read_registration

# Choices.
_MIN_UPWARD_COSINE = math.cos(math.radians(60.0))  # between z and the mean normal of an open mesh
_MIN_NORMAL_Z = math.cos(math.radians(80.0))  # of a point that is looked at from above
_REFINEMENTS = 2  # of a point from above, as the smooth surface lies off the triangles


class Mesh(Surface):
    """A surface of triangles in a file, in a frame of its own, that stands at a pose in the work frame.

    The body's point x' is at R x' + t. Below a place lies the nearest point of the triangles; the surface there, its
    normal and its curvatures are those of a cubic fitted to the vertices around it, so that they are smooth where the
    body is, and the scatter of the vertices is in the uncertainty. The pose is uncertain by its covariance: that of
    `registration`, which `palpate calibrate surface` writes, or what is stated. A mesh is refused that has holes,
    separate pieces, triangles that are turned inwards, or the size of no specimen; one with a single open rim ends
    there.
    """

    file: InputFile = Field(description="mesh: STL, PLY or OBJ")
    unit: Literal["m", "cm", "mm", "um"] = Field(default="mm", description="unit of the file's coordinates")
    position: tuple[Length, Length, Length] = Field(
        default=(0.0, 0.0, 0.0), description="origin t of the mesh's frame in the work frame"
    )
    rotation: tuple[Angle, Angle, Angle] = Field(
        default=(0.0, 0.0, 0.0), description="rotation vector of R, from the mesh's frame to the work frame"
    )
    position_uncertainty: Length = Field(
        default=0.01, gt=0, description="standard uncertainty of the stated position, in each direction"
    )
    rotation_uncertainty: Angle = Field(
        default=math.radians(10.0), gt=0, description="standard uncertainty of the stated rotation, about each axis"
    )
    registration: InputFile | None = Field(
        default=None, description="registered pose with its covariance, in place of the four keys above"
    )
    shape_uncertainty: Depth = Field(
        default=0.2e-3, ge=0, description="standard uncertainty of the body's shape against the mesh, along the normal"
    )
    neighbourhood: Depth = Field(
        default=0.005, gt=0, description="distance within which vertices count for normal and curvatures"
    )

    @model_validator(mode="after")
    def _check_outwards(self) -> Any:
        """Raise ValueError for a mesh whose normals point inwards, or an open one that does not look along z."""
        triangles = self.body.triangles
        if triangles.is_watertight:
            if triangles.volume < 0:
                raise ValueError(
                    f"{self.file}: its normals point inwards (a volume of {1e6 * triangles.volume:.3g} cm^3)"
                )
            return self
        normal_sum = self.pose.matrix @ (triangles.face_normals * triangles.area_faces[:, None]).sum(axis=0)
        if normal_sum[2] < _MIN_UPWARD_COSINE * float(np.linalg.norm(normal_sum)):
            axis = int(np.argmax(np.abs(normal_sum)))
            direction = f"{'-' if normal_sum[axis] < 0 else ''}{'xyz'[axis]}"
            look = f"look along {direction} of the work frame, whose z is out of the"
            if direction == "-z":
                reason = f"normals point inwards: on average they {look} material; turn the triangles round, or state"
            else:
                reason = f"normals {look} material, on average: is it y-up, or mirrored? State"
            raise ValueError(f"{self.file}: its {reason} the rotation")
        return self

    @cached_property
    def body(self) -> MeshBody:
        """The triangles in their own frame."""
        return MeshBody(read_mesh(self.file, self.unit), self.neighbourhood)

    @cached_property
    def pose(self) -> UncertainPose:
        """Pose of the body in the work frame, registered or stated, with its covariance."""
        if self.registration is not None:
            return read_registration(self.registration, file_digest(self.file)).pose
        rotation, translation = np.array(self.rotation), np.array(self.position)
        variances = np.repeat([self.position_uncertainty**2, self.rotation_uncertainty**2], 3)
        without_pivot = UncertainPose(rotation, translation, np.zeros(3), np.eye(6))
        pivot = without_pivot.outwards(self.body.middle[None])[0]
        return UncertainPose(rotation, translation, pivot, np.diag(variances))

    def nearest(self, places: Floats) -> SurfacePoints:
        """Return the points of the triangles nearest to places (n, 3) [m]."""
        feet, faces = self.body.nearest(self.pose.inwards(places))
        beyond_rim = np.flatnonzero(self.body.on_the_rim(feet, faces))
        unknown = {int(row): "beyond the rim of the mesh" for row in beyond_rim}
        return mesh_points(self.pose, self, places, feet, faces, unknown)

    def _nearest_known(self, places: Floats, unknown: dict[int, str]) -> SurfacePoints:
        """Return the points nearest to places (n, 3) [m], except in rows that are unknown already."""
        feet, faces = self.body.nearest(self.pose.inwards(places))
        return mesh_points(self.pose, self, places, feet, faces, unknown)

    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Return the points of the triangles at x and y (n, 2) [m], looked at from above."""
        # Rays downwards, from above the whole body.
        start_height = float(self.pose.outwards(self.body.triangles.vertices)[:, 2].max()) + self.body.size
        starts = self.pose.inwards(np.column_stack([lateral, np.full(len(lateral), start_height)]))
        downwards = self.pose.matrix.T @ [0.0, 0.0, -1.0]
        feet, faces = self.body.first_along(starts, downwards)
        unknown = {int(row): "no mesh at this x and y" for row in np.flatnonzero(faces < 0)}
        # The smooth surface lies off the triangles, within which it curves.
        places = self.pose.outwards(feet)
        for _ in range(_REFINEMENTS):
            points = self._nearest_known(places, unknown)
            places[:, 2] -= np.nan_to_num(points.height / points.normal[:, 2])
        points = self._nearest_known(places, unknown)
        steep_rows = np.flatnonzero(points.normal[:, 2] < _MIN_NORMAL_Z)
        return points.without(
            {int(row): "the mesh is too steep there to be looked at from above" for row in steep_rows}
        )


def mesh_points(
    pose: UncertainPose, mesh: Mesh, places: Floats, feet: Floats, faces: Faces, unknown: dict[int, str]
) -> SurfacePoints:
    """Return the surface of a mesh at a pose around feet (n, 3) on its triangles (n,), with heights of places (n, 3).

    Feet [m] are in the mesh's frame, places [m] in the work frame. Rows that are `unknown`, with a reason each, have
    NaN.
    """
    matrix, count = pose.matrix, len(feet)
    points = _unknown_points(count, unknown)
    rows = np.array([row for row in range(count) if row not in unknown], np.int64)
    if not len(rows):
        return points
    patches = mesh.body.patches(feet[rows], faces[rows])
    position, normal = pose.outwards(patches.position), patches.normal @ matrix.T
    # Pose, shape of the body, and scatter of its vertices.
    variance = pose.position_variance(position, normal) + mesh.shape_uncertainty**2 + patches.scatter**2
    normal_covariance = pose.normal_covariance(position, normal, matrix @ patches.shape @ matrix.T)
    normal_covariance += matrix @ patches.normal_covariance @ matrix.T
    points.position[rows] = position
    points.normal[rows] = normal
    points.height[rows] = np.einsum("ij,ij->i", places[rows] - position, normal)
    points.position_std[rows] = np.sqrt(variance)
    points.normal_std[rows] = np.sqrt(np.linalg.eigvalsh(normal_covariance)[:, -1])  # in its worst direction
    points.curvature[rows] = patches.curvature
    points.curvature_std[rows] = patches.curvature_std
    return points


def _unknown_points(count: int, unknown: dict[int, str]) -> SurfacePoints:
    """Return points of NaN, with the reasons of rows that are unknown."""

    def missing(*width: int) -> Floats:
        """Return NaN (count, *width)."""
        return np.full((count, *width), np.nan)

    return SurfacePoints(
        position=missing(3),
        normal=missing(3),
        height=missing(),
        curvature=missing(2),
        position_std=missing(),
        normal_std=missing(),
        curvature_std=missing(2),
        unknown=unknown,
    )
