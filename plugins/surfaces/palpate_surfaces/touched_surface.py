"""The touched surface: a smooth skin by touches alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Depth, Floats, InputFile, Surface, SurfacePoints
from pydantic import Field, model_validator

from palpate_surfaces.base_shape import BaseShape
from palpate_surfaces.height_field import HeightField
from palpate_surfaces.surface_patch import SurfacePatch, fit_patch
from palpate_surfaces.touches import Touches, table_touches

# Choices.
_MIN_TOUCHES, _MAX_TOUCHES = 6, 500
_MIN_WIDTH_SHARE = 0.05  # of the touches' extent, that they are across
_MAX_STEEPNESS = math.radians(70.0)  # of the skin against the plane or sphere
_MAX_ANGLE = math.radians(90.0)  # of touches from their middle, seen from the sphere's centre
_MAX_DEVIATION = 4.0  # standard deviations of a touch from the prediction by the others
_CONTACT_ROUNDS = 3  # in which the points where spheres touched are found
_MAX_TANGENT_STEPS = 30  # from tangent plane to tangent plane
_CONVERGED_STEP = 1e-9  # [m]
_MIN_NORMAL_Z = 0.1  # cosine between normal and z of a skin that is seen from above
_STENCIL = np.array([[x, y] for x in np.linspace(-1, 1, 5) for y in np.linspace(-1, 1, 5)])  # of a patch


class TouchedSurface(Surface):
    """A smooth skin through touches: heights over their best plane or sphere, as a Gaussian process.

    Where a sphere of radius R touched, the skin lies R from its centre, along its normal. Normals and curvatures are
    those of a cubic on the scale of `neighbourhood`, with the covariance of the heights. A bulge may reach to a half
    sphere; what is beyond the outermost touches is not known, and undercuts are refused.
    """

    touches: tuple[InputFile, ...] = Field(
        min_length=1, description='tables "x [mm],y [mm],z [mm],u [mm]"; `palpate calibrate touches` makes one of runs'
    )
    uncertainty: Depth | None = Field(
        default=None, gt=0, description="standard uncertainty of the touches in tables that do not state it"
    )
    neighbourhood: Depth = Field(default=0.005, gt=0, description="distance over which normal and curvatures are taken")

    @model_validator(mode="after")
    def _check_touches(self) -> Any:
        """Raise ValueError for touches that do not determine a surface, or contradict one another."""
        touches = self._touches
        if not _MIN_TOUCHES <= len(touches) <= _MAX_TOUCHES:
            raise ValueError(
                f"touches: these are {len(touches)}; a surface is made of {_MIN_TOUCHES} to {_MAX_TOUCHES}"
            )
        lateral = self._base.unroll(self._field.q)
        extents = np.linalg.svd(lateral - lateral.mean(axis=0), compute_uv=False)  # along and across
        is_seen_from_above = self._base.side * self._base.axis[2] >= _MIN_NORMAL_Z
        if extents[1] < _MIN_WIDTH_SHARE * extents[0] or not is_seen_from_above:
            raise ValueError("touches: they lie on one line, or nearly so")
        worst = int(np.argmax(np.abs(self._field.left_out())))
        deviation = self._field.deviation_from_others(worst)
        if deviation > _MAX_DEVIATION:
            raise ValueError(
                f"touches: {touches.name[worst]} is {deviation:.1f} standard deviations from what the others say"
            )
        self._check_undercuts()
        return self

    def _check_undercuts(self) -> None:
        """Raise ValueError for touches beyond a half sphere, and for a skin that is steep against its base."""
        names = self._touches.name
        angles = self._base.angles(self._field.q)
        if angles.max() > _MAX_ANGLE:
            raise ValueError(
                f"touches: {names[int(np.argmax(angles))]} is {math.degrees(angles.max()):.0f} deg from their middle; "
                "a bulge may reach to a half sphere, and undercuts are not known"
            )
        for name, q in zip(names, self._field.q):
            normal = self._patch(q, with_covariance=False).normal
            steepness = math.acos(min(float(normal @ self._base.outwards(q[None])[0]), 1.0))
            if steepness > _MAX_STEEPNESS:
                raise ValueError(
                    f"touches: at {name} the skin is {math.degrees(steepness):.0f} deg steep against their best "
                    f"{self._base.name}: undercuts are not known"
                )

    @cached_property
    def _touches(self) -> Touches:
        """The touches of all tables."""
        return Touches.of(touch for path in self.touches for touch in table_touches(path, self.uncertainty))

    @cached_property
    def _base_and_field(self) -> tuple[BaseShape, HeightField]:
        """Base and heights.

        A sphere touched at its centre less its radius along the skin's normal, which depends on the skin: the points
        of contact are found in rounds, from the normals of the base.
        """
        touches = self._touches
        base = BaseShape.of(touches.centre)
        normal = base.outwards(base.coordinates(touches.centre)[0])
        for _ in range(_CONTACT_ROUNDS if touches.radius.any() else 0):
            contact_points = touches.centre - touches.radius[:, None] * normal
            base, field = _fit_heights(contact_points, touches.std)
            patches = [_fit_patch(base, field, self.neighbourhood, q, with_covariance=False) for q in field.q]
            normal = np.array([patch.normal for patch in patches])
        return _fit_heights(touches.centre - touches.radius[:, None] * normal, touches.std)

    @property
    def _base(self) -> BaseShape:
        return self._base_and_field[0]

    @property
    def _field(self) -> HeightField:
        return self._base_and_field[1]

    @cached_property
    def _touched_region(self) -> Any:
        """The triangulated region (scipy's Delaunay) of the touches in a plane."""
        from scipy.spatial import Delaunay

        return Delaunay(self._base.unroll(self._field.q))

    def nearest(self, places: Floats) -> SurfacePoints:
        """Return the points nearest to places (n, 3) [m]."""

        def foot_on_tangent(patch: SurfacePatch, place: Floats) -> Floats:
            """Return the foot (3,) of the perpendicular from a place (3,) on a tangent plane."""
            return np.asarray(place - ((place - patch.position) @ patch.normal) * patch.normal)

        return self._points([self._follow_tangents(place, foot_on_tangent) for place in places], places)

    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Return the points at x and y (n, 2) [m]."""

        def point_on_tangent(patch: SurfacePatch, place: Floats) -> Floats:
            """Return the point (3,) of a tangent plane at x and y of a place (3,)."""
            offset = place[:2] - patch.position[:2]
            rise = offset @ patch.normal[:2] / max(patch.normal[2], _MIN_NORMAL_Z)
            return np.array([*place[:2], patch.position[2] - rise])

        feet = [self._follow_tangents(place, point_on_tangent) for place in self._base.uppermost(lateral)]
        points = self._points(feet, np.column_stack([lateral, np.zeros(len(lateral))]))
        points.height[:] *= 0.0  # NaN stays
        return points

    def _follow_tangents(self, place: Floats, on_tangent: Callable[[SurfacePatch, Floats], Floats]) -> Floats:
        """Return the coordinates (k,) of the skin's point for a place (3,) [m], from tangent plane to tangent plane.

        `on_tangent` is the point (3,) of a patch's tangent plane for the place. NaN where the steps do not converge,
        as far beyond the touches.
        """
        q = self._base.coordinates(place[None])[0][0]
        for _ in range(_MAX_TANGENT_STEPS):
            previous = q
            point = on_tangent(self._patch(q, with_covariance=False), place)
            q = self._base.coordinates(point[None])[0][0]
            if float(np.abs(q - previous).max()) < _CONVERGED_STEP:
                return np.asarray(q)
        return np.full(len(q), np.nan)

    def _patch(self, q: Floats, *, with_covariance: bool) -> SurfacePatch:
        """Return the skin around coordinates (k,); see `_fit_patch`."""
        return _fit_patch(self._base, self._field, self.neighbourhood, q, with_covariance=with_covariance)

    def _is_within(self, q: Floats) -> bool:
        """Return True if coordinates (k,) lie within the outermost touches; NaN do not."""
        return bool(np.isfinite(q).all()) and self._touched_region.find_simplex(self._base.unroll(q[None]))[0] >= 0

    def _points(self, feet: list[Floats], places: Floats) -> SurfacePoints:
        """Return the surface at coordinates (k,) of n feet, with heights of places (n, 3) [m] over it."""
        q = np.array(feet).reshape(len(feet), self._field.q.shape[1])
        is_known = [self._is_within(foot) for foot in q]
        unknown = {row: "outside of what was touched" for row, known in enumerate(is_known) if not known}
        # Rows that are not known have any patch, until `without` makes them NaN.
        patched_q = [foot if known else self._field.q[0] for foot, known in zip(q, is_known)]
        patches = [self._patch(foot, with_covariance=True) for foot in patched_q]
        position, normal = (_columns(patches, name, 3) for name in ("position", "normal"))
        curvature, curvature_std = (_columns(patches, name, 2) for name in ("curvature", "curvature_std"))
        points = SurfacePoints(
            position=position,
            normal=normal,
            height=np.einsum("ij,ij->i", places - position, normal),
            curvature=curvature,
            position_std=np.array([patch.scatter for patch in patches]),
            normal_std=np.array([np.sqrt(np.linalg.eigvalsh(patch.normal_covariance)[-1]) for patch in patches]),
            curvature_std=curvature_std,
        )
        return points.without(unknown)


def _columns(patches: list[SurfacePatch], name: str, width: int) -> Floats:
    """Return a field of n patches as (n, width)."""
    return np.array([getattr(patch, name) for patch in patches]).reshape(len(patches), width)


def _fit_heights(skin: Floats, std: Floats) -> tuple[BaseShape, HeightField]:
    """Return base and heights of points (n, 3) [m] of the skin, known to (n,) [m]."""
    base = BaseShape.of(skin)
    return base, HeightField.of(*base.coordinates(skin), std)


def _fit_patch(base: BaseShape, field: HeightField, size: float, q: Floats, *, with_covariance: bool) -> SurfacePatch:
    """Return the skin within a distance [m] of coordinates (k,), by the heights at 5 x 5 points.

    The covariance of the heights counts only on request, as it takes most of the time.
    """
    stencil = base.stencil(q, size * _STENCIL)
    height = field.mean(stencil)
    covariance = field.covariance(stencil) if with_covariance else None
    middle = base.points(q[None], field.mean(q[None]))[0]
    return fit_patch(middle, base.outwards(q[None])[0], base.points(stencil, height), covariance)
