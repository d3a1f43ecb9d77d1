"""A motion against its limits, the whole of it, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np
from palpate.errors import ConfigurationError
from palpate.rotation_vectors import angular_velocities
from palpate.surface import Surface, surface_points
from palpate.trajectory import OwnMotion, Setpoint, Trajectory, duration_of, setpoints_at, surface_of
from palpate.vectors import Floats

from palpate_engine.safety.motion_limits import Excess, Reach
from palpate_engine.safety.settings import SafetySettings
from palpate_engine.safety.tool_clearance import ToolGap, tool_clearance

_STEP = 0.002  # [s] between the instants that are checked, that of a servo loop of 500 Hz
_STRETCH, _COMMON = 30_000, 2  # instants, a minute; what two stretches share, for accelerations are of three of them
_TOLERANCE = 1e-9  # [m] or [m/s^2]; rounding of setpoints and decelerations that are exactly at a limit
_ROUNDING = 1e-9  # relative; likewise of a turn
_TURN_CONTRADICTION = 5e-3  # [rad/s] between stated turn and what the rotations do: a choice
_ROUNDED_ANGLE = 1e-6  # [rad]; a cosine near 1 is not known better
_CONTRADICTION = 1e-3  # [m/s] between stated velocity and what the positions do: a choice


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
    unfelt_force: float  # [N] at most, in the stiffest material at the nominal skin, whatever the sensor reads
    problems: tuple[str, ...]


def check_motion(trajectory: Trajectory, limits: SafetySettings) -> MotionReport:
    """Return every setpoint of a motion against the limits; of one of hours a stretch is in memory at a time."""
    count = math.ceil((duration_of(trajectory) + _STEP) / _STEP)
    spans = (np.arange(max(first - _COMMON, 0), min(first + _STRETCH, count)) for first in range(0, count, _STRETCH))
    times = (np.asarray(span * _STEP, np.float64) for span in spans)
    surface = surface_of(trajectory)
    whole = _whole_motion(((time, setpoints_at(trajectory, time)) for time in times), limits, surface)
    return _report(whole, limits, surface, _ends_pressed_in(whole))


def check_setpoints(
    times: Floats, setpoint: Setpoint, limits: SafetySettings, surface: Surface | None = None
) -> MotionReport:
    """Return the report of setpoints at times (n,) [s] against the limits, over a surface if one is given."""
    return _report(_Stretch.of(times, setpoint, limits, surface), limits, surface)


@dataclass(frozen=True)
class _Stretch:
    """Extremes of setpoints one after the other."""

    times: tuple[float, float]  # [s] first and last
    reach: Reach
    inward: float  # [m/s]
    turn: float  # [rad/s]
    turn_apart: float  # [rad/s] by which the stated turn and what the rotations do are apart
    askew: float  # [rad] between tool and normal
    depth: float  # [m] below the surface, along its normal
    heights: tuple[float, float]  # [m] over the skin, first and last
    clearance: ToolGap  # of the tool above the tip from the surface
    finite: bool
    apart: tuple[float, float, float]  # [m/s] stated velocity and what the positions do: too far apart by, and both

    @classmethod
    def of(cls, times: Floats, setpoint: Setpoint, limits: SafetySettings, surface: Surface | None) -> _Stretch:
        """Return the extremes of a stretch of setpoints at times (n,) [s], over a surface if one is given."""
        # The velocity that the positions have, in addition to the stated one.
        moved = np.diff(setpoint.position, axis=0) / np.diff(times)[:, None]
        normal, depth = np.broadcast_to(np.array([0.0, 0.0, 1.0]), setpoint.position.shape), 0.0
        height = setpoint.position[:, 2]
        clearance = ToolGap()
        if surface is not None:
            points = surface_points(surface, setpoint.position)
            normal, height = points.normal, points.height
            depth = float((-height).max(initial=0.0))
            if limits.tool is not None:
                clearance = tool_clearance(limits.tool, times, setpoint, surface)
        turn, turn_apart = _turns(times, setpoint)
        return cls(
            times=(float(times[0]), float(times[-1])),
            reach=Reach.of(times, setpoint),
            # Into the skin: by the stated velocity, and by the positions along the normals at both ends of a step.
            inward=max(
                float((-(speed * out).sum(axis=1)).max(initial=0.0))
                for speed, out in ((setpoint.velocity, normal), (moved, normal[1:]), (moved, normal[:-1]))
            ),
            turn=turn,
            turn_apart=turn_apart,
            askew=float(np.arccos(np.clip((setpoint.axes * normal).sum(axis=1), -1.0, 1.0)).max(initial=0.0)),
            depth=depth,
            heights=(float(height[0]), float(height[-1])),
            clearance=clearance,
            finite=bool(np.isfinite(setpoint.position).all() and np.isfinite(setpoint.velocity).all()),
            apart=_contradiction(moved, setpoint.velocity, limits.acceleration * np.diff(times)),
        )

    def and_of(self, other: _Stretch) -> _Stretch:
        """Return the extremes of this stretch and the one after it."""
        return _Stretch(
            times=(self.times[0], other.times[1]),
            reach=self.reach.and_of(other.reach),
            inward=max(self.inward, other.inward),
            turn=max(self.turn, other.turn),
            turn_apart=max(self.turn_apart, other.turn_apart),
            askew=max(self.askew, other.askew),
            depth=max(self.depth, other.depth),
            heights=(self.heights[0], other.heights[1]),
            clearance=min(self.clearance, other.clearance),
            finite=self.finite and other.finite,
            apart=max(self.apart, other.apart),
        )


def _whole_motion(
    stretches: Iterable[tuple[Floats, Setpoint]], limits: SafetySettings, surface: Surface | None
) -> _Stretch:
    """Return the extremes of all stretches of a motion, each its times (n,) [s] and setpoints."""
    return reduce(_Stretch.and_of, (_Stretch.of(times, setpoint, limits, surface) for times, setpoint in stretches))


def _report(whole: _Stretch, limits: SafetySettings, surface: Surface | None, more: Iterable[str] = ()) -> MotionReport:
    """Return the report of a whole motion; `more` problems are added to those of the limits."""
    reach, inward, (contradiction, stated, done) = whole.reach, whole.inward, whole.apart
    # The limits of the workspace, then what contradicts itself, force, turns, depth and clearance.
    problems = [] if whole.finite else ["a setpoint is not a finite number"]
    problems += [_excess_text(excess) for excess in limits.motion.excesses(reach)]
    if contradiction > _CONTRADICTION:
        problems.append(
            f"the setpoints move at {1e3 * done:.1f} mm/s where their stated velocity is {1e3 * stated:.1f} mm/s"
        )
    problems += _force_problems(inward, limits)
    if whole.turn > limits.angular_speed * (1.0 + _ROUNDING):
        turn, limit = math.degrees(whole.turn), math.degrees(limits.angular_speed)
        problems.append(f"the tool turns at {turn:.1f} deg/s, over the limit of {limit:.1f} deg/s")
    problems += _orientation_problems(whole, limits, surface is not None)
    problems += [*_clearance_problems(whole.clearance), *more]
    return MotionReport(
        duration=whole.times[1] - whole.times[0],
        low=reach.low,
        high=reach.high,
        speed=reach.speed,
        inward_speed=inward,
        acceleration=reach.acceleration,
        peak_force=limits.stop_force + limits.overshoot(inward),
        unfelt_force=limits.stiffness * max(whole.depth if surface is not None else -float(reach.low[2]), 0.0),
        problems=tuple(problems),
    )


def _orientation_problems(whole: _Stretch, limits: SafetySettings, on_surface: bool) -> list[str]:
    """Return what is wrong with the orientation of the tool, and with the depth below a surface."""
    problems = []
    if whole.turn_apart > _TURN_CONTRADICTION:
        problems.append(
            f"the tool turns by {math.degrees(whole.turn_apart):.2f} deg/s otherwise than its stated angular velocity"
        )
    if whole.askew > limits.orientation + _ROUNDED_ANGLE:
        off, limit = math.degrees(whole.askew), math.degrees(limits.orientation)
        reference = "the surface's normal" if on_surface else "the work frame's"
        problems.append(
            f"the tool is {off:.1f} deg off {reference}, over the limit of {limit:.1f} deg ([safety] orientation)"
        )
    if on_surface and limits.depth is None:
        problems.append("a motion over a surface needs [safety] depth, the largest depth below it")
    if limits.depth is not None and whole.depth > limits.depth + _TOLERANCE:
        problems.append(
            f"the tip goes {1e3 * whole.depth:.2f} mm below the surface, over the limit of {1e3 * limits.depth:.2f} mm "
            "([safety] depth)"
        )
    return problems


def _ends_pressed_in(whole: _Stretch) -> list[str]:
    """Return the problem of a motion after which the tip would stay in the material, if it is one.

    A motion ends above the skin, or at least where it began.
    """
    first, last = whole.heights
    if not last < min(first, 0.0) - _TOLERANCE:
        return []
    return [
        f"it ends with the tip {-1e3 * last:.2f} mm below the skin, where the tip would stay: a motion ends above the "
        "skin, or as high as it began"
    ]


def _clearance_problems(clearance: ToolGap) -> list[str]:
    """Return what is wrong with the way of the tool above the tip."""
    if clearance.distance > 0.0:
        return []
    place = ", ".join(f"{axis} {1e3 * value:.1f}" for axis, value in zip("xyz", clearance.place))
    return [
        f"{clearance.time:.2f} s after the start the tool above the tip comes {-1e3 * clearance.distance:.1f} mm too "
        f"near to the surface ({place} mm), whose uncertainty counts twice ([safety] tool); a longer tip keeps it away"
    ]


def _turns(times: Floats, setpoint: Setpoint) -> tuple[float, float]:
    """Return the fastest turn [rad/s], stated or done, and how far both are apart beyond what the stated one changes
    by."""
    if setpoint.rotation is None or setpoint.angular_velocity is None or len(times) < 2:
        return setpoint.fastest_turn, 0.0
    middle = 0.5 * (setpoint.rotation[1:] + setpoint.rotation[:-1])
    done = angular_velocities(middle, np.diff(setpoint.rotation, axis=0) / np.diff(times)[:, None])
    stated = 0.5 * (setpoint.angular_velocity[1:] + setpoint.angular_velocity[:-1])
    change = np.linalg.norm(np.diff(setpoint.angular_velocity, axis=0), axis=1)
    # Within a step the stated turn may change by the difference of its ends.
    excess = np.linalg.norm(done - stated, axis=1) - change
    fastest = max(setpoint.fastest_turn, float(np.linalg.norm(done, axis=1).max()))
    return fastest, float(max(excess.max(), 0.0))


def _contradiction(moved: Floats, velocity: Floats, change: Floats) -> tuple[float, float, float]:
    """Return by how much [m/s] positions move otherwise than stated, at worst, and the stated and the done speed [m/s]
    there.

    Within a step (n,) the stated velocity may change by `change` [m/s].
    """
    stated = 0.5 * (velocity[1:] + velocity[:-1])
    excess = np.linalg.norm(moved - stated, axis=1) - change
    if np.isnan(excess).all():
        return 0.0, 0.0, 0.0
    worst = int(np.nanargmax(excess))
    return float(excess[worst]), float(np.linalg.norm(stated[worst])), float(np.linalg.norm(moved[worst]))


def _excess_text(excess: Excess) -> str:
    """Return the sentence on a limit that a motion breaks."""
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


def _force_problems(inward: float, limits: SafetySettings) -> list[str]:
    """Return the problem of a speed inwards [m/s] at which the force could pass its limit before the tip stands."""
    peak = limits.stop_force + limits.overshoot(inward)
    if peak <= limits.force:
        return []
    return [
        f"at {1e3 * inward:.1f} mm/s inwards the force could reach {peak:.1f} N before the tip stands, over "
        f"{limits.force:g} N; with these limits {1e3 * limits.fastest:.1f} mm/s is the fastest approach"
    ]


def check_own_motion(motion: OwnMotion, limits: SafetySettings) -> tuple[str, ...]:
    """Return, in sentences, the limits that an arm's own motion breaks: its way to the start, braking, retreat, stop.

    It is checked before the arm is connected: the distance to the start is not known yet.
    """
    start_problems = []
    if motion.speed > limits.speed:
        start_problems.append(_excess_text(Excess("speed", axis="", value=motion.speed, limit=limits.speed)))
    start_problems += _force_problems(motion.speed, limits)
    problems = [f"the way to the start: {problem}" for problem in start_problems]
    if motion.deceleration < limits.deceleration - _TOLERANCE:
        problems.append(
            f"the arm brakes at {motion.deceleration:g} m/s^2, but the force limit counts on the deceleration of "
            f"{limits.deceleration:g} m/s^2"
        )
    if limits.retract_speed is not None and limits.retract_speed > motion.followed_speed:
        problems.append(
            f"[safety] retract_speed = {1e3 * limits.retract_speed:g} mm/s leaves it farther behind its commands than "
            f"tracking allows, which is {1e3 * motion.followed_speed:.0f} mm/s by its lag: lower the one, raise "
            "the other"
        )
    key, force = motion.stop or ("", math.inf)  # at which its controller stops the arm
    if force <= limits.stop_force:
        problems.append(
            f"{key} is {force:g} N, at which the controller stops the arm in the material: it must be above [safety] "
            f"stop_force = {limits.stop_force:g} N, at which the arm leaves it"
        )
    if limits.stop_force > motion.yield_force:
        problems.append(
            f"at {motion.yield_force:.3g} N the arm's controller has given way by as much as `tracking` allows, and "
            f"[safety] stop_force = {limits.stop_force:g} N stops it later: raise `tracking`, or the stiffness of the "
            "controller (is that stated in N/m?)"
        )
    return tuple(problems)


def demand_safe(trajectory: Trajectory, limits: SafetySettings, where: str) -> MotionReport:
    """Return the report of a motion that keeps every limit; raises ConfigurationError with all that it breaks."""
    report = check_motion(trajectory, limits)
    if report.problems:
        lines = "\n".join(f"  {problem}" for problem in report.problems)
        raise ConfigurationError(f"{where}: the motion breaks the limits of [safety]:\n{lines}")
    return report
