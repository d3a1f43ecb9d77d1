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

_UPWARDS = math.cos(math.radians(60.0))  # of an open mesh as a whole against z
_STEEP = math.cos(math.radians(80.0))
_STEPS = 2


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
    def _outwards(self) -> Any:
        triangles = self.body.triangles
        if triangles.is_watertight and triangles.volume < 0:
            raise ValueError(f"{self.file}: its normals point inwards (a volume of {1e6 * triangles.volume:.3g} cm^3)")
        mean = self.pose.matrix @ (triangles.face_normals * triangles.area_faces[:, None]).sum(axis=0)
        if not triangles.is_watertight and mean[2] < _UPWARDS * float(np.linalg.norm(mean)):
            axis = int(np.argmax(np.abs(mean)))
            look = f"look along {'-' if mean[axis] < 0 else ''}{'xyz'[axis]} of the work frame, whose z is out of the"
            if look.startswith("look along -z"):
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
        """Where it stands, with its covariance."""
        if self.registration is not None:
            return read_registration(self.registration, file_digest(self.file)).pose
        stated = UncertainPose(np.array(self.rotation), np.array(self.position), np.zeros(3), np.eye(6))
        variances = np.repeat([self.position_uncertainty**2, self.rotation_uncertainty**2], 3)
        pivot = stated.outwards(self.body.middle[None])[0]
        return UncertainPose(stated.rotation, stated.translation, pivot, np.diag(variances))

    def nearest(self, places: Floats) -> SurfacePoints:
        """Points of the triangles nearest to places (n, 3) [m]."""
        feet, faces = self.body.nearest(self.pose.inwards(places))
        beyond = np.flatnonzero(self.body.on_the_rim(feet, faces))
        return points_of(
            self.pose, self, places, feet, faces, {int(row): "beyond the rim of the mesh" for row in beyond}
        )

    def _below(self, places: Floats, unknown: dict[int, str]) -> SurfacePoints:
        feet, faces = self.body.nearest(self.pose.inwards(places))
        return points_of(self.pose, self, places, feet, faces, unknown)

    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Points of the triangles at x and y (n, 2) [m], looked at from above."""
        top = float(self.pose.outwards(self.body.triangles.vertices)[:, 2].max()) + self.body.size
        above = self.pose.inwards(np.column_stack([lateral, np.full(len(lateral), top)]))
        down = self.pose.matrix.T @ [0.0, 0.0, -1.0]
        feet, faces = self.body.first_along(above, down)
        unknown = {int(row): "no mesh at this x and y" for row in np.flatnonzero(faces < 0)}
        places = self.pose.outwards(feet)
        for _ in range(_STEPS):  # the surface lies off the triangles, within which it curves
            points = self._below(places, unknown)
            places[:, 2] -= np.nan_to_num(points.height / points.normal[:, 2])
        points = self._below(places, unknown)
        steep = np.flatnonzero(points.normal[:, 2] < _STEEP)
        return points.without({int(row): "the mesh is too steep there to be looked at from above" for row in steep})


def points_of(
    pose: UncertainPose, mesh: Mesh, places: Floats, feet: Floats, faces: Faces, unknown: dict[int, str]
) -> SurfacePoints:
    """What is known of a mesh at a pose, below places (n, 3), at feet (n, 3) of its own frame; NaN in unknown rows."""
    turn, count = pose.matrix, len(feet)
    points = _nothing_known(count, unknown)
    rows = np.array([row for row in range(count) if row not in unknown], np.int64)
    if not len(rows):
        return points
    patches = mesh.body.patches(feet[rows], faces[rows])
    position, normal = pose.outwards(patches.position), patches.normal @ turn.T
    variance = pose.position_variance(position, normal) + mesh.shape_uncertainty**2 + patches.scatter**2
    turned = pose.normal_covariance(position, normal, turn @ patches.shape @ turn.T)
    turned += turn @ patches.normal_covariance @ turn.T
    points.position[rows], points.normal[rows] = position, normal
    points.height[rows] = np.einsum("ij,ij->i", places[rows] - position, normal)
    points.position_std[rows] = np.sqrt(variance)
    points.normal_std[rows] = np.sqrt(np.linalg.eigvalsh(turned)[:, -1])
    points.curvature[rows], points.curvature_std[rows] = patches.curvature, patches.curvature_std
    return points


def _nothing_known(count: int, unknown: dict[int, str]) -> SurfacePoints:
    vector, pair, one = (np.full(shape, np.nan) for shape in ((count, 3), (count, 2), (count,)))
    return SurfacePoints(vector, vector.copy(), one, pair, one.copy(), one.copy(), pair.copy(), unknown)
