"""Stations: places of a surface, each with a local frame whose z is the normal there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, Floats, Setpoint, Surface, surface_points
from palpate_kit.kinematics.turns_to_normals import rotation_to

_MM = 1e3  # per metre, as messages show places
_MIN_UPWARD = 0.05  # z of a normal, a choice: a skin steeper than 87 degrees cannot be reached from above


@dataclass(frozen=True)
class Stations:
    """Feet and normals in the work frame."""

    foot: Floats  # (k, 3) [m]
    normal: Floats  # (k, 3)

    @classmethod
    def on(cls, surface: Surface, places: Floats) -> Stations:
        """Return the stations at x and y (k, 2) [m]; raises ConfigurationError off a surface, or where it overhangs."""
        points = surface_points(surface, np.asarray(places, float))
        steep = np.flatnonzero(points.normal[:, 2] < _MIN_UPWARD)
        if len(steep):
            x, y = (_MM * points.position[steep[0], :2]).tolist()
            raise ConfigurationError(
                f"place {steep[0] + 1} ({x:.1f}, {y:.1f} mm): the surface hangs over, or nearly so"
            )
        return cls(points.position, points.normal)

    def __len__(self) -> int:
        return len(self.foot)


def local_axes(normal: Floats) -> Floats:
    """Return the axes (3, 3), as columns, at a normal (3,): those of the work frame, by the shortest turn."""
    # Rodrigues' rotation of z onto the normal, about z x n = (-y, x, 0) by the angle whose cosine is n_z.
    x, y, z = normal.tolist()
    share = 1.0 / (1.0 + z)
    return np.array([[1.0 - share * x * x, -share * x * y, x], [-share * x * y, 1.0 - share * y * y, y], [-x, -y, z]])


def setpoint_at_station(setpoint: Setpoint, foot: Floats, normal: Floats) -> Setpoint:
    """Return setpoints over the work frame's plane in the local frame at a foot (3,) [m] with a normal (3,)."""
    axes, count = local_axes(normal), len(setpoint.position)
    position, velocity = setpoint.position @ axes.T + foot, setpoint.velocity @ axes.T
    rotation = np.tile(rotation_to(normal[None]), (count, 1))
    return Setpoint(
        position=position,
        velocity=velocity,
        measuring=setpoint.measuring,
        rotation=rotation,
        angular_velocity=np.zeros((count, 3)),
    )
