"""Orientation of the tool of a simulated rig over time, and vectors in the axes of its sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats, Setpoint, angular_velocities
from palpate_kit.kinematics.rotations import quaternion, rotation_matrix
from palpate_kit.logs.joint_kinematics import quaternions

from palpate_simulation.simulated_arm import PositionLoop, TrackedMotion
from palpate_simulation.tool_axes import TOOL, mounting_matrix, rotation_matrices


@dataclass(frozen=True)
class SimulatedTool:
    """A tool that keeps its orientation, or turns as its setpoints do, with the lag of its position."""

    orientation: Floats  # (3, 3) in the work frame, before it turns
    sensor: Floats  # (3, 3) axes of the sensor in the work frame as columns, before it turns
    down: Floats  # (3,) direction of gravity in the work frame
    turning: TrackedMotion | None  # rotation vectors [rad] over time; None for a tool that does not turn

    @classmethod
    def of(
        cls,
        tool_rotation: Sequence[float],
        mounting: Sequence[float] | None,
        down: Sequence[float],
        loop: PositionLoop,
        setpoint: Setpoint,
    ) -> SimulatedTool:
        """Return the tool of a rig whose settings are the first three, which follows the rotations of `setpoint`.

        The setpoint (n,) has a row for each control period.
        """
        orientation = TOOL @ rotation_matrix(tool_rotation)
        turning = None
        if (rotation := setpoint.rotation) is not None:
            turning = loop.track(rotation, np.gradient(rotation, loop.period, axis=0))
        return cls(orientation, orientation @ mounting_matrix(mounting), np.array(down), turning)

    @property
    def is_upright(self) -> bool:
        """True if it always looks along the normal of the work frame."""
        return self.turning is None and np.array_equal(self.orientation, TOOL)

    def turns(self, instants: Floats) -> Floats:
        """Return the rotation (n, 3, 3) by which a turning tool is turned at true times (n,) [s]."""
        assert self.turning is not None
        return rotation_matrices(self.turning.at(instants)[0])

    def out(self, instants: Floats) -> tuple[Floats, Floats]:
        """Return the direction (n, 3) from the tip along the tool at true times (n,) [s], and its rate (n, 3) [1/s]."""
        if self.turning is None:
            direction = np.tile(-self.orientation[:, 2], (len(instants), 1))
            return direction, np.zeros_like(direction)
        direction = -(self.turns(instants) @ self.orientation)[:, :, 2]
        return direction, np.cross(self._angular_velocity(instants), direction)

    def in_sensor(self, instants: Floats, force: Floats, acceleration: Floats) -> tuple[Floats, Floats, Floats]:
        """Return force and acceleration (n, 3), and the direction of gravity (3,) or (n, 3), in the sensor's axes.

        `force` and `acceleration` (n, 3) are in the work frame, at true times (n,) [s].
        """
        if self.turning is not None:
            axes = self.turns(instants) @ self.sensor
            force_in_sensor = np.einsum("nij,ni->nj", axes, force)
            acceleration_in_sensor = np.einsum("nij,ni->nj", axes, acceleration)
            return force_in_sensor, acceleration_in_sensor, np.einsum("nij,i->nj", axes, self.down)
        if np.array_equal(self.sensor, np.eye(3)):  # without the rounding of a product
            return force, acceleration, self.down
        return force @ self.sensor, acceleration @ self.sensor, self.down @ self.sensor

    def pose(self, instants: Floats) -> tuple[Floats, Floats]:
        """Return quaternions x, y, z, w (n, 4) and angular velocities (n, 3) [rad/s] at true times (n,) [s]."""
        if self.turning is None:
            constant = (
                np.round(quaternion(self.orientation), 15) + 0.0
            )  # without the digits of rounding, and without -0
            return np.tile(constant, (len(instants), 1)), np.zeros((len(instants), 3))
        return quaternions(self.turns(instants) @ self.orientation), self._angular_velocity(instants)

    def _angular_velocity(self, instants: Floats) -> Floats:
        """Return the angular velocity (n, 3) [rad/s] of a turning tool at true times (n,) [s]."""
        assert self.turning is not None
        vector, rate, _ = self.turning.at(instants)
        return angular_velocities(vector, rate)
