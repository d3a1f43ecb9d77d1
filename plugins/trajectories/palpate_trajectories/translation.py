"""Another motion, at another place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from palpate import Floats, Length, Setpoint, Trajectory
from pydantic import Field


class TranslatedTrajectory(Trajectory):
    """Another motion, moved along the surface as it is; times, heights and speeds stay the same."""

    of: Trajectory = Field(description="the motion")
    by: tuple[Length, Length] = Field(description="displacement [x, y]")

    @property
    def total_duration(self) -> float:
        """That of the motion [s]."""
        return self.of.total_duration

    def at(self, time: Floats) -> Setpoint:
        """Setpoints (n, 3)."""
        setpoint = self.of.at(time)
        return replace(setpoint, position=setpoint.position + np.array([*self.by, 0.0]))
