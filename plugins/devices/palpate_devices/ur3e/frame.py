"""The work frame: where the skin is, and which way is out."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import Angle, Length, Settings
from pydantic import Field

from palpate_devices.ur3e.kinematics import rotation_matrix

Floats = NDArray[np.float64]

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

    def tool_pose(self, position: Floats) -> Floats:
        """Pose (4, 4) in the base of a tool at a position (3,) [m] in the work frame."""
        pose = np.eye(4)
        pose[:3, :3] = self.tool
        pose[:3, 3] = self.matrix[:3, 3] + self.matrix[:3, :3] @ position
        return pose
