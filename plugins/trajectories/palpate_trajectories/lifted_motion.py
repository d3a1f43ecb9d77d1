"""Another motion, above the specimen and slower."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate import Floats, Length, Setpoint, Trajectory
from pydantic import Field


class LiftedTrajectory(Trajectory):
    """Another motion at a height above its own, and slower: a rehearsal of an arm in free air."""

    of: Trajectory = Field(description="the motion")
    lift: Length = Field(gt=0, description="height above it")
    pace: float = Field(default=1.0, gt=0, le=1, description="speed in parts of its own")

    @property
    def total_duration(self) -> float:
        """The motion's time at this pace [s]."""
        return self.of.total_duration / self.pace

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3)."""
        setpoint = self.of.at(np.asarray(time * self.pace))
        turning = setpoint.angular_velocity
        if turning is not None:
            turning = turning * self.pace
        return replace(
            setpoint,
            position=setpoint.position + np.array([0.0, 0.0, self.lift]),
            velocity=setpoint.velocity * self.pace,
            angular_velocity=turning,
        )
