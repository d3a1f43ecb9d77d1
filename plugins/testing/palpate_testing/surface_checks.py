"""Checks of surfaces."""

from __future__ import annotations

import numpy as np
from palpate import Floats, Surface, SurfacePoints, surface_points

from palpate_testing.failure_messages import demand

_STEP = 1e-4  # [m] from a place to its neighbours
_ABOVE = 1e-3  # [m]


def check_surface(surface: Surface, lateral: Floats) -> None:
    """A surface answers alike from both sides, and its normals are those of its points.

    Checked at x and y (n, 2) [m] where it must be known: unit normals that look outwards; a place 1 mm above or below a
    point, along its normal, is as high as that, and has that point below it; points next to it, 0.1 mm away, lie in its
    tangent plane but for its curvature; curvatures in their order, and no uncertainty negative.
    """
    name = type(surface).__name__
    top = surface_points(surface, np.asarray(lateral, float))
    _check_values(name, top)
    demand(len(surface_points(surface, top.position[:0])) == 0, f"{name}.nearest answers points for no places")
    far = np.abs(top.position[:, :2] - lateral).max(initial=0.0)
    demand(far <= 1e-7, f"{name}.uppermost answers {1e3 * far:.3g} mm off the requested x and y")
    for side in (_ABOVE, -_ABOVE):
        points = surface_points(surface, top.position + side * top.normal)
        _check_values(name, points)
        off = np.abs(points.height - side).max()
        demand(off <= 0.02 * _ABOVE, f"{name}.nearest: a place {1e3 * side:g} mm above it is {1e6 * off:.3g} um off")
        beside = np.linalg.norm(points.position - top.position, axis=1).max()
        demand(beside <= 0.1 * _ABOVE, f"{name}.nearest answers {1e6 * beside:.3g} um off the point below a place")
    _check_normals(name, surface, top)


def _check_values(name: str, points: SurfacePoints) -> None:
    length = np.abs(np.linalg.norm(points.normal, axis=1) - 1.0).max()
    demand(length <= 1e-9, f"{name}: a normal is {length:.3g} longer or shorter than 1")
    demand((points.curvature[:, 0] >= points.curvature[:, 1]).all(), f"{name}: the smaller curvature comes first")
    for key in ("position_std", "normal_std", "curvature_std"):
        demand((getattr(points, key) >= 0).all(), f"{name}: {key} is negative")


def _check_normals(name: str, surface: Surface, top: SurfacePoints) -> None:
    """Points 0.1 mm apart lie in one another's tangent plane, but for what curvature makes of it."""
    demand((top.normal[:, 2] > 0).all(), f"{name}: a normal of its upper side does not look upwards")
    other = np.where(np.abs(top.normal[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    across: Floats = np.asarray(np.cross(top.normal, other), np.float64)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    bulge = np.abs(top.curvature).max(axis=1) * _STEP**2
    for direction in (across, np.asarray(np.cross(top.normal, across), np.float64)):
        for sign in (1.0, -1.0):
            points = surface_points(surface, top.position + sign * _STEP * direction)
            rise = np.abs(np.einsum("ij,ij->i", points.position - top.position, top.normal))
            wrong = (rise - bulge).max()
            demand(
                wrong <= 0.02 * _STEP, f"{name}: a normal is wrong by {np.degrees(np.arctan(wrong / _STEP)):.2g} deg"
            )
