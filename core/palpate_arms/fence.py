"""The fence: every command is checked before it is sent, and the robot's state while it moves."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.arm_model import ArmModel
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.arm_lag import DELAY, STATIC_ERROR
from palpate_arms.arm_state import ArmState
from palpate_arms.posture_fence import PostureFence, Verdict
from palpate_arms.setpoint_buffer import PERIOD
from palpate_arms.setpoint_rows import PLAN, SETPOINT
from palpate_arms.station_plane import LEVEL, StationExtremes
from palpate_arms.tool_turns import fastest_turn, turning
from palpate_arms.tracking_error import TrackingError, length, mm

# Choices. Of commands and measured states:
_WINDOW = 10  # periods over which speeds are averaged: the command of a PD law carries the noise of what it measures
_MOMENT_SHARE = 1.2  # of the speed limit, for a moment: two steps of the kit's own ways in one tick are below it (0151)
_COMMAND_NOISE = 4e-3  # [m/s] in one command
_MEASURED_NOISE = 2e-3  # [m/s] in a measured speed
_MEAN_SHARE, _MEAN_NOISE = 1.1, 1e-3  # of the speed limit, and [m/s], for the mean over the window
_MARGIN = 1e-3  # [m] that a command may lead, or a measured tip may swing, over the box of the setpoints
_ACCELERATION_SHARE = 1.5  # of the limit, for the change between two windows
_TURN_SHARE, _TURN_NOISE = 1.05, 1e-3  # of the angular speed limit, and [rad/s]
_ORIENTATION_SHARE = 1.01  # of the limit, for a commanded tool
_TOOL_SHARE = 1.5  # of the limit, for a measured tool: a command has one, and the arm follows it within one
# Of setpoints, which are checked as they are: rounding of positions and of their differences.
_PLAN_SHARE, _PLAN_ROUNDING = 1.001, 1e-6  # of a limit of speed or angle, and [m], [m/s], [rad/s]
_PLAN_ACCELERATION_SHARE, _PLAN_ACCELERATION_ROUNDING = 1.01, 1e-3  # of the limit, and [m/s^2]
_PLAN_ANGLE_ROUNDING = 1e-5  # [rad]
_MM = 1e3  # per metre


class Fence:
    """Limits of `[safety]`, once they are set, and those of the arm itself."""

    def __init__(
        self, arm_facts: dict[str, Any], work: WorkFrame, tool: Floats, model: ArmModel, acceleration: float
    ) -> None:
        """Take limits and facts of the arm itself, the frame of the commands, the tool (4, 4) and the arm's model."""
        self._work, self._tracking = work, arm_facts["tracking"]  # the latter: [m] that it may be behind
        self._posture = PostureFence(arm_facts, tool, model)
        self._acceleration = acceleration  # [m/s^2] of what the arm does by itself
        self.limits: dict[str, Any] | None = None
        self.plane = LEVEL  # of the station, as commanded
        self._commands: deque[Floats] = deque(maxlen=2 * _WINDOW + 1)  # two windows: acceleration is between them
        self._speeds: deque[Floats] = deque(maxlen=_WINDOW)
        self._lag = arm_facts.get("lag", 0.0)
        self._deadband = arm_facts.get("deadband", 0.0)
        self.give = self._deadband  # [m] by which the arm may stand off its command, also at the force that stops it
        self._following = TrackingError(self._lag, self._deadband)
        self.begin(np.zeros(3))

    def begin(self, command: Floats) -> None:
        """Begin a motion, from rest."""
        self._commands.extend([command.copy()] * (2 * _WINDOW + 1))
        self._speeds.clear()
        self._following.begin(command)

    def give_way(self, deflection: float) -> None:
        """Allow for an arm that gives way by so much [m] to the force that stops it, up to `tracking`."""
        self.give = min(deflection, self._tracking) + self._deadband

    @property
    def lead(self) -> float:
        """The distance [m] that a command may be ahead of the tip: the allowed speed times the servo's lag.

        So much at most the arm leaps where it has been held and comes free, and a law that integrates cannot wind up
        further. An arm whose controller gives way to a force is behind its command by that as well.
        """
        return self._lead_at(math.inf if self.limits is None else self.limits["speed"])

    def _lead_at(self, speed: float) -> float:
        """Return how far [m] a command may be ahead of the tip at a speed [m/s]; any speed without limits."""
        if self.limits is None:
            return float(self._tracking)
        way = speed * (self._lag + DELAY)
        return float(min(self._tracking, max(way, STATIC_ERROR) + self.give))

    def table(self, rows: Floats) -> Verdict | None:
        """Return the limit that rows (n, 16) of a plan break, before anything moves; None where they keep all."""
        if not np.isfinite(rows).all():
            return Verdict("a setpoint is not a finite number")
        if self.limits is None:
            return None
        # The box, then speed and acceleration: of the positions and of the stated velocities.
        low, high = np.array(self.limits["low"]), np.array(self.limits["high"])
        position, stated = rows[:, SETPOINT["position"]], rows[:, SETPOINT["velocity"]]
        if (verdict := self._outside(position, low - _PLAN_ROUNDING, high + _PLAN_ROUNDING, "a setpoint")) is not None:
            return verdict
        by_positions = np.diff(position, axis=0) / PERIOD
        for subject, velocity in (("the setpoints move", by_positions), ("the setpoints state that they move", stated)):
            fastest = float(np.linalg.norm(velocity, axis=1).max(initial=0.0))
            if fastest > self.limits["speed"] * _PLAN_SHARE + _PLAN_ROUNDING:
                return Verdict(f"{subject} at {_MM * fastest:.1f} mm/s, over the limit of {mm(self.limits['speed'])}/s")
            acceleration = np.linalg.norm(np.diff(velocity, axis=0), axis=1).max(initial=0.0) / PERIOD
            limit = self.limits["acceleration"]
            if acceleration > limit * _PLAN_ACCELERATION_SHARE + _PLAN_ACCELERATION_ROUNDING:
                return Verdict(
                    f"the setpoints accelerate at {acceleration:.2f} m/s^2, over the limit of {limit:g} m/s^2"
                )
        return self._turns(rows)

    def _turns(self, rows: Floats) -> Verdict | None:
        """Return the limit that rows (n, 16) break by turns, angles to the planes of their stations, or depths."""
        assert self.limits is not None
        fastest, limit = fastest_turn(rows[:, PLAN["turn"]]), self.limits["angular_speed"]
        if fastest > limit * _PLAN_SHARE + _PLAN_ROUNDING:
            text = f"{math.degrees(fastest):.1f} deg/s, over the limit of {math.degrees(limit):g} deg/s"
            return Verdict(f"the setpoints turn the tool at {text}")
        extremes, limit = StationExtremes.of(rows, self._work), self.limits["orientation"]
        if not extremes.are_planes:
            return Verdict("the normal of a station is not of length 1")
        if extremes.angle > limit * _PLAN_SHARE + _PLAN_ANGLE_ROUNDING:
            text = f"{math.degrees(extremes.angle):.1f} deg off its normal, over {math.degrees(limit):g} deg"
            return Verdict(f"a setpoint has the tool {text}")
        return self._too_deep(extremes.depth, _PLAN_ROUNDING, "a setpoint")

    def _too_deep(self, depth: float, slack: float, subject: str) -> Verdict | None:
        """Return a depth [m] below the plane that is over the limit by more than a slack [m]; else None."""
        limit = math.inf if self.limits is None else self.limits.get("depth", math.inf)
        if depth <= limit + slack:
            return None
        return Verdict(f"{subject} is {mm(depth)} below the surface, over the limit of {mm(limit)}")

    def command(
        self, command: Floats, turn: Floats, previous: tuple[Floats, Floats], state: ArmState, leaving: bool = False
    ) -> Verdict | None:
        """Return the limit that a command breaks before it is sent, after the `previous` one (position and turn).

        An arm that is `leaving` the material brakes first: that may carry it over the box.
        """
        if not all(map(math.isfinite, (*command.tolist(), *turn.tolist()))):
            return Verdict("a command is not a finite number")
        self._commands.append(command.copy())
        verdict = None if leaving else self._out_of_box(command.tolist(), "a command")
        return (
            verdict
            or (None if leaving else self._too_deep(-self.plane.height(command), _MARGIN, "a command"))
            or self._speeds_of(command, turn, previous, leaving)
            or self._from_arm(command, turn, previous, state, leaving)
        )

    def taken_back(self) -> None:
        """Take back the latest command, which was not sent."""
        self._commands.pop()

    def in_motion(self, command: Floats, state: ArmState) -> Verdict | None:
        """Return the limit that the robot's own state breaks, on the approach or in the motion; None if it keeps all.

        A verdict with False is one after which the arm is not trusted to leave the material on its own.
        """
        if (text := self._following.complaint(command, state.position, state.fresh, self.give)) is not None:
            return Verdict(text, False)
        if self.limits is None:
            return None
        # Box and depth; then orientation and speed, by which an arm is not trusted any more.
        verdict = self._out_of_box(state.position.tolist(), "the tip")
        verdict = verdict or self._too_deep(-self.plane.height(state.position), _MARGIN, "the tip")
        if (angle := self.plane.off_tool(state.rotation, self._work)) > _TOOL_SHARE * self.limits["orientation"]:
            limit = math.degrees(self.limits["orientation"])
            return Verdict(f"the tool is {math.degrees(angle):.1f} deg off the normal, over {limit:g} deg", False)
        self._speeds.append(state.velocity)
        speed = length(sum(self._speeds, np.zeros(3))) / len(self._speeds)
        if len(self._speeds) == _WINDOW and speed > _MOMENT_SHARE * self.limits["speed"] + _MEASURED_NOISE:
            return Verdict(f"the tip moves at {_MM * speed:.1f} mm/s: the limit is {mm(self.limits['speed'])}/s", False)
        return verdict

    def in_retraction(self, state: ArmState) -> Verdict | None:
        """Judge the robot's own state while it leaves faster than it may move otherwise."""
        if self._outward_limit is None:
            return None
        self._speeds.append(state.velocity)
        velocity = sum(self._speeds, np.zeros(3)) / len(self._speeds)
        if len(self._speeds) < _WINDOW or not self._is_over(velocity, _MEASURED_NOISE, True):
            return None
        return Verdict(
            f"the tip leaves at {_MM * length(velocity):.1f} mm/s: the limit is {mm(self._outward_limit)}/s outwards "
            f"([safety] retract_speed), and {mm(self._speed_limit)}/s otherwise",
            False,
        )

    @property
    def _speed_limit(self) -> float:
        """The limit of the speed [m/s]; infinite without one."""
        return math.inf if self.limits is None else float(self.limits["speed"])

    @property
    def _outward_limit(self) -> float | None:
        """The limit [m/s] of a retraction, where one is stated that exceeds the speed of the motion; else None."""
        limit = 0.0 if self.limits is None else self.limits.get("retract_speed", 0.0)
        return limit if limit > self._speed_limit else None

    def _is_over(self, velocity: Floats, noise: float, leaving: bool) -> bool:
        """Return True for a velocity (3,) [m/s] that exceeds what a limit allows for a moment.

        In a retraction the part outwards along the normal has a limit of its own, if one is stated.
        """
        limit, outward_limit = self._speed_limit, self._outward_limit
        if leaving and outward_limit is not None and (outwards := float(velocity @ self.plane.normal)) > 0.0:
            if outwards > _MOMENT_SHARE * outward_limit + noise:
                return True
            velocity = velocity - outwards * self.plane.normal
        return length(velocity) > _MOMENT_SHARE * limit + noise

    def _outside(self, position: Floats, low: Floats, high: Floats, subject: str) -> Verdict | None:
        """Return the first axis along which positions (n, 3) [m] are out of a box, `low` to `high` (3,); or None."""
        assert self.limits is not None
        for axis, name in enumerate("xyz"):
            lowest, highest = float(position[:, axis].min()), float(position[:, axis].max())
            if lowest < low[axis]:
                limit = mm(self.limits["low"][axis])
                return Verdict(f"{subject} is at {name} = {_MM * lowest:.2f} mm, below the limit of {limit}")
            if highest > high[axis]:
                limit = mm(self.limits["high"][axis])
                return Verdict(f"{subject} is at {name} = {_MM * highest:.2f} mm, above the limit of {limit}")
        return None

    def _out_of_box(self, place: list[float], subject: str) -> Verdict | None:
        """Return the first axis along which a place (3,) [m] is out of the box by more than a margin; else None.

        By plain floats, for numpy takes ten times as long.
        """
        if self.limits is None:
            return None
        for x, low, high, name in zip(place, self.limits["low"], self.limits["high"], "xyz", strict=True):
            if not low - _MARGIN <= x <= high + _MARGIN:
                way, limit = ("below", low) if x < low else ("above", high)
                return Verdict(f"{subject} is at {name} = {_MM * x:.2f} mm, {way} the limit of {mm(limit)}")
        return None

    def _speeds_of(
        self, command: Floats, turn: Floats, previous: tuple[Floats, Floats], leaving: bool
    ) -> Verdict | None:
        """Return the limit that a command breaks by its speed, its acceleration or its turn; the last of these.

        The mean speed is that over a window, the acceleration its change from the window before.
        """
        if self.limits is None:
            return None
        verdict = None
        limit, past = self.limits["speed"], self._commands
        velocity = (command - previous[0]) / PERIOD
        mean = (past[-1] - past[-1 - _WINDOW]) / (_WINDOW * PERIOD)
        if self._is_over(velocity, _COMMAND_NOISE, leaving) or (
            length(mean) > _MEAN_SHARE * limit + _MEAN_NOISE and not leaving
        ):
            text = f"{_MM * length(velocity):.1f} mm/s: the limit is {mm(limit)}/s"
            verdict = Verdict(f"a command would move the tip at {text}")
        earlier_mean = (past[-1 - _WINDOW] - past[0]) / (_WINDOW * PERIOD)
        acceleration = length(mean - earlier_mean) / (_WINDOW * PERIOD)
        limit = max(self.limits["acceleration"], self._acceleration)
        if acceleration > _ACCELERATION_SHARE * limit and not leaving:
            verdict = Verdict(f"commands accelerate the tip at {acceleration:.2f} m/s^2: the limit is {limit:g} m/s^2")
        turn_speed = length(turning(turn, previous[1]))
        if turn_speed > _TURN_SHARE * self.limits["angular_speed"] + _TURN_NOISE:
            limit = math.degrees(self.limits["angular_speed"])
            text = f"{math.degrees(turn_speed):.1f} deg/s: {limit:g} is the limit"
            verdict = Verdict(f"a command would turn the tool at {text}")
        return verdict

    def _from_arm(
        self, command: Floats, turn: Floats, previous: tuple[Floats, Floats], state: ArmState, leaving: bool
    ) -> Verdict | None:
        """Return the limit that a command breaks by its distance from the arm, its orientation, or the joints' ways.

        A verdict with False is one after which the arm is not trusted to leave the material on its own.
        """
        # Position: ahead of the tip by no more than the lead.
        distance, lead = length(command - state.position), self.lead
        if leaving and self._outward_limit is not None:
            lead = self._lead_at(self._outward_limit)
        if distance > lead:
            give = f", {mm(self.give)} of it as it gives way" if self.give else ""
            return Verdict(
                f"the arm does not follow: it is {mm(distance)} from its command, over {mm(lead)}{give}", False
            )
        # Orientation: off the normal, and off the measured tool.
        work = self._work.matrix[:3, :3]
        tool = self._work.tool
        tool_error = rotation_vector((tool @ rotation_matrix(turn.tolist()) if turn.any() else tool) @ state.rotation.T)
        limit = self.limits["orientation"] if self.limits is not None else math.inf
        degrees = math.degrees(limit)
        if (angle := self.plane.off_turn(turn, self._work)) > _ORIENTATION_SHARE * limit and not leaving:
            reference = "the work frame" if self.plane.is_level else "its station"
            return Verdict(f"the tool is {math.degrees(angle):.1f} deg off {reference}, over {degrees:g} deg")
        if (angle := length(tool_error)) > limit:
            return Verdict(f"the tool is {math.degrees(angle):.1f} deg from its command, over {degrees:g} deg", False)
        # Joints: by the command's twist, and by the error of the arm, both in the base.
        twist = np.concatenate([work @ (command - previous[0]) / PERIOD, tool @ turning(turn, previous[1])])
        error = np.concatenate([work @ (command - state.position), tool_error])
        return self._posture.verdict(twist, error, state.q, leaving)
