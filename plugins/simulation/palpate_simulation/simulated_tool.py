"""How the tool of a simulated rig stands over time, and what its sensor makes of vectors of the work frame."""

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
    """A tool that keeps its orientation, or turns as its setpoints do; its turns are tracked as its places are."""

    orientation: Floats  # (3, 3) in the work frame, of one that is not turned
    sensor: Floats  # (3, 3) axes of the sensor, as columns, then
    down: Floats  # (3,) direction of gravity
    turning: TrackedMotion | None  # rotation vectors [rad]

    @classmethod
    def of(
        cls,
        tool_rotation: Sequence[float],
        mounting: Sequence[float] | None,
        down: Sequence[float],
        loop: PositionLoop,
        setpoint: Setpoint,
    ) -> SimulatedTool:
        """Return the tool of a rig from its keys, which follows the rotations of `setpoint`, one for each control
        period."""
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
        """How it is turned (n, 3, 3) at true times (n,) [s]."""
        assert self.turning is not None
        return rotation_matrices(self.turning.at(instants)[0])

    def out(self, instants: Floats) -> tuple[Floats, Floats]:
        """Direction (n, 3) from the tip along it at true times (n,) [s], and how fast that changes [1/s]."""
        if self.turning is None:
            out = np.tile(-self.orientation[:, 2], (len(instants), 1))
            return out, np.zeros_like(out)
        out = -(self.turns(instants) @ self.orientation)[:, :, 2]
        return out, np.cross(self._spin(instants), out)

    def in_sensor(self, instants: Floats, force: Floats, acceleration: Floats) -> tuple[Floats, Floats, Floats]:
        """Force and acceleration (n, 3), and the direction of gravity (3,) or (n, 3), in the axes of the sensor."""
        if self.turning is not None:
            each = self.turns(instants) @ self.sensor
            force, acceleration = (np.einsum("nij,ni->nj", each, part) for part in (force, acceleration))
            return force, acceleration, np.einsum("nij,i->nj", each, self.down)
        if np.array_equal(self.sensor, np.eye(3)):  # to the bit
            return force, acceleration, self.down
        return force @ self.sensor, acceleration @ self.sensor, self.down @ self.sensor

    def pose(self, instants: Floats) -> tuple[Floats, Floats]:
        """Quaternions x, y, z, w (n, 4) and angular velocities (n, 3) [rad/s] at true times (n,) [s]."""
        if self.turning is None:
            one = np.round(quaternion(self.orientation), 15) + 0.0
            return np.tile(one, (len(instants), 1)), np.zeros((len(instants), 3))
        return quaternions(self.turns(instants) @ self.orientation), self._spin(instants)

    def _spin(self, instants: Floats) -> Floats:
        assert self.turning is not None
        vector, rate, _ = self.turning.at(instants)
        return angular_velocities(vector, rate)
