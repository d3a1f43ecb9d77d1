"""The contact of a record: motion, force of a Kelvin-Voigt half-space, by the literature's formulas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from verdict_records.rigs import AIR, Column, Rig

FINE = 4  # steps of the calculation for each reading


@dataclass(frozen=True)
class Specimen:
    """A rig over a material."""

    rig: Rig
    elasticity: float  # [Pa]
    viscosity: float  # [Pa s]

    @cached_property
    def time(self) -> Column:
        """(m,) [s] in fine steps."""
        step = 1.0 / (FINE * self.rig.rate)
        return np.arange(0.0, AIR + _duration(self.rig) + AIR / 2, step)

    @cached_property
    def travel(self) -> Column:
        """(m,) [m] depth of the tip below the skin, negative in air."""
        return _travel(self.rig, self.time)

    @property
    def step(self) -> float:
        """[s]"""
        return 1.0 / (FINE * self.rig.rate)

    def rate_of(self, depth: Column) -> Column:
        """Slope (m,) of a depth in time."""
        return np.gradient(depth, self.step)

    def elastic(self, depth: Column) -> Column:
        """Force (m,) [N] at rest, 2 E* A(d) with nu = 0.5."""
        d, e, size = np.maximum(depth, 0.0), self.elasticity, self.rig.size
        if self.rig.tip == "paraboloid":  # Hertz 1882
            return np.asarray(16 / 9 * e * np.sqrt(size) * d**1.5)
        if self.rig.tip == "flat":  # Boussinesq 1885
            return np.asarray(8 / 3 * e * size * d)
        if self.rig.tip == "sphere":  # Sneddon 1965, with ln((R + a)/(R - a)) = 2 d/a
            a = self.radius(depth)
            in_contact = np.where(a > 0, a, np.inf)
            return np.asarray(4 / 3 * e * ((a**2 + size**2) * d / in_contact - a * size))
        return np.asarray(8 / 3 * e * d**2 / (np.pi * np.tan(size)))  # Love 1939

    def radius(self, depth: Column) -> Column:
        """Contact radius (m,) [m]."""
        d, size = np.maximum(depth, 0.0), self.rig.size
        if self.rig.tip == "paraboloid":
            return np.asarray(np.sqrt(size * d))
        if self.rig.tip == "sphere":
            return _ball_radius(d, size)
        if self.rig.tip == "flat":
            return np.where(d > 0, size, 0.0)
        return np.asarray(2 * d / (np.pi * np.tan(size)))

    def viscous(self, depth: Column, rate: Column) -> Column:
        """Force (m,) [N] of the dashpot, 4 eta/(1 - nu) a(d) d'."""
        return np.asarray(8 * self.viscosity * self.radius(depth) * rate)

    def force(self, depth: Column, elastic: Column | None = None) -> Column:
        """Contact force (m,) [N]; the skin does not pull."""
        elastic = self.elastic(depth) if elastic is None else elastic
        whole = elastic + self.viscous(depth, self.rate_of(depth))
        return np.where(depth > 0, np.maximum(whole, 0.0), 0.0)


def _ball_radius(depth: Column, radius: float) -> Column:
    """Contact radius (m,) [m] of a ball at depths (m,) [m], by bisection of d = (a/2) ln((R + a)/(R - a))."""
    low, high = np.zeros(len(depth)), np.full(len(depth), radius)
    for _ in range(60):
        a = (low + high) / 2
        is_deeper = a / 2 * np.log((radius + a) / np.maximum(radius - a, 1e-300)) > depth
        low, high = np.where(is_deeper, low, a), np.where(is_deeper, a, high)
    return np.where(depth > 0, low, 0.0)


def _duration(rig: Rig) -> float:
    """[s] of the motion."""
    if rig.motion == "sine":
        return 2.0 + max(4.0, 8 * rig.pace)
    return 2.4 * rig.pace if rig.motion == "triangle" else 2.4 * rig.pace + 2.0


def _travel(rig: Rig, time: Column) -> Column:
    """Depth (m,) [m]: from a tenth above the skin (a quarter for a sine) to the deepest, held, back or swung."""
    t, pace, deep = time - AIR, rig.pace, rig.depth
    if rig.motion == "sine":
        approach = np.clip(t, 0.0, 1.0)
        end = _duration(rig) - 1.0
        away = np.clip(t - end, 0.0, 1.0)
        smooth = approach**3 * (10 - 15 * approach + 6 * approach**2) - away**3 * (10 - 15 * away + 6 * away**2)
        ramp = np.clip((t - 1.0) / 0.5, 0, 1) * np.clip((end - t) / 0.5, 0, 1)
        swing = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
        return np.asarray(-0.25 * deep + 1.25 * deep * smooth + 0.2 * deep * np.sin(2 * np.pi * (t - 1) / pace) * swing)
    hold = 2.0 if rig.motion == "hold" else 0.0
    corners = np.array([0.0, 1.2 * pace, 1.2 * pace + hold, 2.4 * pace + hold])
    raw = np.interp(t, corners, [-0.2 * deep, deep, deep, -0.2 * deep])
    width = max(round(0.05 * min(pace, 2.0) / (time[1] - time[0])), 2)
    box = np.ones(2 * width + 1) / (2 * width + 1)
    for _ in range(2):  # two means: a rate without corners
        raw = np.convolve(np.pad(raw, width, mode="edge"), box, mode="valid")
    return np.asarray(raw)
