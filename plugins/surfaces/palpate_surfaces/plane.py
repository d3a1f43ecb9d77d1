"""The plane: a skin that is flat and level, or inclined."""

from __future__ import annotations

import math

import numpy as np
from palpate import Angle, Depth, Floats, Length, Surface, SurfacePoints
from pydantic import Field

_MAX_TILT = math.radians(60.0)  # a choice


class Plane(Surface):
    """A plane z = height + x tan(tilt_x) + y tan(tilt_y) without an end.

    Its height is known to u(h) at the origin, its normal to u(t) in every direction; at a distance r from the point
    below the origin the uncertainty along the normal is sqrt(u(h)^2 + r^2 u(t)^2).
    """

    height: Length = Field(default=0.0, description="height at the origin of the work frame")
    tilt_x: Angle = Field(default=0.0, ge=-_MAX_TILT, le=_MAX_TILT, description="rise towards positive x")
    tilt_y: Angle = Field(default=0.0, ge=-_MAX_TILT, le=_MAX_TILT, description="rise towards positive y")
    height_uncertainty: Depth = Field(
        default=0.5e-3, ge=0, description="standard uncertainty of the height at the origin, along the normal"
    )
    tilt_uncertainty: Angle = Field(
        default=math.radians(1.0), ge=0, description="standard uncertainty of the normal, in each direction"
    )

    @property
    def _slope(self) -> Floats:
        """(2,) dz/dx and dz/dy."""
        return np.array([math.tan(self.tilt_x), math.tan(self.tilt_y)])

    def nearest(self, places: Floats) -> SurfacePoints:
        """Return the feet of the perpendiculars from places (n, 3) [m]."""
        normal = np.array([*-self._slope, 1.0])
        normal /= np.linalg.norm(normal)
        height = (places - [0.0, 0.0, self.height]) @ normal
        return self._surface_points(places - height[:, None] * normal, height)

    def uppermost(self, lateral: Floats) -> SurfacePoints:
        """Return the points at x and y (n, 2) [m]."""
        position = np.column_stack([lateral, self.height + lateral @ self._slope])
        return self._surface_points(position, np.zeros(len(lateral)))

    def _surface_points(self, position: Floats, height: Floats) -> SurfacePoints:
        """Return the points of the plane at positions (n, 3), with heights (n,) [m] of the places over them."""
        count = len(position)
        normal = np.array([*-self._slope, 1.0])
        from_origin = np.linalg.norm(position - [0.0, 0.0, self.height], axis=1)
        return SurfacePoints(
            position=position,
            normal=np.tile(normal / np.linalg.norm(normal), (count, 1)),
            height=height,
            curvature=np.zeros((count, 2)),
            position_std=np.hypot(self.height_uncertainty, from_origin * self.tilt_uncertainty),
            normal_std=np.full(count, self.tilt_uncertainty),
            curvature_std=np.zeros((count, 2)),
        )
