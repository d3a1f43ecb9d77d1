"""Checks of surfaces."""

from __future__ import annotations

import numpy as np
from palpate import Floats, Surface, SurfacePoints, surface_points

from palpate_testing.failure_messages import demand

STEP = 1e-4  # [m] from a point to its neighbours (a choice)
HEIGHT = 1e-3  # [m] of places above and below a point (a choice)
MAX_HEIGHT_ERROR, MAX_FOOT_ERROR = 0.02, 0.1  # of that height, and sideways (choices: meshes are not smooth)
MAX_LATERAL_ERROR = 1e-7  # [m] (a choice) between requested and answered x and y
MAX_NORMAL_ERROR = 0.02  # of a step (a choice), by which a neighbour may be off the tangent plane
UNIT_ROUNDING = 1e-9  # of the length of a normal
STEEP_COSINE = 0.9  # of a normal with x, above which y is farther from it


def check_surface(surface: Surface, lateral: Floats) -> None:
    """Check that a surface answers alike from both sides, and its normals are those of its points.

    Checked at x and y (n, 2) [m] where it must be known: unit normals that look outwards; a place 1 mm above or below a
    point, along its normal, is as high as that, and has that point below it; points next to it, 0.1 mm away, lie in its
    tangent plane but for its curvature; curvatures in their order, and no uncertainty negative.
    """
    name = type(surface).__name__
    top = surface_points(surface, np.asarray(lateral, float))
    _check_values(name, top)
    demand(len(surface_points(surface, top.position[:0])) == 0, f"{name}.nearest answers points for no places")
    lateral_error = np.abs(top.position[:, :2] - lateral).max(initial=0.0)
    complaint = f"{name}.uppermost answers {1e3 * lateral_error:.3g} mm off the requested x and y"
    demand(lateral_error <= MAX_LATERAL_ERROR, complaint)
    for height in (HEIGHT, -HEIGHT):
        points = surface_points(surface, top.position + height * top.normal)
        _check_values(name, points)
        height_error = np.abs(points.height - height).max()
        complaint = f"{name}.nearest: a place {1e3 * height:g} mm above it is {1e6 * height_error:.3g} um off"
        demand(height_error <= MAX_HEIGHT_ERROR * HEIGHT, complaint)
        foot_error = np.linalg.norm(points.position - top.position, axis=1).max()
        complaint = f"{name}.nearest answers {1e6 * foot_error:.3g} um off the point below a place"
        demand(foot_error <= MAX_FOOT_ERROR * HEIGHT, complaint)
    _check_normals(name, surface, top)


def _check_values(name: str, points: SurfacePoints) -> None:
    """Check unit normals, the order of the curvatures, and the signs of uncertainties."""
    length_error = np.abs(np.linalg.norm(points.normal, axis=1) - 1.0).max()
    demand(length_error <= UNIT_ROUNDING, f"{name}: a normal is {length_error:.3g} longer or shorter than 1")
    demand((points.curvature[:, 0] >= points.curvature[:, 1]).all(), f"{name}: the smaller curvature comes first")
    for key in ("position_std", "normal_std", "curvature_std"):
        demand((getattr(points, key) >= 0).all(), f"{name}: {key} is negative")


def _check_normals(name: str, surface: Surface, top: SurfacePoints) -> None:
    """Check that points 0.1 mm from a point are in its tangent plane, but for the rise by its curvature."""
    demand((top.normal[:, 2] > 0).all(), f"{name}: a normal of its upper side does not look upwards")
    # Two tangents at right angles: normal x axis, with an axis that is not along the normal, and normal x that.
    axis = np.where(np.abs(top.normal[:, :1]) < STEEP_COSINE, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    tangent: Floats = np.asarray(np.cross(top.normal, axis), np.float64)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    other_tangent: Floats = np.asarray(np.cross(top.normal, tangent), np.float64)
    curved_rise = np.abs(top.curvature).max(axis=1) * STEP**2  # twice the rise of a circle, k s^2/2
    for direction in (tangent, other_tangent):
        for sign in (1.0, -1.0):
            points = surface_points(surface, top.position + sign * STEP * direction)
            rise = np.abs(np.einsum("ij,ij->i", points.position - top.position, top.normal))
            error = (rise - curved_rise).max()
            angle = np.degrees(np.arctan(error / STEP))
            demand(error <= MAX_NORMAL_ERROR * STEP, f"{name}: a normal is wrong by {angle:.2g} deg")
