"""Palpation at a point: approach, sine, retract."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from palpate import Depth, Floats, Frequency, Length, Setpoint, Speed, Surface, Time, Trajectory
from pydantic import Field, model_validator

from palpate_trajectories.stations import Stations, setpoint_at_station

_ROUNDING = 1e-9  # periods, a choice: rounding of a whole number of them
_DEGREE = 5  # of a polynomial that meets position, speed and acceleration at both ends: six conditions


class Point(Trajectory):
    """Palpation at a point: standstill in free air, approach, settle, sine around a depth, retract.

    While measuring, z(t) = -bias - amplitude sin(2 pi f t) (paper, section Online Point Estimation). Approach and
    retraction are fifth-order polynomials that meet the sine where it crosses the bias at full speed, so position,
    velocity and acceleration are continuous; the measured part starts there, as the paper's filter requires.
    """

    bias: Depth = Field(gt=0, description="depth around which the sine goes, below the nominal surface")
    amplitude: Depth = Field(default=0.001, gt=0, description="amplitude of the sine")
    frequency: Frequency = Field(default=2.0, gt=0, description="frequency of the sine")
    duration: Time = Field(default=10.0, gt=0, description="length of the measured part")
    settle: Time = Field(
        default=0.0, ge=0, description="sine before the measured part; rounded up to whole periods of it"
    )
    clearance: Depth = Field(
        default=0.005, gt=0, description="height above the nominal surface at which it starts and ends"
    )
    standstill: Time = Field(default=1.0, ge=0, description="standstill in free air before the approach, for the tare")
    speed: Speed = Field(default=0.01, gt=0, description="mean speed of approach and retraction")

    place: tuple[Length, Length] = Field(default=(0.0, 0.0), description="where [x, y]")
    surface: Surface | None = Field(
        default=None, description="surface along whose normal it palpates; left out: the plane of the work frame"
    )

    @model_validator(mode="after")
    def _check_contact(self) -> Any:
        if self.amplitude >= self.bias:
            raise ValueError(f"amplitude {self.amplitude:g} m must be smaller than bias {self.bias:g} m")
        return self

    @property
    def total_duration(self) -> float:
        """The time from rest to rest [s]."""
        return self.standstill + 2 * self._transfer + self._sine_time

    @property
    def _transfer(self) -> float:
        """The duration of the approach, and of the retraction [s]."""
        return (self.clearance + self.bias) / self.speed

    @property
    def _settling(self) -> float:
        """The duration of the sine before the measured part [s]."""
        return float(np.ceil(self.settle * self.frequency - _ROUNDING)) / self.frequency

    @property
    def _sine_time(self) -> float:
        """The duration of the sine [s]: beyond the measured part until it next crosses the bias outwards."""
        half_periods = np.ceil(2 * self.frequency * (self._settling + self.duration) - _ROUNDING)
        return float(half_periods + (half_periods % 2 == 0)) / (2 * self.frequency)

    @cached_property
    def _polynomials(self) -> tuple[Floats, Floats]:
        """The coefficients of approach and retraction, in time since their beginning."""
        speed = 2 * np.pi * self.frequency * self.amplitude
        clear = self.clearance, 0.0, 0.0
        inwards = -self.bias, -speed, 0.0
        outwards = -self.bias, speed, 0.0
        return _quintic(clear, inwards, self._transfer), _quintic(outwards, clear, self._transfer)

    @property
    def followed(self) -> Surface | None:
        """See `palpate.SupportsSurface`."""
        return self.surface

    @cached_property
    def _station(self) -> Stations | None:
        """The place on the surface; None without one."""
        return None if self.surface is None else Stations.on(self.surface, np.array([self.place]))

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3); only the depth moves."""
        setpoint = self._level_setpoint(time)
        if self._station is not None:
            return setpoint_at_station(setpoint, self._station.foot[0], self._station.normal[0])
        setpoint.position[:, :2] = self.place
        return setpoint

    def _level_setpoint(self, time: Floats) -> Setpoint:
        """Return setpoints (n, 3) over the origin of the work frame: each piece of the motion, chosen by its time."""
        # When each piece ends: standstill, approach, sine, retraction; a standstill follows.
        t = np.asarray(time, float)
        sine_begins = self.standstill + self._transfer
        sine_ends = sine_begins + self._sine_time
        pieces = [t < self.standstill, t < sine_begins, t < sine_ends, t < sine_ends + self._transfer]
        # Height and velocity of every piece, in time since its beginning.
        approach, retraction = self._polynomials
        omega = 2 * np.pi * self.frequency
        approach_time, sine_time, retraction_time = t - self.standstill, t - sine_begins, t - sine_ends
        z = [
            np.full_like(t, self.clearance),
            np.polyval(approach, approach_time),
            -self.bias - self.amplitude * np.sin(omega * sine_time),
            np.polyval(retraction, retraction_time),
        ]
        v = [
            np.zeros_like(t),
            np.polyval(np.polyder(approach), approach_time),
            -self.amplitude * omega * np.cos(omega * sine_time),
            np.polyval(np.polyder(retraction), retraction_time),
        ]
        position, velocity = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        position[:, 2] = np.select(pieces, z, self.clearance)
        velocity[:, 2] = np.select(pieces, v, 0.0)
        # Measured once the sine has settled.
        measured_time = sine_time - self._settling
        return Setpoint(position, velocity, (measured_time >= 0) & (measured_time < self.duration))


def _quintic(start: tuple[float, float, float], end: tuple[float, float, float], duration: float) -> Floats:
    """Return the coefficients, highest first, of the fifth-order polynomial with motion (z, z', z'') at both ends."""
    # One equation for each condition: the derivatives of t^5 ... 1 at either end.
    powers = [np.poly1d([1.0] + [0.0] * k) for k in range(_DEGREE, -1, -1)]
    rows = []
    for t in (0.0, duration):
        for order in range(3):
            rows.append([np.polyder(power, order)(t) for power in powers])
    coefficients: Floats = np.linalg.solve(np.array(rows), np.array([*start, *end]))
    return coefficients
