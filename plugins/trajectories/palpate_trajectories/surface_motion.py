"""Motions over a surface: a foot on it, the normal there, and a depth along that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from palpate import Floats, Setpoint, Surface, angular_velocities, surface_points

from palpate_trajectories.motion_parts import Wave
from palpate_trajectories.smooth_profile import PEAK, KnotProfile
from palpate_trajectories.stations import Stations, rotation_rate, rotation_to

_LOOKS = 33  # places of a way between two stations at which its height is looked at
_STEEPEST = 3.44  # largest slope of the bump over such a way, of its height
_ROUNDS = 30
_SHORTEST = 1e-3  # [s]

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
class Leg:
    """The way from one station to the next, in parts s of it from 0 to 1.

    The foot goes straight, lifted by h 64 s^3 (1 - s)^3 so that the tip keeps its clearance over the surface; the
    normal goes along the great circle (Shoemake 1985).
    """

    begin: Floats  # (3,) [m]
    end: Floats
    first: Floats  # (3,) normals
    last: Floats
    lift: float  # [m]

    @property
    def angle(self) -> float:
        """Between both normals [rad]."""
        return float(np.arctan2(np.linalg.norm(np.cross(self.first, self.last)), self.first @ self.last))

    @property
    def _up(self) -> Floats:
        middle = self.first + self.last
        return np.asarray(middle / np.linalg.norm(middle))

    def at(self, share: Floats) -> Course:
        """Foot, normal and their rates per part of the way, at parts (n,) of it."""
        s, left = share[:, None], 1.0 - share[:, None]
        foot = self.begin + s * (self.end - self.begin) + 64.0 * self.lift * (s * left) ** 3 * self._up
        foot_rate = self.end - self.begin + 192.0 * self.lift * (s * left) ** 2 * (1.0 - 2.0 * s) * self._up
        angle = self.angle
        if angle < 1e-9:
            return foot, foot_rate, np.tile(self.first, (len(s), 1)), np.zeros((len(s), 3))
        ahead = (self.last - np.cos(angle) * self.first) / np.sin(angle)
        normal = np.cos(s * angle) * self.first + np.sin(s * angle) * ahead
        return foot, foot_rate, normal, angle * (np.cos(s * angle) * ahead - np.sin(s * angle) * self.first)

    def duration(self, clearance: float, speed: float, turn_speed: float) -> float:
        """How long it takes [s] at speeds [m/s] and [rad/s] that are not passed."""
        way = float(np.linalg.norm(self.end - self.begin)) + _STEEPEST * self.lift + clearance * self.angle
        return max(PEAK * way / speed, PEAK * self.angle / turn_speed, _SHORTEST)


def legs_over(surface: Surface, stations: Stations, clearance: float) -> list[Leg]:
    """The ways from each station to the next, with the tip above the surface by a clearance [m] all along.

    Raises ConfigurationError where the surface is not known below a way.
    """
    pairs = zip(stations.foot[:-1], stations.foot[1:], stations.normal[:-1], stations.normal[1:], strict=True)
    return [_leg(surface, *pair, clearance) for pair in pairs]


def _leg(surface: Surface, begin: Floats, end: Floats, first: Floats, last: Floats, clearance: float) -> Leg:
    leg, share = Leg(begin, end, first, last, 0.0), np.linspace(0.0, 1.0, _LOOKS)
    bump = 64.0 * (share * (1.0 - share)) ** 3
    for _ in range(_ROUNDS):
        foot, _, normal, _ = leg.at(share)
        lacking = 0.98 * clearance - surface_points(surface, foot + clearance * normal).height
        inner = (lacking > 0) & (bump > 0.01)
        if not inner.any():
            return leg
        leg = Leg(begin, end, first, last, leg.lift + 1.1 * float((lacking[inner] / bump[inner]).max()))
    return leg


@dataclass(frozen=True)
class StationFootway:
    """From station to station; `progress` counts them from 0, with parts of the way between two."""

    stations: Stations
    legs: Sequence[Leg]
    progress: KnotProfile

    def at(self, time: Floats) -> Course:
        """Foot, normal and their rates at times (n,) [s]."""
        progress, rate = self.progress.at(time)
        number = np.clip(np.floor(progress).astype(int), 0, max(len(self.stations) - 2, 0))
        foot, normal = self.stations.foot[number].copy(), self.stations.normal[number].copy()
        foot_rate, normal_rate = np.zeros_like(foot), np.zeros_like(foot)
        for i in np.unique(number).tolist() if self.legs else ():
            rows = number == i
            columns = self.legs[i].at(progress[rows] - i)
            foot[rows], normal[rows] = columns[0], columns[2]
            foot_rate[rows], normal_rate[rows] = columns[1] * rate[rows, None], columns[3] * rate[rows, None]
        return foot, foot_rate, normal, normal_rate
