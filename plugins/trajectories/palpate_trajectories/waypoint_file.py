"""A motion through the waypoints of a file."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from palpate import ConfigurationError, Depth, Floats, InputFile, Setpoint, Speed, Trajectory
from pydantic import Field, model_validator

from palpate_trajectories.motion_parts import TOP_SPEED

_CHECKS = 20001  # a choice: instants at which speed and height of the motion are checked
_COLUMNS = (4, 5)  # time, x, y, z, and optionally whether the stretch that begins there is measured
_MEASURED_ABOVE = 0.5  # of that column, whose numbers are 0 and 1
_DEGREE = 5  # of the spline: rest at both ends leaves speed and acceleration to fix there


class FromFile(Trajectory):
    """Through the waypoints of a CSV file, at their times: columns time [s], x, y, z [m], and optionally measuring.

    Between waypoints a fifth-order spline, at rest at both ends, so velocity and acceleration are continuous. A header
    line is skipped. Measured where the column is 1; without the column, where the tip is below the nominal surface.
    """

    file: InputFile = Field(description="the waypoints, .csv, relative to the pipeline file")
    deepest: Depth = Field(default=0.01, gt=0, description="depth below z = 0 that the motion may not exceed")
    top_speed: Speed = Field(default=TOP_SPEED, gt=0, le=TOP_SPEED, description="speed that the motion may not exceed")

    @model_validator(mode="after")
    def _check_motion(self) -> Any:
        """Raise ValueError where the motion is too fast, too deep, or measures nothing."""
        time = np.linspace(0.0, self.total_duration, _CHECKS)
        setpoint = self.at(time)
        fastest = float(np.linalg.norm(setpoint.velocity, axis=1).max())
        if fastest > self.top_speed:
            raise ValueError(f"{self.file}: the motion reaches {fastest:.3g} m/s, allowed {self.top_speed:g}")
        lowest = float(setpoint.position[:, 2].min())
        if lowest < -self.deepest:
            raise ValueError(f"{self.file}: the motion goes to z = {lowest:.3g} m, allowed {-self.deepest:g}")
        if not setpoint.measuring.any():
            raise ValueError(f"{self.file}: no part of the motion is for measuring")
        return self

    @cached_property
    def _waypoints(self) -> Floats:
        """The rows of the file, from time 0; raises ConfigurationError."""
        try:
            text = self.file.read_text(encoding="utf-8-sig").splitlines()
            skip = int(bool(text) and text[0].lstrip()[:1].isalpha())
            table = np.loadtxt(text[skip:], delimiter=",", ndmin=2)
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{self.file}: cannot be read as waypoints: {error}") from error
        if table.size == 0 or table.shape[1] not in _COLUMNS or len(table) < 2:
            raise ConfigurationError(f"{self.file}: waypoints have 4 or 5 columns (time, x, y, z, measuring), 2 rows")
        if not np.isfinite(table).all() or not (np.diff(table[:, 0]) > 0).all():
            raise ConfigurationError(f"{self.file}: every number must be finite, and times must increase")
        table[:, 0] -= table[0, 0]
        return np.asarray(table)

    @cached_property
    def _splines(self) -> tuple[Any, Any]:
        """Position and velocity over time, at rest at both ends."""
        from scipy.interpolate import make_interp_spline

        table = self._waypoints
        at_rest = [(1, np.zeros(3)), (2, np.zeros(3))]  # first and second derivative
        position = make_interp_spline(table[:, 0], table[:, 1:4], k=_DEGREE, bc_type=(at_rest, at_rest))
        return position, position.derivative()

    @property
    def total_duration(self) -> float:
        """The time from the first waypoint to the last [s]."""
        return float(self._waypoints[-1, 0])

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3)."""
        table, (position, velocity) = self._waypoints, self._splines
        bounded = np.clip(time, 0.0, table[-1, 0])
        is_moving = ((time >= 0) & (time <= table[-1, 0]))[:, None]
        place = position(bounded)
        if table.shape[1] == _COLUMNS[1]:
            # The row of the waypoint at which each time's stretch begins.
            stretch = np.clip(np.searchsorted(table[:, 0], bounded, side="right") - 1, 0, len(table) - 1)
            measuring = table[stretch, 4] > _MEASURED_ABOVE
        else:
            measuring = place[:, 2] < 0
        return Setpoint(place, np.where(is_moving, velocity(bounded), 0.0), measuring & is_moving[:, 0])
