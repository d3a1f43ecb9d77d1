"""The touched surface: what touches make of a skin of which nothing else is known."""

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

_FEWEST, _MOST = 6, 500  # touches
_LINE = 0.05  # of their extent, that they are across
_STEEPEST = math.radians(70.0)  # of the skin against the plane or sphere
_FARTHEST = math.radians(90.0)  # of touches from their middle, seen from the sphere's centre
_ODD = 4.0  # standard deviations of a touch from what the others say
_ROUNDS = 3  # in which the places where spheres touched are found
_STEPS = 30  # towards the point that a place means
_STILL = 1e-9  # [m]
_STEEP = 0.1  # cosine between normal and z that a skin has at least
_STENCIL = np.array([[x, y] for x in np.linspace(-1, 1, 5) for y in np.linspace(-1, 1, 5)])


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
    def _sound(self) -> Any:
        given = self._given
        if not _FEWEST <= len(given) <= _MOST:
            raise ValueError(f"touches: these are {len(given)}; a surface is made of {_FEWEST} to {_MOST}")
        lateral = self._base.unrolled(self._field.q)
        spread = np.linalg.svd(lateral - lateral.mean(axis=0), compute_uv=False)
        if spread[1] < _LINE * spread[0] or self._base.side * self._base.axis[2] < _STEEP:
            raise ValueError("touches: they lie on one line, or nearly so")
        worst = int(np.argmax(np.abs(self._field.left_out())))
        if (off := self._field.deviation_from_others(worst)) > _ODD:
            raise ValueError(f"touches: {given.name[worst]} is {off:.1f} standard deviations from what the others say")
        far = self._base.turned(self._field.q)
        if far.max() > _FARTHEST:
            raise ValueError(
                f"touches: {given.name[int(np.argmax(far))]} is {math.degrees(far.max()):.0f} deg from their middle; "
                "a bulge may reach to a half sphere, and undercuts are not known"
            )
        for name, q in zip(given.name, self._field.q):
            steep = math.acos(min(float(self._patch(q, False).normal @ self._base.outwards(q[None])[0]), 1.0))
            if steep > _STEEPEST:
                raise ValueError(
                    f"touches: at {name} the skin is {math.degrees(steep):.0f} deg steep against their best "
                    f"{self._base.name}: undercuts are not known"
                )
        return self

    @cached_property
    def _given(self) -> Touches:
        return Touches.of(touch for path in self.touches for touch in table_touches(path, self.uncertainty))

    @cached_property
    def _shape_and_field(self) -> tuple[BaseShape, HeightField]:
        """Base and heights; where a sphere touched depends on the normal there, so that they are made in rounds."""
        given = self._given
        base = BaseShape.of(given.centre)
        normal = base.outwards(base.coordinates(given.centre)[0])
        for _ in range(_ROUNDS if given.radius.any() else 0):
            base, field = self._over(given.centre - given.radius[:, None] * normal, given.std)
            normal = np.array([_patch(base, field, self.neighbourhood, at, False).normal for at in field.q])
        return self._over(given.centre - given.radius[:, None] * normal, given.std)

    def _over(self, skin: Floats, std: Floats) -> tuple[BaseShape, HeightField]:
        base = BaseShape.of(skin)
        return base, HeightField.of(*base.coordinates(skin), std)

    @property
    def _base(self) -> BaseShape:
        return self._shape_and_field[0]

    @property
    def _field(self) -> HeightField:
        return self._shape_and_field[1]

    @cached_property
    def _region(self) -> Any:
        from scipy.spatial import Delaunay

        return Delaunay(self._base.unrolled(self._field.q))

    def nearest(self, places: Floats) -> SurfacePoints:
        """Points nearest to places (n, 3) [m]."""

        def below(patch: SurfacePatch, place: Floats) -> Floats:
            return np.asarray(place - ((place - patch.position) @ patch.normal) * patch.normal)

        return self._points([self._place(place, below) for place in places], places)

    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Points at x and y (n, 2) [m]."""

        def at(patch: SurfacePatch, place: Floats) -> Floats:
            aside = place[:2] - patch.position[:2]
            return np.array([*place[:2], patch.position[2] - aside @ patch.normal[:2] / max(patch.normal[2], _STEEP)])

        feet = [self._place(place, at) for place in self._base.above(lateral)]
        points = self._points(feet, np.column_stack([lateral, np.zeros(len(lateral))]))
        points.height[:] *= 0.0
        return points

    def _place(self, place: Floats, on_the_tangent: Callable[[SurfacePatch, Floats], Floats]) -> Floats:
        """Coordinates (k,) of the point of the skin that a place (3,) means, from tangent plane to tangent plane.

        NaN where that leads nowhere, as it does far beyond the touches.
        """
        q = self._base.coordinates(place[None])[0][0]
        for _ in range(_STEPS):
            before, q = q, self._base.coordinates(on_the_tangent(self._patch(q, False), place)[None])[0][0]
            if float(np.abs(q - before).max()) < _STILL:
                return np.asarray(q)
        return np.full(len(q), np.nan)

    def _patch(self, q: Floats, uncertain: bool) -> SurfacePatch:
        return _patch(self._base, self._field, self.neighbourhood, q, uncertain)

    def _is_within(self, q: Floats) -> bool:
        """Return True if coordinates (k,) lie within the outermost touches; NaN do not."""
        return bool(np.isfinite(q).all()) and self._region.find_simplex(self._base.unrolled(q[None]))[0] >= 0

    def _points(self, feet: list[Floats], places: Floats) -> SurfacePoints:
        q = np.array(feet).reshape(len(feet), self._field.q.shape[1])
        within = [self._is_within(at) for at in q]
        unknown = {row: "outside of what was touched" for row, known in enumerate(within) if not known}
        patches = [self._patch(at if known else self._field.q[0], True) for at, known in zip(q, within)]
        position, normal, curvature, curvature_std = (
            np.array([getattr(patch, key) for patch in patches]).reshape(len(q), width)
            for key, width in (("position", 3), ("normal", 3), ("curvature", 2), ("curvature_std", 2))
        )
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


def _patch(base: BaseShape, field: HeightField, size: float, q: Floats, uncertain: bool) -> SurfacePatch:
    """Return the skin around coordinates (k,), with the uncertainty of its heights where that is asked for."""
    around = base.around(q, size * _STENCIL)
    height = field.mean(around)
    covariance = field.covariance(around) if uncertain else None
    middle = base.points(q[None], field.mean(q[None]))[0]
    return fit_patch(middle, base.outwards(q[None])[0], base.points(around, height), covariance)
