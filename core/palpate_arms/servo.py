"""Commands of the servo loop: positions in the work frame and turns of the tool, one in each period."""

from __future__ import annotations

import math

import numpy as np
from palpate import Floats, ForceLaw

from palpate_arms.force_control import ForceLead
from palpate_arms.servo_law import ServoLaw, own_law, straight_path
from palpate_arms.setpoint_buffer import PERIOD, Plan
from palpate_arms.setpoint_rows import PLAN, SETPOINT
from palpate_arms.station_plane import LEVEL, StationPlane
from palpate_arms.tool_turns import turn_after, turn_from_to

_Z, _VZ = SETPOINT["position"].start + 2, SETPOINT["velocity"].start + 2
# Choices.
_MAX_BEHIND = 25.0  # periods; what is later is not made up for
_TRAVEL_SHARE = (
    0.8  # of the height at which a motion begins and goes from touch to touch: below are its ways in and out
)
_MAX_HASTE = 0.1  # share by which a motion may be faster than planned, to make up for what the host held up
_NO_SPEED = 1e-9  # [m/s] and [rad/s], in place of 0 in a quotient
_HOME_DISTANCE = 1e-5  # [m] from home at which a retraction ends, where its speed is below
_HOME_STEPS = 2  # changes of speed in a period
_BRAKING = 2.0  # v^2 = 2 a s: the speed from which an acceleration brings it to rest within a way


