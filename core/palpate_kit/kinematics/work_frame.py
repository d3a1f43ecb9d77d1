"""The work frame: where the skin is, and which way is out."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from palpate import Angle, Floats, Length, Settings
from pydantic import Field

from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector

_DOWN = np.diag([1.0, -1.0, -1.0])  # the tool looks against the normal


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
        """The frame's axes (3, 3) in the frame of that tool: it makes a rotation vector of the one one of the other."""
        return np.asarray(self.tool.T @ self.matrix[:3, :3])

    def tool_pose(self, position: Floats) -> Floats:
        """Pose (4, 4) in the base of a tool at a position (3,) [m] in the work frame."""
        pose = np.eye(4)
        pose[:3, :3] = self.tool
        pose[:3, 3] = self.matrix[:3, 3] + self.matrix[:3, :3] @ position
        return pose


def agreement(work: WorkFrame, rotation: Floats) -> tuple[float, str]:
    """Angle [rad] between a tool (3, 3) in the base and the frame's, and what would make them agree."""
    angle = float(np.linalg.norm(rotation_vector(work.tool.T @ rotation)))
    bare = (work.matrix[:3, :3] @ _DOWN).T @ rotation
    # The turn about the tool's axis that brings the frame's tool nearest to this one.
    turn = math.atan2(bare[1, 0] - bare[0, 1], bare[0, 0] + bare[1, 1])
    left = float(np.linalg.norm(rotation_vector(rotation_matrix((0.0, 0.0, -turn)) @ bare)))
    degrees = f"{math.degrees(turn):.1f} deg"
    if left < 0.9 * angle:
        advice = f'with work.turn = "{degrees}" it would be off by {math.degrees(left):.1f} deg'
    else:
        advice = "turn the tool by hand, or set work.rotation to the skin's"
    return angle, advice
