"""A standstill in free air, for calibration."""

from __future__ import annotations

import numpy as np
from palpate import Floats, Length, Setpoint, Time, Trajectory
from pydantic import Field


class Stay(Trajectory):
    """The tip stays where it is, for offset, drift and noise of the sensors, and for the weight behind them."""

    height: Length = Field(default=0.05, gt=0, description="height above the nominal surface")
    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    duration: Time = Field(default=5.0, gt=0, description="how long")

    @property
    def total_duration(self) -> float:
        """The whole time [s]."""
        return self.duration

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3), all the same."""
        t = np.asarray(time, float)
        position = np.zeros((len(t), 3))
        position[:] = (*self.place, self.height)
        return Setpoint(position, np.zeros((len(t), 3)), (t >= 0) & (t < self.duration))
