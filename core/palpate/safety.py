"""Safety: what a motion may be, checked over the whole of it before anything moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from palpate.errors import ConfigurationError
from palpate.limiting import ArmLimits
from palpate.parts import Settings
from palpate.trajectory import OwnMotion, Setpoint, Trajectory
from palpate.units import Acceleration, Angle, AngularSpeed, Force, Length, Speed, Stiffness, Time
from palpate.vectors import Floats

_STEP = 0.002  # [s] between the instants that are checked
_TOLERANCE = 1e-9
_ROUNDING = 1e-9
_CONTRADICTION = 1e-3  # [m/s] between stated velocity and what the positions do


@dataclass(frozen=True)
class Reach:
    """What a motion asks of an arm."""

    low: Floats  # (3,) [m]
    high: Floats  # (3,) [m]
    speed: float  # [m/s]
    acceleration: float  # [m/s^2]

    @classmethod
    def of(cls, times: Floats, setpoint: Setpoint) -> Reach:
        """Of setpoints at times (n,) [s]: what the positions do counts as much as the stated velocity."""
        position, velocity, step = setpoint.position, setpoint.velocity, np.diff(times)[:, None]
        moved = np.diff(position, axis=0) / step
        sudden = max(_largest(np.diff(velocity, axis=0) / step), _largest(np.diff(moved, axis=0) / step[1:]))
        speed = max(_largest(velocity), _largest(moved)) + setpoint.fastest_turn * setpoint.lever
        return cls(position.min(axis=0), position.max(axis=0), speed, sudden)


@dataclass(frozen=True)
class Excess:
    """One limit that a motion breaks."""

    what: Literal["low", "high", "speed", "acceleration"]
    axis: str  # x, y or z; of speed and acceleration none
    value: float  # [SI]
    limit: float  # [SI]


@dataclass(frozen=True)
class MotionLimits:
    """How far, fast and sudden a tip may go: the same for a run, a calibration and a design."""

    low: tuple[float, ...]  # (3,) [m]
    high: tuple[float, ...]  # (3,) [m]
    speed: float  # [m/s]
    acceleration: float  # [m/s^2]

    @classmethod
    def of_heights(cls, low: float, high: float, speed: float, acceleration: float) -> MotionLimits:
        """Limits that are the same all over the skin; heights in [m]."""
        return cls((-math.inf, -math.inf, low), (math.inf, math.inf, high), speed, acceleration)

    def tighter(self, other: MotionLimits) -> MotionLimits:
        """The tighter of two limits each."""
        return MotionLimits(
            tuple(map(max, self.low, other.low)),
            tuple(map(min, self.high, other.high)),
            min(self.speed, other.speed),
            min(self.acceleration, other.acceleration),
        )

    def excesses(self, reach: Reach) -> list[Excess]:
        """Every limit that a motion breaks."""
        found = []
        for i, axis in enumerate("xyz"):
            if reach.low[i] < self.low[i] - _TOLERANCE:
                found.append(Excess("low", axis, float(reach.low[i]), self.low[i]))
            if reach.high[i] > self.high[i] + _TOLERANCE:
                found.append(Excess("high", axis, float(reach.high[i]), self.high[i]))
        if reach.speed > self.speed + _TOLERANCE:
            found.append(Excess("speed", "", reach.speed, self.speed))
        if reach.acceleration > self.acceleration + _TOLERANCE:
            found.append(Excess("acceleration", "", reach.acceleration, self.acceleration))
        return found


class SafetySettings(Settings):
    """The ``[safety]`` table: limits of a motion, and what stops it. A live robot does not move without one.

    Between a force of `stop_force` on the skin and the tip at rest lie the time tau, which is the delay of the sensor's
    filter and the latency, and the braking at deceleration a. Against a material of stiffness K the force rises by
    K (v tau + v^2/2a) in that time: where this exceeds `force` for the fastest inward speed v, the motion is refused.
    """

    low: tuple[Length, ...] = Field(
        min_length=3,
        max_length=3,
        description="corner of the workspace box in the work frame; its z is the depth limit",
    )
    high: tuple[Length, ...] = Field(min_length=3, max_length=3, description="the opposite corner")
    speed: Speed = Field(default=0.05, gt=0, le=1.0, description="fastest tip")
    acceleration: Acceleration = Field(default=1.0, gt=0, le=50.0, description="largest acceleration of the tip")
    orientation: Angle = Field(
        default=math.radians(5.0),
        gt=0,
        le=0.5,
        description="largest angle between the tool and the work frame, at the start and in motion",
    )
    angular_speed: AngularSpeed = Field(
        default=math.radians(10.0), gt=0, le=1.0, description="fastest turn of the tool, on the way to the start"
    )
    force: Force = Field(gt=0, le=1e4, description="force that must not be exceeded")
    stop_force: Force = Field(gt=0, le=1e4, description="force that stops the motion, along any axis, tared")
    stiffness: Stiffness = Field(ge=1.0, le=1e9, description="stiffest material that the tip may meet")
    latency: Time = Field(default=0.05, gt=0, description="longest time from a reading to the beginning of braking")
    sensor_delay: Time | None = Field(
        default=None,
        ge=0,
        le=1.0,
        description="of the sensor's filter; left out: what the force's delay or the device says",
    )
    deceleration: Acceleration = Field(default=1.0, gt=0, description="of braking")
    stale: Time = Field(default=0.1, gt=0, description="a sensor or robot that is silent for longer stops the motion")
    held_up: Time = Field(
        default=0.5, gt=0, description="this program being held up for longer, by others or by itself, stops the motion"
    )
    standstill: Time = Field(
        default=1.0, ge=0.2, description="standstill in free air before the motion: tare and noise"
    )
    standstill_force: Force = Field(
        default=5.0, gt=0, description="largest reading at standstill, weight and offset together"
    )
    standstill_noise: Force = Field(
        default=0.6, gt=0, description="largest standard deviation of the force at standstill"
    )
    standstill_speed: Speed = Field(
        default=0.005, gt=0, description="largest standard deviation of the velocity at standstill"
    )
    standstill_excess: float = Field(
        default=3.0, gt=1, description="how many times the noise that a filter was told the noise at standstill may be"
    )

    @property
    def reaction(self) -> float:
        """Time [s] from a force on the skin to the beginning of braking: delay of the sensor's filter and latency."""
        return self.latency + (self.sensor_delay or 0.0)

    def overshoot(self, speed: float) -> float:
        """Force [N] by which the limit is overrun at an inward speed [m/s]: K (v tau + v^2/2a)."""
        return self.stiffness * (speed * self.reaction + speed**2 / (2.0 * self.deceleration))

    @property
    def motion(self) -> MotionLimits:
        """Of the motion alone, without the force."""
        return MotionLimits(self.low, self.high, self.speed, self.acceleration)

    @property
    def fastest(self) -> float:
        """Inward speed [m/s] at which the overshoot just fits between `stop_force` and `force`."""
        way = max(self.force - self.stop_force, 0.0) / self.stiffness
        a, tau = self.deceleration, self.reaction
        return a * (math.sqrt(tau**2 + 2.0 * way / a) - tau)

    @property
    def of_an_arm(self) -> ArmLimits:
        """What an arm has to keep by itself."""
        return ArmLimits(self.low, self.high, self.speed, self.acceleration, self.orientation, self.angular_speed)


