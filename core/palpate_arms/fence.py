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

_WINDOW = 10  # periods over which speeds are averaged: the command of a PD law carries the noise of what it measures
_MORE = 1.2  # what a command may do for a moment, in limits
_SLACK = 4e-3  # [m/s] of noise in one command
_EXCESS = 2e-3  # [m/s] of noise in a measured speed
_MARGIN = 1e-3  # [m] that a command may lead, or a measured tip may swing, over the box of the setpoints
_SUDDEN = 1.5
_ASKEW = 1.5  # limits between a measured tool and the normal; a command has one, and the arm follows it within one


class Fence:
    """Limits of `[safety]`, once they are set, and those of the arm itself."""

    def __init__(
        self, own: dict[str, Any], work: WorkFrame, tool: Floats, model: ArmModel, acceleration: float
    ) -> None:
        self._work, self._tracking = work, own["tracking"]
        self._posture = PostureFence(own, tool, model)
        self._acceleration = acceleration  # [m/s^2] of what the arm does by itself
        self.limits: dict[str, Any] | None = None
        self.plane = LEVEL  # of the station, as commanded
        self._commands: deque[Floats] = deque(maxlen=2 * _WINDOW + 1)
        self._speeds: deque[Floats] = deque(maxlen=_WINDOW)
        self._lag = own.get("lag", 0.0)
        self._deadband = own.get("deadband", 0.0)
        self.give = self._deadband  # [m] by which the arm may stand off its command, also at the force that stops it
        self._following = TrackingError(self._lag, self._deadband)
        self.begin(np.zeros(3))

    def begin(self, command: Floats) -> None:
        """A motion begins, from rest."""
        self._commands.extend([command.copy()] * (2 * _WINDOW + 1))
        self._speeds.clear()
        self._following.begin(command)

    def give_way(self, deflection: float) -> None:
        """Allow for an arm that gives way by so much [m] to the force that stops it, up to `tracking`."""
        self.give = min(deflection, self._tracking) + self._deadband

    @property
    def lead(self) -> float:
        """How far [m] a command may be ahead of the tip: by what the allowed speed makes of the servo's lag.

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
        """Rows (n, 16) of a plan, before anything moves."""
        if not np.isfinite(rows).all():
            return Verdict("a setpoint is not a finite number")
        if self.limits is None:
            return None
        low, high = np.array(self.limits["low"]), np.array(self.limits["high"])
        position, stated = rows[:, SETPOINT["position"]], rows[:, SETPOINT["velocity"]]
        if (verdict := self._outside(position, low - 1e-6, high + 1e-6, "a setpoint")) is not None:
            return verdict
        moved = np.diff(position, axis=0) / PERIOD
        for what, velocity in (("the setpoints move", moved), ("the setpoints state that they move", stated)):
            fastest = float(np.linalg.norm(velocity, axis=1).max(initial=0.0))
            if fastest > self.limits["speed"] * 1.001 + 1e-6:
                return Verdict(f"{what} at {1e3 * fastest:.1f} mm/s, over the limit of {mm(self.limits['speed'])}/s")
            sudden = np.linalg.norm(np.diff(velocity, axis=0), axis=1).max(initial=0.0) / PERIOD
            if sudden > self.limits["acceleration"] * 1.01 + 1e-3:
                limit = self.limits["acceleration"]
                return Verdict(f"the setpoints accelerate at {sudden:.2f} m/s^2, over the limit of {limit:g} m/s^2")
        return self._turns(rows)

    def _turns(self, rows: Floats) -> Verdict | None:
        """How the tool of rows (n, 16) turns, and how it stands to the planes of their stations; their depths."""
        assert self.limits is not None
        fastest, most = fastest_turn(rows[:, PLAN["turn"]]), self.limits["angular_speed"]
        if fastest > most * 1.001 + 1e-6:
            text = f"{math.degrees(fastest):.1f} deg/s, over the limit of {math.degrees(most):g} deg/s"
            return Verdict(f"the setpoints turn the tool at {text}")
        extremes, most = StationExtremes.of(rows, self._work), self.limits["orientation"]
        if not extremes.are_planes:
            return Verdict("the normal of a station is not of length 1")
        if extremes.angle > most * 1.001 + 1e-5:
            text = f"{math.degrees(extremes.angle):.1f} deg off its normal, over {math.degrees(most):g} deg"
            return Verdict(f"a setpoint has the tool {text}")
        return self._too_deep(extremes.depth, 1e-6, "a setpoint")

    def _too_deep(self, depth: float, slack: float, what: str) -> Verdict | None:
        most = math.inf if self.limits is None else self.limits.get("depth", math.inf)
        if depth <= most + slack:
            return None
        return Verdict(f"{what} is {mm(depth)} below the surface, over the limit of {mm(most)}")

    def command(
        self, command: Floats, turn: Floats, before: tuple[Floats, Floats], seen: ArmState, leaving: bool = False
    ) -> Verdict | None:
        """Judge a command before it is sent, after the one `before` (position and turn).

        An arm that is `leaving` the material brakes first: that may carry it over the box.
        """
        if not all(map(math.isfinite, (*command.tolist(), *turn.tolist()))):
            return Verdict("a command is not a finite number")
        self._commands.append(command.copy())
        verdict = None if leaving else self._out_of_box(command.tolist(), "a command")
        return (
            verdict
            or (None if leaving else self._too_deep(-self.plane.height(command), _MARGIN, "a command"))
            or self._speeds_of(command, turn, before, leaving)
            or self._from_arm(command, turn, before, seen, leaving)
        )

    def taken_back(self) -> None:
        """The latest command was not sent."""
        self._commands.pop()

    def in_motion(self, command: Floats, seen: ArmState) -> Verdict | None:
        """Judge the robot's own state, on the approach or in the motion."""
        if (text := self._following.complaint(command, seen.position, seen.fresh, self.give)) is not None:
            return Verdict(text, False)
        if self.limits is None:
            return None
        verdict = self._out_of_box(seen.position.tolist(), "the tip")
        verdict = verdict or self._too_deep(-self.plane.height(seen.position), _MARGIN, "the tip")
        if (angle := self.plane.off_tool(seen.rotation, self._work)) > _ASKEW * self.limits["orientation"]:
            most = math.degrees(self.limits["orientation"])
            return Verdict(f"the tool is {math.degrees(angle):.1f} deg off the normal, over {most:g} deg", False)
        self._speeds.append(seen.velocity)
        speed = length(sum(self._speeds, np.zeros(3))) / len(self._speeds)
        if len(self._speeds) == _WINDOW and speed > _MORE * self.limits["speed"] + _EXCESS:
            return Verdict(f"the tip moves at {1e3 * speed:.1f} mm/s: the limit is {mm(self.limits['speed'])}/s", False)
        return verdict

    def in_retraction(self, seen: ArmState) -> Verdict | None:
        """Judge the robot's own state while it leaves faster than it may move otherwise."""
        if self._outward_limit is None:
            return None
        self._speeds.append(seen.velocity)
        velocity = sum(self._speeds, np.zeros(3)) / len(self._speeds)
        if len(self._speeds) < _WINDOW or not self._is_over(velocity, _EXCESS, True):
            return None
        return Verdict(
            f"the tip leaves at {1e3 * length(velocity):.1f} mm/s: the limit is {mm(self._outward_limit)}/s outwards "
            f"([safety] retract_speed), and {mm(self._speed_limit)}/s otherwise",
            False,
        )

    @property
    def _speed_limit(self) -> float:
        return math.inf if self.limits is None else float(self.limits["speed"])

    @property
    def _outward_limit(self) -> float | None:
        """[m/s] of a retraction, where one is stated that exceeds the speed of the motion."""
        limit = 0.0 if self.limits is None else self.limits.get("retract_speed", 0.0)
        return limit if limit > self._speed_limit else None

    def _is_over(self, velocity: Floats, noise: float, leaving: bool) -> bool:
        """Return True for a velocity (3,) [m/s] that exceeds what a limit allows for a moment.

        In a retraction the part outwards along the normal has a limit of its own, if one is stated.
        """
        most, outward_limit = self._speed_limit, self._outward_limit
        if leaving and outward_limit is not None and (outwards := float(velocity @ self.plane.normal)) > 0.0:
            if outwards > _MORE * outward_limit + noise:
                return True
            velocity = velocity - outwards * self.plane.normal
        return length(velocity) > _MORE * most + noise

    def _outside(self, position: Floats, low: Floats, high: Floats, what: str) -> Verdict | None:
        assert self.limits is not None
        for axis, name in enumerate("xyz"):
            least, most = float(position[:, axis].min()), float(position[:, axis].max())
            for value, wrong, key in ((least, least < low[axis], "low"), (most, most > high[axis], "high")):
                if wrong:
                    way, limit = "below" if key == "low" else "above", self.limits[key][axis]
                    return Verdict(f"{what} is at {name} = {1e3 * value:.2f} mm, {way} the limit of {mm(limit)}")
        return None

    def _out_of_box(self, place: list[float], what: str) -> Verdict | None:
        """One place, which may lead or swing a little; plain floats, for numpy takes ten times as long."""
        if self.limits is None:
            return None
        for x, low, high, name in zip(place, self.limits["low"], self.limits["high"], "xyz", strict=True):
            if not low - _MARGIN <= x <= high + _MARGIN:
                way, limit = ("below", low) if x < low else ("above", high)
                return Verdict(f"{what} is at {name} = {1e3 * x:.2f} mm, {way} the limit of {mm(limit)}")
        return None

    def _speeds_of(self, command: Floats, turn: Floats, before: tuple[Floats, Floats], leaving: bool) -> Verdict | None:
        if self.limits is None:
            return None
        verdict = None
        limit, past = self.limits["speed"], self._commands
        velocity = (command - before[0]) / PERIOD
        mean = (past[-1] - past[-1 - _WINDOW]) / (_WINDOW * PERIOD)
        if self._is_over(velocity, _SLACK, leaving) or (length(mean) > 1.1 * limit + 1e-3 and not leaving):
            text = f"{1e3 * length(velocity):.1f} mm/s: the limit is {mm(limit)}/s"
            verdict = Verdict(f"a command would move the tip at {text}")
        earlier = (past[-1 - _WINDOW] - past[0]) / (_WINDOW * PERIOD)
        sudden = length(mean - earlier) / (_WINDOW * PERIOD)
        most = max(self.limits["acceleration"], self._acceleration)
        if sudden > _SUDDEN * most and not leaving:
            verdict = Verdict(f"commands accelerate the tip at {sudden:.2f} m/s^2: the limit is {most:g} m/s^2")
        pace = length(turning(turn, before[1]))
        if pace > 1.05 * self.limits["angular_speed"] + 1e-3:
            most = math.degrees(self.limits["angular_speed"])
            verdict = Verdict(f"a command would turn the tool at {math.degrees(pace):.1f} deg/s: {most:g} is the limit")
        return verdict

    def _from_arm(
        self, command: Floats, turn: Floats, before: tuple[Floats, Floats], seen: ArmState, leaving: bool
    ) -> Verdict | None:
        """Return how far the command is from the arm, and what it asks of its joints."""
        away, lead = length(command - seen.position), self.lead
        if leaving and self._outward_limit is not None:
            lead = self._lead_at(self._outward_limit)
        if away > lead:
            give = f", {mm(self.give)} of it as it gives way" if self.give else ""
            return Verdict(f"the arm does not follow: it is {mm(away)} from its command, over {mm(lead)}{give}", False)
        work = self._work.matrix[:3, :3]
        tool = self._work.tool
        askew = rotation_vector((tool @ rotation_matrix(turn.tolist()) if turn.any() else tool) @ seen.rotation.T)
        limit = self.limits["orientation"] if self.limits is not None else math.inf
        most = math.degrees(limit)
        if (angle := self.plane.off_turn(turn, self._work)) > 1.01 * limit and not leaving:
            what = "the work frame" if self.plane.is_level else "its station"
            return Verdict(f"the tool is {math.degrees(angle):.1f} deg off {what}, over {most:g} deg")
        if (angle := length(askew)) > limit:
            return Verdict(f"the tool is {math.degrees(angle):.1f} deg from its command, over {most:g} deg", False)
        twist = np.concatenate([work @ (command - before[0]) / PERIOD, tool @ turning(turn, before[1])])
        error = np.concatenate([work @ (command - seen.position), askew])
        return self._posture.verdict(twist, error, seen.q, leaving)
