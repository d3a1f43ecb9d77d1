"""A motion against its limits, the whole of it, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np

from palpate.errors import ConfigurationError
from palpate.safety.motion_limits import Excess, Reach
from palpate.safety.settings import SafetySettings
from palpate.trajectory import OwnMotion, Setpoint, Trajectory, duration_of, setpoints_at
from palpate.vectors import Floats

_STEP = 0.002  # [s] between the instants that are checked
_STRETCH, _COMMON = 30_000, 2  # instants; what two stretches share, for accelerations are of three of them
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
    """Every setpoint of a motion against the limits; of one of hours a stretch is in memory at a time."""
    count = math.ceil((duration_of(trajectory) + _STEP) / _STEP)
    spans = (np.arange(max(first - _COMMON, 0), min(first + _STRETCH, count)) for first in range(0, count, _STRETCH))
    times = (np.asarray(span * _STEP, np.float64) for span in spans)
    return _judged(((time, setpoints_at(trajectory, time)) for time in times), limits)


def check_setpoints(times: Floats, setpoint: Setpoint, limits: SafetySettings) -> MotionReport:
    """Setpoints at times (n,) [s] against the limits."""
    return _judged([(times, setpoint)], limits)


@dataclass(frozen=True)
class _Stretch:
    """What there is to know of setpoints one after the other."""

    times: tuple[float, float]  # [s] first and last
    reach: Reach
    inward: float  # [m/s]
    turn: float  # [rad/s]
    finite: bool
    apart: tuple[float, float, float]  # [m/s] stated velocity and what the positions do: too far apart by, and both

    @classmethod
    def of(cls, times: Floats, setpoint: Setpoint, limits: SafetySettings) -> _Stretch:
        moved = np.diff(setpoint.position, axis=0) / np.diff(times)[:, None]
        return cls(
            (float(times[0]), float(times[-1])),
            Reach.of(times, setpoint),
            max(float((-column[:, 2]).max(initial=0.0)) for column in (setpoint.velocity, moved)),
            setpoint.fastest_turn,
            bool(np.isfinite(setpoint.position).all() and np.isfinite(setpoint.velocity).all()),
            _apart(moved, setpoint.velocity, limits.acceleration * np.diff(times)),
        )

    def and_of(self, other: _Stretch) -> _Stretch:
        """With the one after it."""
        return _Stretch(
            (self.times[0], other.times[1]),
            self.reach.and_of(other.reach),
            max(self.inward, other.inward),
            max(self.turn, other.turn),
            self.finite and other.finite,
            max(self.apart, other.apart),
        )


def _judged(stretches: Iterable[tuple[Floats, Setpoint]], limits: SafetySettings) -> MotionReport:
    whole = reduce(_Stretch.and_of, (_Stretch.of(times, setpoint, limits) for times, setpoint in stretches))
    reach, inward, (apart, stated, seen) = whole.reach, whole.inward, whole.apart
    problems = [] if whole.finite else ["a setpoint is not a finite number"]
    problems += [_sentence(excess) for excess in limits.motion.excesses(reach)]
    if apart > _CONTRADICTION:
        problems.append(
            f"the setpoints move at {1e3 * seen:.1f} mm/s where their stated velocity is {1e3 * stated:.1f} mm/s"
        )
    problems += _too_hard(inward, limits)
    if whole.turn > limits.angular_speed * (1.0 + _ROUNDING):
        turn, most = math.degrees(whole.turn), math.degrees(limits.angular_speed)
        problems.append(f"the tool turns at {turn:.1f} deg/s, over the limit of {most:.1f} deg/s")
    return MotionReport(
        whole.times[1] - whole.times[0],
        reach.low,
        reach.high,
        reach.speed,
        inward,
        reach.acceleration,
        limits.stop_force + limits.overshoot(inward),
        tuple(problems),
    )


def _apart(moved: Floats, velocity: Floats, change: Floats) -> tuple[float, float, float]:
    """Where positions move least as the stated velocity says, which within a step may change by so much (n,)."""
    stated = 0.5 * (velocity[1:] + velocity[:-1])
    apart = np.linalg.norm(moved - stated, axis=1) - change
    if np.isnan(apart).all():
        return 0.0, 0.0, 0.0
    worst = int(np.nanargmax(apart))
    return float(apart[worst]), float(np.linalg.norm(stated[worst])), float(np.linalg.norm(moved[worst]))


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