@dataclass(frozen=True)
class MotionReport:
    """A motion against its limits."""

    duration: float  # [s]
    low: Floats  # (3,) [m]
    high: Floats  # (3,) [m]
    speed: float  # [m/s]
    inward_speed: float  # [m/s]
    acceleration: float  # [m/s^2]
    peak_force: float  # [N] at most, by computation, when the force limit trips
    problems: tuple[str, ...]


def check_motion(trajectory: Trajectory, limits: SafetySettings) -> MotionReport:
    """Every setpoint of a motion against the limits."""
    times = np.arange(0.0, trajectory.total_duration + _STEP, _STEP)
    return check_setpoints(times, trajectory.at(times), limits)


def check_setpoints(times: Floats, setpoint: Setpoint, limits: SafetySettings) -> MotionReport:
    """Setpoints at times (n,) [s] against the limits."""
    reach, moved = Reach.of(times, setpoint), np.diff(setpoint.position, axis=0) / np.diff(times)[:, None]
    inward = max(float((-column[:, 2]).max(initial=0.0)) for column in (setpoint.velocity, moved))
    finite = bool(np.isfinite(setpoint.position).all() and np.isfinite(setpoint.velocity).all())
    problems = [] if finite else ["a setpoint is not a finite number"]
    problems += [_sentence(excess) for excess in limits.motion.excesses(reach)]
    problems += _contradiction(moved, setpoint.velocity, limits.acceleration * np.diff(times))
    problems += _too_hard(inward, limits)
    if setpoint.fastest_turn > limits.angular_speed * (1.0 + _ROUNDING):
        turn, most = math.degrees(setpoint.fastest_turn), math.degrees(limits.angular_speed)
        problems.append(f"the tool turns at {turn:.1f} deg/s, over the limit of {most:.1f} deg/s")
    return MotionReport(
        float(times[-1] - times[0]),
        reach.low,
        reach.high,
        reach.speed,
        inward,
        reach.acceleration,
        limits.stop_force + limits.overshoot(inward),
        tuple(problems),
    )


