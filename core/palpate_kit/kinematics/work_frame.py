"""The work frame: a place on the skin, and the outward normal there."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from palpate import Angle, Floats, Length, Settings
from pydantic import Field

from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector

_DOWN = np.diag([1.0, -1.0, -1.0])  # half a turn around x: the tool looks against the normal
_HELPFUL_SHARE = 0.9  # of an angle that has to be left for a turn of the tool not to be advised (choice)


class WorkFrame(Settings):
    """Origin on the nominal skin, z along the outward normal, both in the robot's base frame."""

    origin: tuple[Length, ...] = Field(min_length=3, max_length=3, description="of the frame, in the base")
    rotation: tuple[Angle, ...] = Field(
        default=(0.0, 0.0, 0.0), min_length=3, max_length=3, description="rotation vector from base to work frame"
    )
    turn: Angle = Field(default=0.0, description="turn of the tool around its own axis")

    @cached_property
    def matrix(self) -> Floats:
        """The frame (4, 4) in the base."""
        matrix = np.eye(4)
        matrix[:3, :3] = rotation_matrix(self.rotation)
        matrix[:3, 3] = self.origin
        return matrix

    @cached_property
    def tool(self) -> Floats:
        """Orientation (3, 3) in the base of a tool that looks at the skin."""
        return np.asarray(self.matrix[:3, :3] @ _DOWN @ rotation_matrix((0.0, 0.0, self.turn)))

    @cached_property
    def axes_in_tool(self) -> Floats:
        """The frame's axes (3, 3) in the tool's frame, which turn a vector of the work frame into one of the tool's."""
        return np.asarray(self.tool.T @ self.matrix[:3, :3])

    def tool_pose(self, position: Floats) -> Floats:
        """Return the pose (4, 4) in the base of a tool at a position (3,) [m] in the work frame."""
        pose = np.eye(4)
        pose[:3, :3] = self.tool
        pose[:3, 3] = self.matrix[:3, 3] + self.matrix[:3, :3] @ position
        return pose


def agreement(work: WorkFrame, rotation: Floats) -> tuple[float, str]:
    """Return the angle [rad] between a tool's rotation (3, 3) in the robot's base and the one of the work frame.

    The second is advice on how to make it smaller. Of all turns around its axis the one by atan2(R_yx - R_xy, R_xx +
    R_yy) brings the frame's tool nearest to this one, R the rotation from the frame's tool without a turn to it.
    """
    angle = float(np.linalg.norm(rotation_vector(work.tool.T @ rotation)))
    from_unturned = (work.matrix[:3, :3] @ _DOWN).T @ rotation
    turn = math.atan2(from_unturned[1, 0] - from_unturned[0, 1], from_unturned[0, 0] + from_unturned[1, 1])
    unturned = rotation_matrix((0.0, 0.0, -turn)) @ from_unturned
    smallest_angle = float(np.linalg.norm(rotation_vector(unturned)))
    degrees = f"{math.degrees(turn):.1f} deg"
    if smallest_angle < _HELPFUL_SHARE * angle:
        advice = f'with work.turn = "{degrees}" it would be off by {math.degrees(smallest_angle):.1f} deg'
    else:
        advice = "turn the tool by hand, or set work.rotation to the skin's"
    return angle, advice
