"""Motions from their parts: a path over the surface, a depth below it, an oscillation of that depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, Setpoint

from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.smooth_profile import PEAK, Knot, KnotProfile, profile, rest_profile

TOP_SPEED = 0.25  # [m/s], the usual limit near people (ISO 10218-1)
# Of the distance speed times ramp, a choice: a shorter way is one smooth move. Both ramps take 1 of it: no constant
# speed remains at 1, and at 1.5 it lasts half a ramp.
_MIN_RAMPS = 1.5
_MIN_WAY = 1e-12  # [m], a choice: far below an encoder; a shorter way is rounding


class Wave(Protocol):
    """An oscillation of the depth."""

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Return the displacement inwards [m] and its rate [m/s]."""
        ...


@dataclass(frozen=True)
class PlannedMotion:
    """The whole motion of a trajectory.

    z(t) = h(x, y) - depth(t) - swell(t) w(t - wave_start): the skin h, the depth around which the oscillation w goes,
    and how much of it there is, from 0 to 1.
    """

    duration: float  # [s]
    x: KnotProfile  # [m]
    y: KnotProfile
    depth: KnotProfile  # [m] below the nominal surface
    measuring: tuple[tuple[float, float], ...]  # stretches of time [s]
    surface: NominalHeight = field(default_factory=NominalHeight)
    swell: KnotProfile = field(default_factory=lambda: rest_profile(0.0))
    wave: Wave | None = None
    wave_start: float = 0.0

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints at times (n,) [s], from place, depth and surface and their rates in time."""
        t = np.asarray(time, float)
        x, x_rate = self.x.at(t)
        y, y_rate = self.y.at(t)
        depth, depth_rate = self.depth.at(t)
        if self.wave is not None:
            depth, depth_rate = add_wave(
                time=t, depth=depth, rate=depth_rate, swell=self.swell, wave=self.wave, wave_start=self.wave_start
            )
        # The tip follows the skin, and moves down by the depth.
        height, slope_x, slope_y = self.surface.at(x, y)
        height_rate = slope_x * x_rate + slope_y * y_rate
        position = np.column_stack([x, y, height - depth])
        velocity = np.column_stack([x_rate, y_rate, height_rate - depth_rate])
        return Setpoint(position, velocity, is_within(t, self.measuring))


def add_wave(
    time: Floats, depth: Floats, rate: Floats, swell: KnotProfile, wave: Wave, wave_start: float
) -> tuple[Floats, Floats]:
    """Return depth and its rate (n,) with an oscillation: d + s w, and its derivative d' + s' w + s w'."""
    (share, growth), (displacement, speed) = swell.at(time), wave.at(time - wave_start)
    return depth + share * displacement, rate + growth * displacement + share * speed


def is_within(time: Floats, stretches: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Return True (n,) at times within any of the stretches, their end excluded."""
    inside = np.zeros(len(time), bool)
    for begin, end in stretches:
        inside |= (time >= begin) & (time < end)
    return inside


def line_knots(start: float, begin: float, end: float, speed: float, ramp: float) -> list[Knot]:
    """Return the knots of a coordinate from begin to end at constant speed, from rest to rest, from a time on.

    Speeding up and slowing down take `ramp` [s] and half of `speed` times it each; a shorter way is one smooth move.
    """
    way = abs(end - begin)
    if way < _MIN_WAY:
        return [Knot(start, begin)]
    if way <= _MIN_RAMPS * speed * ramp:
        return [Knot(start, begin), Knot(start + line_time(way, speed, ramp), end)]
    # Each ramp takes half of the distance at full speed, as its speed is symmetric about its middle.
    rate = speed if end > begin else -speed
    ramp_way = rate * ramp / 2
    total = line_time(way, speed, ramp)
    return [
        Knot(start, begin),
        Knot(start + ramp, begin + ramp_way, rate),
        Knot(start + total - ramp, end - ramp_way, rate),
        Knot(start + total, end),
    ]


def line_time(way: float, speed: float, ramp: float) -> float:
    """Return the duration [s] of a line of `line_knots`; a smooth move peaks at `speed`."""
    if way < _MIN_WAY:
        return 0.0
    if way <= _MIN_RAMPS * speed * ramp:
        return PEAK * way / speed
    return way / speed + ramp


def through(knots: list[Knot]) -> KnotProfile:
    """Return the profile through knots; a single one rests."""
    return profile(knots) if len(knots) > 1 else rest_profile(knots[0].value)
