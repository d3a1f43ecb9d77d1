"""The half ellipsoid: a skin that bulges, such as a breast phantom's, with a sphere as its simplest."""

from __future__ import annotations

import math

import numpy as np
from palpate import Angle, Depth, Floats, Length, Surface, SurfacePoints
from pydantic import Field

_TURNS = 60  # of Newton's method; some ten do for places near the skin
_CLOSE = 1e-14  # of the parameter's scale
_OFF_AXIS = 1e-9  # [m]
_DEEP = 0.5  # of the least radius of curvature: further in, another side may be as near
_INSIDE, _BELOW, _BESIDE = "too deep inside the ellipsoid", "below the rim of the ellipsoid", "off the ellipsoid"


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
        return np.array(self.half_axes) ** 2

    @property
    def _middle(self) -> Floats:
        return np.array((0.0, 0.0, -self.half_axes[2]) if self.centre is None else self.centre)

    @property
    def _axes(self) -> Floats:
        """Rows (3, 3): its axes in the work frame."""
        c, s = math.cos(self.spin), math.sin(self.spin)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def nearest(self, places: Floats) -> SurfacePoints:
        """Return the feet of the perpendiculars from places (n, 3) [m]."""
        own = (places - self._middle) @ self._axes.T
        foot = self._foot(own)
        out = foot / self._squares
        height = np.sum((own - foot) * out, axis=1) / np.linalg.norm(out, axis=1)
        points = self._points(foot, height)
        unknown = {int(row): _BELOW for row in np.flatnonzero(foot[:, 2] < 0.0)}
        unknown |= {int(row): _INSIDE for row in np.flatnonzero(height < -_DEEP / points.curvature[:, 0])}
        return points.without(unknown) if unknown else points

    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Return the points over x and y (n, 2) [m]."""
        own = (np.column_stack([lateral, np.zeros(len(lateral))]) - [*self._middle[:2], 0.0]) @ self._axes.T
        left = 1.0 - np.sum(own[:, :2] ** 2 / self._squares[:2], axis=1)
        own[:, 2] = self.half_axes[2] * np.sqrt(np.maximum(left, 0.0))
        unknown = {int(row): _BESIDE for row in np.flatnonzero(~(left >= 0.0))}
        points = self._points(own, np.zeros(len(own)))
        return points.without(unknown) if unknown else points

    def _foot(self, own: Floats) -> Floats:
        """Points (n, 3) of the whole ellipsoid nearest to points (n, 3), both about its centre and in its axes."""
        squares = self._squares
        own = np.where(np.abs(own) < _OFF_AXIS, _OFF_AXIS, own)  # on an axis it may have two
        t = (np.abs(own) * np.sqrt(squares) - squares).max(axis=1)  # here the sum is 1 or more, and it falls with t
        for _ in range(_TURNS):
            below = squares + t[:, None]
            terms = squares * own**2 / below**2
            step = (terms.sum(axis=1) - 1.0) / (2.0 * (terms / below).sum(axis=1))
            t = t + step
            if np.abs(step).max(initial=0.0) <= _CLOSE * squares.max():
                break
        return np.asarray(squares * own / (squares + t[:, None]))

    def _curvature(self, foot: Floats) -> Floats:
        """Principal curvatures (n, 2) [1/m], the larger first."""
        inverse = 1.0 / self._squares
        out = foot * inverse
        size = np.linalg.norm(out, axis=1)
        mean = (inverse.sum() - np.sum(out**2 * inverse, axis=1) / size**2) / (2.0 * size)
        apart = np.sqrt(np.maximum(mean**2 - inverse.prod() / size**4, 0.0))
        return np.column_stack([mean + apart, mean - apart])

    def _points(self, foot: Floats, height: Floats) -> SurfacePoints:
        count, out, curvature = len(foot), foot / self._squares, self._curvature(foot)
        return SurfacePoints(
            position=foot @ self._axes + self._middle,
            normal=(out / np.linalg.norm(out, axis=1)[:, None]) @ self._axes,
            height=height,
            curvature=curvature,
            position_std=np.full(count, self.position_uncertainty),
            normal_std=np.full(count, self.normal_uncertainty),
            curvature_std=self.curvature_uncertainty * curvature,
        )
