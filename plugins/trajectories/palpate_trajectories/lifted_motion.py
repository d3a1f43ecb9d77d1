"""Another motion, above the specimen and slower."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate import Floats, Length, Setpoint, Trajectory
from pydantic import Field


class LiftedTrajectory(Trajectory):
    """Another motion at a height above its own, and slower: what an arm will do, seen in free air."""

    of: Trajectory = Field(description="the motion")
    lift: Length = Field(gt=0, description="height above it")
    pace: float = Field(default=1.0, gt=0, le=1, description="speed in parts of its own")

    @property
    def total_duration(self) -> float:
        """That of the motion at this pace [s]."""
        return self.of.total_duration / self.pace

    def at(self, time: Floats) -> Setpoint:
        """Setpoints (n, 3)."""
        setpoint = self.of.at(np.asarray(time * self.pace))
        return replace(
            setpoint,
            position=setpoint.position + np.array([0.0, 0.0, self.lift]),
            velocity=setpoint.velocity * self.pace,
            angular_velocity=None if (turn := setpoint.angular_velocity) is None else turn * self.pace,
        )
