"""Another motion, at another place."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Floats, Length, Setpoint, Surface, Trajectory, surface_of
from pydantic import Field, model_validator

from palpate_trajectories.stations import Stations, setpoint_at_station


class TranslatedTrajectory(Trajectory):
    """Another motion, moved along the surface; times, heights and speeds stay the same.

    On a `surface` the motion is that in the local frame of a place: along the normal there what it was along z.
    """

    of: Trajectory = Field(description="the motion")
    by: tuple[Length, Length] = Field(description="displacement [x, y]")
    surface: Surface | None = Field(
        default=None, description="surface whose local frame it is moved to; left out: none"
    )

    @model_validator(mode="after")
    def _check_surface(self) -> Any:
        if self.surface is not None and surface_of(self.of) is not None:
            raise ValueError("surface: the motion itself follows one already")
        if self.surface is None and surface_of(self.of) is not None:
            raise ValueError("by: a motion over a surface is moved by its own places")
        return self

    @property
    def followed(self) -> Surface | None:
        """See `palpate.SupportsSurface`."""
        return self.surface

    @cached_property
    def _station(self) -> Stations | None:
        """The place of the local frame; None without a surface."""
        return None if self.surface is None else Stations.on(self.surface, np.array([self.by]))

    @property
    def total_duration(self) -> float:
        """The motion's time [s]."""
        return self.of.total_duration

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3)."""
        setpoint = self.of.at(time)
        if self._station is not None:
            return setpoint_at_station(setpoint, self._station.foot[0], self._station.normal[0])
        return replace(setpoint, position=setpoint.position + np.array([*self.by, 0.0]))
