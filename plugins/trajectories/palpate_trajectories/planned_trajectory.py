"""Trajectories that are one motion, planned as a whole."""

from __future__ import annotations

from functools import cached_property

from palpate import Floats, Setpoint, Trajectory

from palpate_trajectories.motion_parts import PlannedMotion
from palpate_trajectories.surface_motion import SurfaceMotion


class PlannedTrajectory(Trajectory):
    """A trajectory that plans its `_motion`."""

    @cached_property
    def _motion(self) -> PlannedMotion | SurfaceMotion:
        """The whole motion."""
        raise NotImplementedError

    @property
    def total_duration(self) -> float:
        """The time from rest to rest [s]."""
        return self._motion.duration

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3)."""
        return self._motion.at(time)
