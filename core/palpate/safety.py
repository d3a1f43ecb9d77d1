"""Safety: what a motion may be, checked over the whole of it before anything moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from palpate.errors import ConfigurationError
from palpate.parts import Settings
from palpate.trajectory import OwnMotion, Setpoint, Trajectory
from palpate.units import Acceleration, Force, Length, Speed, Stiffness, Time

_STEP = 0.002  # [s] between the instants that are checked
_TOLERANCE = 1e-9


class SafetySettings(Settings):
    """The ``[safety]`` table: limits of a motion, and what stops it. A live robot does not move without one.

    Between a reading at `stop_force` and the tip at rest lie the latency tau and the braking at deceleration a. Against
    a material of stiffness K the force rises by K (v tau + v^2/2a) in that time: where this exceeds `force` for the
    fastest inward speed v, the motion is refused.
    """

    low: tuple[Length, ...] = Field(
        min_length=3,
        max_length=3,
        description="corner of the workspace box in the work frame; its z is the depth limit",
    )
    high: tuple[Length, ...] = Field(min_length=3, max_length=3, description="the opposite corner")
    speed: Speed = Field(default=0.05, gt=0, description="fastest tip")
    acceleration: Acceleration = Field(default=1.0, gt=0, description="largest acceleration of the tip")
    force: Force = Field(gt=0, description="force that must not be exceeded")
    stop_force: Force = Field(gt=0, description="force that stops the motion, along any axis, tared")
    stiffness: Stiffness = Field(gt=0, description="stiffest material that the tip may meet")
    latency: Time = Field(default=0.05, gt=0, description="longest time from a reading to the beginning of braking")
    deceleration: Acceleration = Field(default=1.0, gt=0, description="of braking")
    stale: Time = Field(default=0.1, gt=0, description="a sensor or robot that is silent for longer stops the motion")
    rest: Time = Field(default=1.0, ge=0.2, description="rest in free air before the motion: tare and noise")
    rest_force: Force = Field(default=20.0, gt=0, description="largest reading at rest, weight and offset together")
    rest_noise: Force = Field(default=0.6, gt=0, description="largest standard deviation of the force at rest")
    rest_speed: Speed = Field(default=0.005, gt=0, description="largest standard deviation of the velocity at rest")

    rest_excess: float = Field(
        default=3.0, gt=1, description="how many times the noise that a filter was told the noise at rest may be"
    )

    def overshoot(self, speed: float) -> float:
        """Force [N] by which the limit is overrun at an inward speed [m/s]: K (v tau + v^2/2a)."""
        return self.stiffness * (speed * self.latency + speed**2 / (2.0 * self.deceleration))

    @property
    def fastest(self) -> float:
        """Inward speed [m/s] at which the overshoot just fits between `stop_force` and `force`."""
        way = max(self.force - self.stop_force, 0.0) / self.stiffness
        a, tau = self.deceleration, self.latency
        return a * (math.sqrt(tau**2 + 2.0 * way / a) - tau)


@dataclass(frozen=True)
class MotionReport:
    """A motion against its limits."""

    duration: float  # [s]
    low: NDArray[np.float64]  # (3,) [m]
    high: NDArray[np.float64]  # (3,) [m]
    speed: float  # [m/s]
    inward_speed: float  # [m/s]
    acceleration: float  # [m/s^2]
    peak_force: float  # [N] at most, by computation, when the force limit trips
    problems: tuple[str, ...]


def check_motion(trajectory: Trajectory, limits: SafetySettings) -> MotionReport:
    """Every setpoint of a motion against the limits."""
    times = np.arange(0.0, trajectory.total_duration + _STEP, _STEP)
    return check_setpoints(times, trajectory.at(times), limits)


def check_setpoints(times: NDArray[np.float64], setpoint: Setpoint, limits: SafetySettings) -> MotionReport:
    """Setpoints at times (n,) [s] against the limits."""
    position, velocity = setpoint.position, setpoint.velocity
    speed = np.linalg.norm(velocity, axis=1)
    acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / np.diff(times)
    hardest = float(acceleration.max(initial=0.0))
    inward = float(np.maximum(-velocity[:, 2], 0.0).max())
    finite = bool(np.isfinite(position).all() and np.isfinite(velocity).all())
    problems = [] if finite else ["a setpoint is not a finite number"]
    for axis, name in enumerate("xyz"):
        least, most = float(position[:, axis].min()), float(position[:, axis].max())
        if least < limits.low[axis] - _TOLERANCE:
            problems.append(f"{name} goes to {1e3 * least:.2f} mm, below the limit of {1e3 * limits.low[axis]:.2f} mm")
        if most > limits.high[axis] + _TOLERANCE:
            problems.append(f"{name} goes to {1e3 * most:.2f} mm, above the limit of {1e3 * limits.high[axis]:.2f} mm")
    problems += _too_fast(float(speed.max()), inward, limits)
    if hardest > limits.acceleration:
        problems.append(f"the acceleration is {hardest:.2f} m/s^2, over {limits.acceleration:.2f} m/s^2")
    return MotionReport(
        float(times[-1] - times[0]),
        position.min(axis=0),
        position.max(axis=0),
        float(speed.max()),
        inward,
        hardest,
        limits.stop_force + limits.overshoot(inward),
        tuple(problems),
    )


def _too_fast(speed: float, inward: float, limits: SafetySettings) -> list[str]:
    problems = []
    if speed > limits.speed:
        problems.append(f"the speed is {1e3 * speed:.1f} mm/s, over the limit of {1e3 * limits.speed:.1f} mm/s")
    peak = limits.stop_force + limits.overshoot(inward)
    if peak > limits.force:
        problems.append(
            f"at {1e3 * inward:.1f} mm/s inwards the force could reach {peak:.1f} N before the tip stands, over "
            f"{limits.force:g} N; with these limits {1e3 * limits.fastest:.1f} mm/s is the fastest approach"
        )
    return problems


def check_own_motion(own: OwnMotion, limits: SafetySettings) -> tuple[str, ...]:
    """What an arm does by itself against the limits, as far as that is known before it says where it stands."""
    problems = [f"the way to the start: {problem}" for problem in _too_fast(own.speed, own.speed, limits)]
    if own.deceleration < limits.deceleration - _TOLERANCE:
        problems.append(
            f"the arm brakes at {own.deceleration:g} m/s^2, but the force limit counts on the deceleration of "
            f"{limits.deceleration:g} m/s^2"
        )
    return tuple(problems)


def demand_safe(trajectory: Trajectory, limits: SafetySettings, where: str) -> MotionReport:
    """The report of a motion that keeps every limit; raises ConfigurationError with all that it breaks."""
    report = check_motion(trajectory, limits)
    if report.problems:
        lines = "\n".join(f"  {problem}" for problem in report.problems)
        raise ConfigurationError(f"{where}: the motion breaks the limits of [safety]:\n{lines}")
    return report
