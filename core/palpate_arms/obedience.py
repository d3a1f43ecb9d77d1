"""The handshakes of an arm with the process that commands it: the first retreat, and before a raster two sidesteps."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import RETREAT_SPEED, Floats, clock

from palpate_arms.commanded_arm import CommandedArm
from palpate_arms.fence import Fence
from palpate_arms.handshake import Handshake, target_problem
from palpate_arms.handshake_path import SIDESTEP, HandshakePath, StatedArm, outward_path, sideways_path
from palpate_arms.servo import Commander
from palpate_arms.servo_law import own_law
from palpate_arms.setpoint_buffer import PERIOD, Plan

# Choices (0530), of the first command.
_MAX_LEAD = 1.5  # periods before the next state, within which it is sent: one, and half for unsteady clocks
_STATE_LATE = 1.15  # state periods after which the next state is late
_MAX_WAIT = 50  # periods, after which it is sent all the same: states that come in another rhythm than at first


class Obedience:
    """The handshakes of an arm since it was connected; `arm_facts` is what it states of itself."""

    def __init__(self, robot: CommandedArm, fence: Fence, arm_facts: dict[str, Any], gives_way: bool) -> None:
        self._robot, self._fence = robot, fence
        self._stated = arm_facts.get("lag", 0.0), arm_facts.get("deadband", 0.0), gives_way
        self._handshake: Handshake | None = None
        self.has_begun = False  # True once it was to show anything
        self._has_commanded = False
        self._cycles_waited = 0
        self._has_sidestepped = False
        self.answers: list[dict[str, Any]] = []  # of a handshake that is over

    def retreat(self, commander: Commander, way: float, speed: float) -> str | None:
        """Begin the first retreat, of `way` [m] at a `speed` [m/s]; return None.

        Where it must not begin, nothing is sent, and the reason is returned.
        """
        # Nothing is sent where the controller's own target is elsewhere, or the way is too short.
        robot, stated, plane = self._robot, self._stated_now(), commander.plane
        target = robot.driver.target()
        if target is not None and (text := target_problem(target, robot.pose, stated.give)) is not None:
            return text
        try:
            law = own_law(speed, commander.law.acceleration)
            path = outward_path(commander.command, plane.normal, way, law, stated)
        except ValueError as error:
            return str(error)
        self.has_begun = True
        self._begin(commander, path, stated)
        return None

    def is_busy(self, commander: Commander, plan: Plan) -> bool:
        """Return True while the arm has still to show something before a plan; begin the sidesteps before a raster."""
        if self._handshake is not None or commander.mode == "retreat":
            return True
        limits = self._fence.limits
        if limits is None or self._has_sidestepped or plan.lateral <= SIDESTEP:
            return False
        self._has_sidestepped, stated = True, self._stated_now()
        # Towards the centre of the box, where there is room.
        centre = 0.5 * (np.array(limits["low"]) + np.array(limits["high"]))
        law = own_law(RETREAT_SPEED, commander.law.acceleration)
        self._begin(commander, sideways_path(commander.command, commander.plane, centre, law, stated), stated)
        return True

    def _begin(self, commander: Commander, path: HandshakePath, stated: StatedArm) -> None:
        """Begin a handshake from the newest state."""
        self._handshake = Handshake(path, stated, self._robot.motion_state)
        commander.walk(path.rows)

    def _stated_now(self) -> StatedArm:
        """Return what is stated of the arm, with the deflection at the force that stops it, if one does."""
        lag, deadband, gives_way = self._stated
        return StatedArm(lag, deadband, gives_way, self._fence.give - deadband)

    def must_wait(self, now: int) -> bool:
        """Return True at a time [ns] that is too early, or too late, for the first command of all.

        Only a state shows what it does: it is sent a period before the next one, however seldom they come.
        """
        if self._handshake is None or self._has_commanded or self._cycles_waited >= _MAX_WAIT:
            return False
        age, period = 1e-9 * (now - self._robot.seen), self._robot.state_period  # [s]
        is_due = period - _MAX_LEAD * PERIOD <= age <= _STATE_LATE * period
        self._cycles_waited += not is_due
        return not is_due

    def note_command(self, command: Floats) -> None:
        """Note a command (3,) that is about to be sent."""
        if self._handshake is not None:
            self._has_commanded = True
            self._handshake.note_command(command, self._robot.target_of(command), clock().now_ns())

    def fault(self, commander: Commander) -> str | None:
        """Return why the newest state shows that the arm does not obey; None where it does, or nothing is asked."""
        handshake, robot = self._handshake, self._robot
        if handshake is None or not robot.is_number:
            return None
        if commander.mode not in ("retreat", "stay"):  # it leaves
            self.end()
            return None
        text = handshake.fault(robot.motion_state, robot.base_place, robot.seen)
        if handshake.is_over:
            self._handshake, self.answers = None, handshake.answers
        return text

    def end(self) -> None:
        """End the handshake: what the arm does from now on answers no command."""
        self._handshake = None

    def take_answers(self) -> list[dict[str, Any]]:
        """Return the answers of the latest handshake, once."""
        answers, self.answers = self.answers, []
        return answers
