"""Limits of a motion: how far, fast and sudden it may be, and what it breaks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate.trajectory import Setpoint
from palpate.vectors import Floats

_TOLERANCE = 1e-9  # [SI]; rounding of setpoints that end exactly at a limit


@dataclass(frozen=True)
class Reach:
    """Extremes of a motion, which an arm has to do."""

    low: Floats  # (3,) [m]
    high: Floats  # (3,) [m]
    speed: float  # [m/s]
    acceleration: float  # [m/s^2]

    @classmethod
    def of(cls, times: Floats, setpoint: Setpoint) -> Reach:
        """Return the extremes of setpoints at times (n,) [s]: what the positions do counts as much as the stated
        velocity."""
        position, velocity, step = setpoint.position, setpoint.velocity, np.diff(times)[:, None]
        moved = np.diff(position, axis=0) / step
        acceleration = max(_largest(np.diff(velocity, axis=0) / step), _largest(np.diff(moved, axis=0) / step[1:]))
        speed = max(_largest(velocity), _largest(moved)) + setpoint.fastest_turn * setpoint.lever
        return cls(position.min(axis=0), position.max(axis=0), speed, acceleration)

    def and_of(self, other: Reach) -> Reach:
        """Return the extremes of two stretches of a motion together."""
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return Reach(low, high, max(self.speed, other.speed), max(self.acceleration, other.acceleration))


@dataclass(frozen=True)
class Excess:
    """One limit that a motion breaks."""

    what: Literal["low", "high", "speed", "acceleration"]
    axis: str  # x, y or z; of speed and acceleration none
    value: float  # [SI]
    limit: float  # [SI]


@dataclass(frozen=True)
class MotionLimits:
    """Limits of place, speed and acceleration of a tip: the same for a run and a calibration."""

    low: tuple[float, ...]  # (3,) [m]
    high: tuple[float, ...]  # (3,) [m]
    speed: float  # [m/s]
    acceleration: float  # [m/s^2]

    @classmethod
    def of_heights(cls, low: float, high: float, speed: float, acceleration: float) -> MotionLimits:
        """Return limits that are the same all over the skin; heights in [m]."""
        return cls((-math.inf, -math.inf, low), (math.inf, math.inf, high), speed, acceleration)

    def tighter(self, other: MotionLimits) -> MotionLimits:
        """Return the tighter of two limits each."""
        return MotionLimits(
            tuple(map(max, self.low, other.low)),
            tuple(map(min, self.high, other.high)),
            min(self.speed, other.speed),
            min(self.acceleration, other.acceleration),
        )

    def excesses(self, reach: Reach) -> list[Excess]:
        """Return every limit that a motion breaks."""
        excesses = []
        for i, axis in enumerate("xyz"):
            if reach.low[i] < self.low[i] - _TOLERANCE:
                excesses.append(Excess("low", axis, float(reach.low[i]), self.low[i]))
            if reach.high[i] > self.high[i] + _TOLERANCE:
                excesses.append(Excess("high", axis, float(reach.high[i]), self.high[i]))
        if reach.speed > self.speed + _TOLERANCE:
            excesses.append(Excess("speed", "", reach.speed, self.speed))
        if reach.acceleration > self.acceleration + _TOLERANCE:
            excesses.append(Excess("acceleration", "", reach.acceleration, self.acceleration))
        return excesses


def _largest(vectors: Floats) -> float:
    """Return the largest length of vectors (n, 3); 0 without any."""
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
