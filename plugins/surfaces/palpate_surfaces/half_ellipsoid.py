"""The half ellipsoid: a skin that bulges, such as a breast phantom's, with a sphere as its simplest."""

from __future__ import annotations

import math

import numpy as np
from palpate import Angle, Depth, Floats, Length, Surface, SurfacePoints
from pydantic import Field

# Choices.
_MAX_NEWTON_STEPS = 60  # some ten do for places near the skin
_CONVERGED_SHARE = 1e-14  # of the largest a_i^2, the scale of t: the resolution of a double
_MIN_OFF_AXIS = 1e-9  # [m]: on an axis the nearest point may be one of two
_MAX_DEPTH_SHARE = 0.5  # of the least radius of curvature: deeper inside, another side may be as near
_INSIDE, _BELOW_RIM, _OFF = "too deep inside the ellipsoid", "below the rim of the ellipsoid", "off the ellipsoid"


class HalfEllipsoid(Surface):
    """The upper half of an ellipsoid, x'^2/a^2 + y'^2/b^2 + z'^2/c^2 = 1 about its centre, x' turned about z by `spin`.

    The nearest point q to p solves q_i = a_i^2 p_i/(a_i^2 + t) with sum (a_i p_i/(a_i^2 + t))^2 = 1 (Eberly 2013), by
    Newton's method from the side on which it is monotone. With N = q_i/a_i^2 the curvatures are H +- sqrt(H^2 - K),
    2 H = (sum 1/a_i^2 - n D n)/|N|, K = 1/(a b c)^2/|N|^4, n = N/|N|, D = diag(1/a_i^2).
    """

    half_axes: tuple[Depth, Depth, Depth] = Field(description="half of both widths at the base, and the height")
    centre: tuple[Length, Length, Length] | None = Field(
        default=None, description="centre of its base; else so that its top is the origin of the work frame"
    )
    spin: Angle = Field(default=0.0, description="turn of its axes about z")
    position_uncertainty: Depth = Field(default=0.5e-3, ge=0, description="standard uncertainty along the normal")
    normal_uncertainty: Angle = Field(default=math.radians(1.0), ge=0, description="standard uncertainty of the normal")
    curvature_uncertainty: float = Field(
        default=0.05, ge=0, le=1, allow_inf_nan=False, description="relative standard uncertainty of the curvatures"
    )

    @property
    def _squares(self) -> Floats:
        """Squares a_i^2 (3,) [m^2] of the half axes."""
        return np.array(self.half_axes) ** 2

    @property
    def _origin(self) -> Floats:
        """Centre (3,) [m] in the work frame."""
        return np.array((0.0, 0.0, -self.half_axes[2]) if self.centre is None else self.centre)

    @property
    def _axes(self) -> Floats:
        """Rows (3, 3): its axes in the work frame."""
        c, s = math.cos(self.spin), math.sin(self.spin)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def nearest(self, places: Floats) -> SurfacePoints:
        """Return the feet of the perpendiculars from places (n, 3) [m]."""
        local = (places - self._origin) @ self._axes.T
        foot = self._nearest_foot(local)
        gradient = foot / self._squares
        height = np.sum((local - foot) * gradient, axis=1) / np.linalg.norm(gradient, axis=1)
        points = self._surface_points(foot, height)
        unknown = {int(row): _BELOW_RIM for row in np.flatnonzero(foot[:, 2] < 0.0)}
        unknown |= {int(row): _INSIDE for row in np.flatnonzero(height < -_MAX_DEPTH_SHARE / points.curvature[:, 0])}
        return points.without(unknown) if unknown else points

    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Return the points over x and y (n, 2) [m]."""
        local = (np.column_stack([lateral, np.zeros(len(lateral))]) - [*self._origin[:2], 0.0]) @ self._axes.T
        # z'^2/c^2 of the ellipsoid at these x' and y'; negative off it.
        share = 1.0 - np.sum(local[:, :2] ** 2 / self._squares[:2], axis=1)
        local[:, 2] = self.half_axes[2] * np.sqrt(np.maximum(share, 0.0))
        unknown = {int(row): _OFF for row in np.flatnonzero(~(share >= 0.0))}
        points = self._surface_points(local, np.zeros(len(local)))
        return points.without(unknown) if unknown else points

    def _nearest_foot(self, local: Floats) -> Floats:
        """Return the points q (n, 3) of the whole ellipsoid nearest to points p (n, 3), both in its own frame.

        q_i = a_i^2 p_i/(a_i^2 + t), where t solves g(t) = sum (a_i p_i/(a_i^2 + t))^2 = 1 (Eberly 2013).
        """
        squares = self._squares
        local = np.where(np.abs(local) < _MIN_OFF_AXIS, _MIN_OFF_AXIS, local)
        # Here g is 1 or more; it falls with t and is convex, so that Newton's steps never go beyond the solution.
        t = (np.abs(local) * np.sqrt(squares) - squares).max(axis=1)
        for _ in range(_MAX_NEWTON_STEPS):
            denominator = squares + t[:, None]
            terms = squares * local**2 / denominator**2
            step = (terms.sum(axis=1) - 1.0) / (2.0 * (terms / denominator).sum(axis=1))
            t = t + step
            if np.abs(step).max(initial=0.0) <= _CONVERGED_SHARE * squares.max():
                break
        return np.asarray(squares * local / (squares + t[:, None]))

    def _principal_curvatures(self, foot: Floats) -> Floats:
        """Return the principal curvatures (n, 2) [1/m] at feet (n, 3), the larger first: H +- sqrt(H^2 - K)."""
        inverse_squares = 1.0 / self._squares
        gradient = foot * inverse_squares
        length = np.linalg.norm(gradient, axis=1)
        along_normal = np.sum(gradient**2 * inverse_squares, axis=1) / length**2  # n D n
        mean_curvature = (inverse_squares.sum() - along_normal) / (2.0 * length)
        gaussian_curvature = inverse_squares.prod() / length**4
        half_difference = np.sqrt(np.maximum(mean_curvature**2 - gaussian_curvature, 0.0))
        return np.column_stack([mean_curvature + half_difference, mean_curvature - half_difference])

    def _surface_points(self, foot: Floats, height: Floats) -> SurfacePoints:
        """Return the points of the surface at feet (n, 3) of its own frame, with heights (n,) [m] over them."""
        count, gradient, curvature = len(foot), foot / self._squares, self._principal_curvatures(foot)
        return SurfacePoints(
            position=foot @ self._axes + self._origin,
            normal=(gradient / np.linalg.norm(gradient, axis=1)[:, None]) @ self._axes,
            height=height,
            curvature=curvature,
            position_std=np.full(count, self.position_uncertainty),
            normal_std=np.full(count, self.normal_uncertainty),
            curvature_std=self.curvature_uncertainty * curvature,
        )
