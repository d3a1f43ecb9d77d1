"""Motions over a surface: a foot on it, the normal there, and a depth along that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from palpate import Floats, Setpoint, Surface, angular_velocities
from palpate_kit.kinematics.turns_to_normals import rotation_rate, rotation_to

from palpate_trajectories.motion_parts import Wave
from palpate_trajectories.smooth_profile import PEAK, KnotProfile
from palpate_trajectories.stations import Stations

_LOOKS = 101  # places of a line at which its slopes are looked at
_SHORTEST = 1e-3  # [s]
_PITCH, _FEWEST = 0.5e-3, 9  # [m] between the stations of a line, and how many it has at least

Course = tuple[Floats, Floats, Floats, Floats]  # foot [m] and its rate, normal and its rate, each (n, 3)


class Footway(Protocol):
    """Where the foot of the tip is on the surface over time."""

    def at(self, time: Floats) -> Course:
        """Foot, normal and their rates at times (n,) [s]."""
        ...


@dataclass(frozen=True)
class SurfaceMotion:
    """Everything that a trajectory does over a surface: foot(t) - depth(t) n(t), the tool along n(t)."""

    duration: float  # [s]
    footway: Footway
    depth: KnotProfile  # [m] along the normal
    measuring: tuple[tuple[float, float], ...]  # stretches of time [s]
    swell: KnotProfile
    wave: Wave
    wave_start: float

    def at(self, time: Floats) -> Setpoint:
        """Setpoints at times (n,) [s]."""
        t = np.asarray(time, float)
        foot, foot_rate, normal, normal_rate = self.footway.at(t)
        (depth, rate), (swell, growth) = self.depth.at(t), self.swell.at(t)
        wave, wave_rate = self.wave.at(t - self.wave_start)
        depth, rate = depth + swell * wave, rate + growth * wave + swell * wave_rate
        measuring = np.zeros(len(t), bool)
        for begin, end in self.measuring:
            measuring |= (t >= begin) & (t < end)
        position = foot - depth[:, None] * normal
        velocity = foot_rate - rate[:, None] * normal - depth[:, None] * normal_rate
        rotation = rotation_to(normal)
        turning = angular_velocities(rotation, rotation_rate(normal, normal_rate))
        return Setpoint(position, velocity, measuring, rotation, turning)


@dataclass(frozen=True)
class SurfaceLine:
    """A straight line in x and y on a surface, in parts of its length there: cubic splines of foot and normal.

    A straight line through the air with the normal on a great circle from end to end (Shoemake 1985) would dip below
    the clearance of a body that bulges, and be off the normals between.
    """

    length: float  # [m] along the surface
    _spline: Any  # of foot and normal (6,) over parts of the length

    @classmethod
    def on(cls, surface: Surface, begin: tuple[float, float], end: tuple[float, float]) -> SurfaceLine:
        """The line between two places [x, y]; raises ConfigurationError where the surface is not known below it."""
        from scipy.interpolate import CubicSpline

        count = max(math.ceil(math.dist(begin, end) / _PITCH) + 1, _FEWEST)
        stations = Stations.on(surface, np.linspace(begin, end, count))
        steps = np.linalg.norm(np.diff(stations.foot, axis=0), axis=1)
        done = np.concatenate([[0.0], np.cumsum(steps)])
        columns = np.hstack([stations.foot, stations.normal])
        share = done / done[-1] if done[-1] > 0 else np.linspace(0.0, 1.0, count)  # twice the same place
        return cls(float(done[-1]), CubicSpline(share, columns))

    def at(self, share: Floats) -> Course:
        """Foot, normal and their rates per part of the way, at parts (n,) of it."""
        value, rate = self._spline(share), self._spline(share, 1)
        size = np.linalg.norm(value[:, 3:], axis=1, keepdims=True)
        normal = value[:, 3:] / size
        along = (normal * rate[:, 3:]).sum(axis=1, keepdims=True)
        return value[:, :3], rate[:, :3], normal, (rate[:, 3:] - along * normal) / size

    def duration(self, clearance: float, speed: float, turn_speed: float) -> float:
        """How long a smooth way above it takes [s] at speeds [m/s] and [rad/s] that are not passed."""
        _, foot_rate, _, normal_rate = self.at(np.linspace(0.0, 1.0, _LOOKS))
        way = np.linalg.norm(foot_rate + clearance * normal_rate, axis=1).max()
        turn = np.linalg.norm(normal_rate, axis=1).max()
        return max(PEAK * float(way) / speed, PEAK * float(turn) / turn_speed, _SHORTEST)


@dataclass(frozen=True)
class StationFootway:
    """From station to station; `progress` counts them from 0, with parts of the way between two."""

    stations: Stations
    legs: Sequence[SurfaceLine]
    progress: KnotProfile

    def at(self, time: Floats) -> Course:
        """Foot, normal and their rates at times (n,) [s]."""
        progress, rate = self.progress.at(time)
        number = np.clip(np.floor(progress).astype(int), 0, max(len(self.legs) - 1, 0))
        foot, normal = self.stations.foot[number].copy(), self.stations.normal[number].copy()
        foot_rate, normal_rate = np.zeros_like(foot), np.zeros_like(foot)
        for i in np.unique(number).tolist() if self.legs else ():
            rows = number == i
            columns = self.legs[i].at(progress[rows] - i)
            foot[rows], normal[rows] = columns[0], columns[2]
            foot_rate[rows], normal_rate[rows] = columns[1] * rate[rows, None], columns[3] * rate[rows, None]
        return foot, foot_rate, normal, normal_rate


def footway_along(lines: Sequence[SurfaceLine], progress: KnotProfile) -> StationFootway:
    """The footway along lines that follow one another."""
    ends = [line.at(np.array([0.0, 1.0])) for line in lines]
    stations = Stations(
        np.array([ends[0][0][0], *(end[0][1] for end in ends)]), np.array([ends[0][2][0], *(end[2][1] for end in ends)])
    )
    return StationFootway(stations, lines, progress)
