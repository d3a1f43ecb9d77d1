"""A motion against its limits, the whole of it, before anything moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.errors import ConfigurationError
from palpate.safety.motion_limits import Excess, Reach
from palpate.safety.settings import SafetySettings
from palpate.trajectory import OwnMotion, Setpoint, Trajectory
from palpate.vectors import Floats

_STEP = 0.002  # [s] between the instants that are checked
_TOLERANCE = 1e-9
_ROUNDING = 1e-9
_CONTRADICTION = 1e-3  # [m/s] between stated velocity and what the positions do


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


def _contradiction(moved: Floats, velocity: Floats, change: Floats) -> list[str]:
    """Where positions do not move as the stated velocity says; within a step it may change by so much (n,)."""
    stated = 0.5 * (velocity[1:] + velocity[:-1])
    apart = np.linalg.norm(moved - stated, axis=1) - change
    if not len(apart) or not float(np.nanmax(apart, initial=0.0)) > _CONTRADICTION:
        return []
    worst = int(np.nanargmax(apart))
    stated_speed, seen = (1e3 * float(np.linalg.norm(column[worst])) for column in (stated, moved))
    return [f"the setpoints move at {seen:.1f} mm/s where their stated velocity is {stated_speed:.1f} mm/s"]


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
