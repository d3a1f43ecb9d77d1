"""Motions from their parts: a way over the surface, a depth below it, an oscillation of that depth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from palpate import Floats, Setpoint

from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.smooth_profile import Knot, KnotProfile, profile, rest_profile


class Wave(Protocol):
    """An oscillation of the depth."""

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Way inwards [m] and its rate [m/s]."""
        ...


@dataclass(frozen=True)
class PlannedMotion:
    """Everything that a trajectory does, over the whole of its time.

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
        """Setpoints at times (n,) [s]."""
        t = np.asarray(time, float)
        (x, x_rate), (y, y_rate), (depth, rate) = self.x.at(t), self.y.at(t), self.depth.at(t)
        if self.wave is not None:
            (swell, growth), (wave, wave_rate) = self.swell.at(t), self.wave.at(t - self.wave_start)
            depth, rate = depth + swell * wave, rate + growth * wave + swell * wave_rate
        height, along_x, along_y = self.surface.at(x, y)
        rise = along_x * x_rate + along_y * y_rate
        measuring = np.zeros(len(t), bool)
        for begin, end in self.measuring:
            measuring |= (t >= begin) & (t < end)
        return Setpoint(
            np.column_stack([x, y, height - depth]), np.column_stack([x_rate, y_rate, rise - rate]), measuring
        )


def line_knots(start: float, begin: float, end: float, speed: float, ramp: float) -> list[Knot]:
    """Knots of a coordinate that goes from begin to end at constant speed, from rest to rest, from a time on.

    Speeding up and slowing down take `ramp` [s] and half of `speed` times it each; a shorter way is one smooth move.
    """
    way = abs(end - begin)
    if way < 1e-12:
        return [Knot(start, begin)]
    if way <= 1.5 * speed * ramp:
        return [Knot(start, begin), Knot(start + line_time(way, speed, ramp), end)]
    rate = speed if end > begin else -speed
    part, total = rate * ramp / 2, line_time(way, speed, ramp)
    return [
        Knot(start, begin),
        Knot(start + ramp, begin + part, rate),
        Knot(start + total - ramp, end - part, rate),
        Knot(start + total, end),
    ]


def line_time(way: float, speed: float, ramp: float) -> float:
    """How long such a line takes [s]."""
    if way < 1e-12:
        return 0.0
    return 1.875 * way / speed if way <= 1.5 * speed * ramp else way / speed + ramp


def through(knots: list[Knot]) -> KnotProfile:
    """The profile through knots; a single one rests."""
    return profile(knots) if len(knots) > 1 else rest_profile(knots[0].value)
