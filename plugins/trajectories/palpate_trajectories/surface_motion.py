"""Motions over a surface: a foot on it, the normal there, and a depth along that."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from palpate import Floats, Setpoint, Surface, angular_velocities
from palpate_kit.kinematics.turns_to_normals import rotation_rate, rotation_to

from palpate_trajectories.motion_parts import Wave, add_wave, is_within
from palpate_trajectories.smooth_profile import PEAK, KnotProfile
from palpate_trajectories.stations import Stations

_SLOPE_CHECKS = 101  # a choice: places of a line at which its slopes are taken, 1 % of it apart
_MIN_DURATION = 1e-3  # [s], a choice: of the way between two stations that are one place; times have to increase
_PITCH = 0.5e-3  # [m], a choice: between the stations of a line; a finer one costs look-ups on the surface
_MIN_STATIONS = 9  # a choice: of a line, so that a short one bends, too

Course = tuple[Floats, Floats, Floats, Floats]  # foot [m] and its rate, normal and its rate, each (n, 3)


class Footway(Protocol):
    """The path of the tip's foot on the surface over time."""

    def at(self, time: Floats) -> Course:
        """Return foot, normal and their rates at times (n,) [s]."""
        ...


@dataclass(frozen=True)
class SurfaceMotion:
    """The whole motion of a trajectory over a surface: foot(t) - depth(t) n(t), the tool along n(t)."""

    duration: float  # [s]
    footway: Footway
    depth: KnotProfile  # [m] along the normal
    measuring: tuple[tuple[float, float], ...]  # stretches of time [s]
    swell: KnotProfile
    wave: Wave
    wave_start: float

    def at(self, time: Floats) -> Setpoint:
        """Return setpoints at times (n,) [s]: a depth below feet on the surface, along its normals (n, 3)."""
        t = np.asarray(time, float)
        foot, foot_rate, normal, normal_rate = self.footway.at(t)
        depth, rate = self.depth.at(t)
        depth, rate = add_wave(
            time=t, depth=depth, rate=rate, swell=self.swell, wave=self.wave, wave_start=self.wave_start
        )
        # The tip along the normal, whose turn moves it, too; the tool turns with the normal.
        position = foot - depth[:, None] * normal
        velocity = foot_rate - rate[:, None] * normal - depth[:, None] * normal_rate
        rotation = rotation_to(normal)
        turning = angular_velocities(rotation, rotation_rate(normal, normal_rate))
        return Setpoint(
            position=position,
            velocity=velocity,
            measuring=is_within(t, self.measuring),
            rotation=rotation,
            angular_velocity=turning,
        )


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
        """Return the line between two places [x, y]; raises ConfigurationError where it leaves the surface."""
        from scipy.interpolate import CubicSpline

        # Stations along the line, and the spline through them over parts of the length.
        count = max(math.ceil(math.dist(begin, end) / _PITCH) + 1, _MIN_STATIONS)
        stations = Stations.on(surface, np.linspace(begin, end, count))
        steps = np.linalg.norm(np.diff(stations.foot, axis=0), axis=1)
        distance = np.concatenate([[0.0], np.cumsum(steps)])
        columns = np.hstack([stations.foot, stations.normal])
        length = float(distance[-1])
        share = distance / length if length > 0 else np.linspace(0.0, 1.0, count)  # twice the same place
        return cls(length, CubicSpline(share, columns))

    def at(self, share: Floats) -> Course:
        """Return foot, normal and their rates per part of the way, at parts (n,) of it."""
        # The spline's normal is made a unit vector, and its rate the part across it.
        value, rate = self._spline(share), self._spline(share, 1)
        size = np.linalg.norm(value[:, 3:], axis=1, keepdims=True)
        normal = value[:, 3:] / size
        along = (normal * rate[:, 3:]).sum(axis=1, keepdims=True)
        return value[:, :3], rate[:, :3], normal, (rate[:, 3:] - along * normal) / size

    def duration(self, clearance: float, speed: float, turn_speed: float) -> float:
        """Return the duration of a smooth way above it [s] at speeds [m/s] and [rad/s] that are not exceeded."""
        # A smooth move is at most PEAK times as fast as on average; the tip at the clearance moves with the turn.
        _, foot_rate, _, normal_rate = self.at(np.linspace(0.0, 1.0, _SLOPE_CHECKS))
        way = np.linalg.norm(foot_rate + clearance * normal_rate, axis=1).max()
        turn = np.linalg.norm(normal_rate, axis=1).max()
        return max(PEAK * float(way) / speed, PEAK * float(turn) / turn_speed, _MIN_DURATION)


@dataclass(frozen=True)
class StationFootway:
    """From station to station; `progress` counts them from 0, with parts of the way between two."""

    stations: Stations
    legs: Sequence[SurfaceLine]
    progress: KnotProfile

    def at(self, time: Floats) -> Course:
        """Return foot, normal and their rates at times (n,) [s]."""
        # Each time is on a leg, which is taken at the leg's own part of the way.
        progress, rate = self.progress.at(time)
        number = np.clip(np.floor(progress).astype(int), 0, max(len(self.legs) - 1, 0))
        foot, normal = self.stations.foot[number].copy(), self.stations.normal[number].copy()
        foot_rate, normal_rate = np.zeros_like(foot), np.zeros_like(foot)
        for i in np.unique(number).tolist() if self.legs else ():
            rows = number == i
            foot[rows], foot_slope, normal[rows], normal_slope = self.legs[i].at(progress[rows] - i)
            foot_rate[rows] = foot_slope * rate[rows, None]
            normal_rate[rows] = normal_slope * rate[rows, None]
        return foot, foot_rate, normal, normal_rate


def footway_along(lines: Sequence[SurfaceLine], progress: KnotProfile) -> StationFootway:
    """Return the footway along lines that follow one another."""
    # The stations are the first line's beginning and the end of each line.
    feet, normals = list[Floats](), list[Floats]()
    for line in lines:
        foot, _, normal, _ = line.at(np.array([0.0, 1.0]))
        feet += list(foot) if not feet else [foot[1]]
        normals += list(normal) if not normals else [normal[1]]
    return StationFootway(Stations(np.array(feet), np.array(normals)), lines, progress)