class Commander:
    """The tip's next place, in each of its modes: hold, retreat, go to the start, follow a plan, or retract.

    The orientation is a rotation vector of the tool from the work frame's orientation, in the tool's frame; it becomes
    that of the first setpoint on the way to the start, and then follows the plan. The plane is that of the station.
    """

    def __init__(self, law: ServoLaw, position: Floats, turn: Floats | None = None) -> None:
        """Hold the tip at a position (3,) [m] with a turn (3,) [rad]; the law bounds what the arm does by itself."""
        self.law = law
        self.command = position.copy()  # (3,) the latest
        self.turn = np.zeros(3) if turn is None else turn.copy()  # (3,) the latest
        self._speed = np.zeros(3)
        self._previous = self.command, self._speed, self.turn
        self.plane = LEVEL  # of the station
        self._plan = Plan.of(np.zeros((0, SETPOINT.size)))
        # The row of the plan, the rows that are made up for in a period at most, and those that are late.
        self._row, self._haste, self._behind = 0.0, 0.0, 0.0
        self._way: list[tuple[Floats, float]] = []  # place, and the part of the turn that remains
        self._turn_from, self._turn_by = self.turn, np.zeros(3)  # rotation vectors at the begin of a way, and along it
        self.lead: ForceLead | None = None  # of a force; the plan is then an envelope
        self.home: Floats | None = None  # (3,) [m] where the motion began
        self._clearance: float | None = None  # [m] of home over the plane of the first station
        self.mode = "hold"  # "hold", "retreat", "stay", "approach", "follow", "retract", "done"

    @property
    def setpoint(self) -> Floats:
        """Position and velocity (3 + 3), and 1 where they are meant for estimation, as of now."""
        if self.mode == "follow" and len(self._plan):
            row = self._in_plan()
            if self.lead is not None:
                row[_Z], row[_VZ] = self.lead.height, self.lead.speed
            return row[: SETPOINT.size]
        return np.array([*self.command, *self._speed, 0.0])

    @property
    def speed(self) -> float:
        """The speed [m/s] of the commands, as of now."""
        return float(np.linalg.norm(self._speed))

    def held_up(self, periods: int) -> None:
        """Note periods that had no command: a plan is followed a little faster until that is made up for."""
        if self.mode == "follow":
            self._behind = min(self._behind + periods, _MAX_BEHIND)

    def _in_plan(self) -> Floats:
        """Return the row (16,) that is due, between two rows of the plan while it makes up for something."""
        last = len(self._plan) - 1
        low = min(int(self._row), last)
        part, earlier = self._row - low, self._plan[low]
        if part <= 0.0 or low == last:
            return earlier
        row = earlier + part * (self._plan[low + 1] - earlier)
        row[SETPOINT["measuring"]] = earlier[SETPOINT["measuring"]]
        return np.asarray(row)

    def is_in_air(self, height: float) -> bool | None:
        """Return True at a height [m] of the tip over the plane of its station that is as high as travel goes.

        None where the tip has not shown that it is free.
        """
        if self.mode == "follow" and self._clearance is not None:
            return height >= _TRAVEL_SHARE * self._clearance > 0.0
        return True if self.mode == "approach" else None

    def settle(self, position: Floats, turn: Floats) -> None:
        """Begin where the arm is, as long as it has not been moved."""
        if self.mode == "hold":
            self.command, self.turn = position.copy(), turn.copy()

    def retreat(self, length: float, speed: float) -> None:
        """Go outwards along the normal of the station by a length [m] at a speed [m/s], and stay."""
        if self.mode not in ("hold", "stay"):
            return
        law = own_law(speed, self.law.acceleration)
        self.home = self.command.copy()
        self._set_out(self.command + length * self.plane.normal, law, self.turn)
        self.mode = "retreat"

    def walk(self, places: Floats) -> None:
        """Go through places (n, 3) [m] in the work frame, one in each period, and stay at the last of them."""
        if self.home is None:
            self.home = self.command.copy()
        self._turn_from, self._turn_by = self.turn, np.zeros(3)
        self._way = [(place, 1.0) for place in places]
        self.mode = "retreat"

    def follow(self, plan: Plan, law: ForceLaw | None = None) -> None:
        """Go to the first setpoint of a plan that was checked, then through it.

        With a law the force leads, and the plan is the envelope.
        """
        start = plan[0]
        self.lead = None if law is None else ForceLead(law, float(start[_Z]), plan.lowest, PERIOD)
        self._plan, self._row, self._behind, self.mode = plan, 0.0, 0.0, "approach"
        # Haste within the limits of speed and of the turn.
        pace = self.law.max_speed / max(plan.fastest, _NO_SPEED)
        turning_pace = self.law.angular_speed / max(plan.fastest_turn, _NO_SPEED)
        self._haste = min(max(min(pace, turning_pace) - 1.0, 0.0), _MAX_HASTE)
        self.home, self.plane = self.command.copy(), StationPlane.of_row(start)
        self._set_out(start[SETPOINT["position"]], self.law, start[PLAN["turn"]])

    def _set_out(self, end: Floats, law: ServoLaw, turn: Floats) -> None:
        """Plan a straight way to an end (3,) [m], on which the tool comes to a turn (3,) as well."""
        self._turn_from, self._turn_by = self.turn, turn_from_to(self.turn, turn)
        path = straight_path(self.command, end, law, float(np.linalg.norm(self._turn_by)))
        self._way = list(zip(path.position[1:], path.remaining_turn[1:].tolist(), strict=True))

    def _turn_at(self, remainder: float) -> Floats:
        """Return the turn (3,) of the tool on a way, where a part of it remains."""
        if not self._turn_by.any():
            return self._turn_from
        if np.array_equal(self._turn_by, -self._turn_from):  # to its orientation by the work frame
            return self._turn_from * remainder
        return turn_after(self._turn_from, self._turn_by * (1.0 - remainder))

    def retract(self) -> None:
        """Brake, and go back along the normal to the height over the station's plane at which the motion began."""
        if self.mode in ("retreat", "stay", "approach", "follow"):
            self.mode = "retract"
        elif self.mode == "hold":
            self.mode = "done"

    def led_astray(self, height: float) -> str | None:
        """Return why the force must not lead on, with the tip at a height [m]; None where it may, or does not lead."""
        if self.lead is None or self.mode != "follow":
            return None
        return self.lead.fault(self._row * PERIOD, height)

    def take_back(self) -> None:
        """Take back the latest command, which was not sent."""
        self.command, self._speed, self.turn = self._previous

    def next(self, position: Floats, velocity: Floats, room: float = math.inf) -> Floats:
        """Return the command (3,) for this period, from the measured position and velocity (3,) in the work frame.

        A plan goes on by `room` [m] at most, and is made up for later.
        """
        self._previous = self.command, self._speed, self.turn
        # A way of its own, place by place; at its end it stays, or the plan begins.
        if self.mode in ("approach", "retreat"):
            if self._way:
                former = self.command
                self.command, remainder = self._way.pop(0)
                self.turn = self._turn_at(remainder)
                self._speed = (self.command - former) / PERIOD
            elif self.mode == "retreat":
                self.mode, self._speed = "stay", np.zeros(3)
            else:
                self.mode, self.home = "follow", self._plan[0][SETPOINT["position"]]
                self._clearance = self.plane.height(self.home)
        if self.mode == "follow":
            self._follow(position, velocity, room)
        elif self.mode == "retract":
            self._retract()
        return self.command

    def _follow(self, position: Floats, velocity: Floats, room: float) -> None:
        """Make the command of the row that is due, by the law: "pd" from the measured state, else the setpoint itself.

        A step is at most the law's speed, and `room` [m]. Late rows are made up for by a plan that goes faster.
        """
        law = self.law
        row, former = self._in_plan(), self.command
        self._take_orientation(row)
        if self.lead is not None:
            row[_Z], row[_VZ] = self.lead.next(self._row * PERIOD, float(row[_Z]))
        faster = min(self._haste, self._behind)
        if law.control == "pd":
            # v = gain (z_d - z) + damping (z_d' - z').
            goal, rate = row[SETPOINT["position"]], row[SETPOINT["velocity"]] * (1.0 + faster)
            speed = law.gain * (goal - position) + law.damping * (rate - velocity)
            self.command = former + _no_longer(speed * PERIOD, min(law.max_speed * PERIOD, room))
        elif self.lead is not None:
            self.command = former + _no_longer(row[SETPOINT["position"]] - former, min(law.max_speed * PERIOD, room))
        else:
            self._wait_for_room(float(np.linalg.norm(row[SETPOINT["position"]] - former)), room)
            row = self._in_plan()
            self._take_orientation(row)
            self.command = row[SETPOINT["position"]].copy()
        self._speed = (self.command - former) / PERIOD
        self._row += 1.0 + faster
        self._behind -= faster
        if self._row >= len(self._plan):
            self.mode = "done"

    def _take_orientation(self, row: Floats) -> None:
        """Take turn and plane of a row (16,) of the plan."""
        self.turn, self.plane = row[PLAN["turn"]].copy(), StationPlane.of_row(row)

    def _wait_for_room(self, step: float, room: float) -> None:
        """Go back in the plan by what a step [m] is longer than the `room` [m]; that share of a row is late then."""
        if step > room:
            back = min(1.0 - room / step, self._row)
            self._row -= back
            self._behind = min(self._behind + back, _MAX_BEHIND)

    def _retract(self) -> None:
        """Make the next command of the way back along the normal, to the height at which the motion began."""
        assert self.home is not None
        # Heights over the plane of the station, [m]; `step` is the largest change of speed in a period.
        end = self._clearance if self._clearance is not None else self.plane.height(self.home)
        step, way = self.law.acceleration * PERIOD, end - self.plane.height(self.command)
        # The speed from which it still can brake within the way.
        speed = min(self.law.retract_speed, math.sqrt(_BRAKING * self.law.acceleration * max(way, 0.0)))
        goal = speed * self.plane.normal
        # Towards it by the acceleration, whatever the speed was.
        change = goal - self._speed
        length = float(np.linalg.norm(change))
        self._speed = goal if length <= step else self._speed + change * (step / length)
        self.command = self.command + self._speed * PERIOD
        if way < _HOME_DISTANCE and float(np.abs(self._speed).max()) < _HOME_STEPS * step:
            self.mode = "done"


def _no_longer(way: Floats, max_length: float) -> Floats:
    """Return a way (3,) [m], cut to a length [m]."""
    length = float(np.linalg.norm(way))
    return way if length <= max_length else way * (max_length / length)