def _largest(vectors: Floats) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


def _contradiction(moved: Floats, velocity: Floats, change: Floats) -> list[str]:
    """Where positions do not move as the stated velocity says; within a step it may change by so much (n,)."""
    stated = 0.5 * (velocity[1:] + velocity[:-1])
    apart = np.linalg.norm(moved - stated, axis=1) - change
    if not len(apart) or not float(np.nanmax(apart, initial=0.0)) > _CONTRADICTION:
        return []
    worst = int(np.nanargmax(apart))
    told, seen = (1e3 * float(np.linalg.norm(column[worst])) for column in (stated, moved))
    return [f"the setpoints move at {seen:.1f} mm/s where their stated velocity is {told:.1f} mm/s"]


def _sentence(excess: Excess) -> str:
    value, limit = excess.value, excess.limit
    match excess.what:
        case "low":
            return f"{excess.axis} goes to {1e3 * value:.2f} mm, below the limit of {1e3 * limit:.2f} mm"
        case "high":
            return f"{excess.axis} goes to {1e3 * value:.2f} mm, above the limit of {1e3 * limit:.2f} mm"
        case "speed":
            return f"the speed is {1e3 * value:.1f} mm/s, over the limit of {1e3 * limit:.1f} mm/s"
        case "acceleration":
            return f"the acceleration is {value:.2f} m/s^2, over {limit:.2f} m/s^2"


def _too_hard(inward: float, limits: SafetySettings) -> list[str]:
    peak = limits.stop_force + limits.overshoot(inward)
    if peak <= limits.force:
        return []
    return [
        f"at {1e3 * inward:.1f} mm/s inwards the force could reach {peak:.1f} N before the tip stands, over "
        f"{limits.force:g} N; with these limits {1e3 * limits.fastest:.1f} mm/s is the fastest approach"
    ]


def check_own_motion(own: OwnMotion, limits: SafetySettings) -> tuple[str, ...]:
    """What an arm does by itself against the limits, as far as that is known before it says where it stands."""
    problems = _too_hard(own.speed, limits)
    if own.speed > limits.speed:
        problems.insert(0, _sentence(Excess("speed", "", own.speed, limits.speed)))
    problems = [f"the way to the start: {problem}" for problem in problems]
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
