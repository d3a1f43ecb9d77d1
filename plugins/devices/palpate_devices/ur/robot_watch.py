"""Whether a robot's states let a motion go on, and how its program is stopped where they do not."""

from __future__ import annotations

import math
from collections.abc import Callable

from palpate import clock
from palpate_arms.setpoint_buffer import PERIOD
from palpate_engine import ReadingAge

from palpate_devices.ur.controller_states import NORMAL, RUNNING, STOPPED, complaint, slowdown
from palpate_devices.ur.robot import Robot, RobotFaultError

_LOST = 0.1  # [s] without a command taken: the link is lost
_MUTE = 25  # periods in which a stop has to reach the other connection, too
_HEARD = 0.25  # [s] for a stop to be carried out
_AHEAD = 1.0  # [s] of a time-stamp, which no clock and no delay explains
_SAFETY_MODES = range(1, 14)  # that a controller has
_LEAP = "no arm does that; was another TCP set meanwhile?"


class RobotWatch:
    """Looks at every state of a robot; `beat` tells the main job, while a stop is waited for, that this process lives.

    A robot that is only observed is not asked whether it could move.
    """

    def __init__(self, robot: Robot, timeout: float, beat: Callable[[], object]) -> None:
        self._robot, self._timeout, self._beat = robot, timeout, beat
        self._safety = NORMAL  # mode, at the start of the motion
        self._age = ReadingAge()
        self._ahead = math.inf  # [s] of the time-stamp that was most ahead of its arrival

    def check_state(self) -> None:
        """Raise RobotFaultError where the newest state makes no sense."""
        robot = self._robot
        if not math.isfinite(robot.stamp):
            raise self._garbled("the controller's time-stamp is no number")
        ahead = robot.stamp - robot.seen / 1e9
        if ahead > self._ahead + _AHEAD:
            raise self._garbled(
                f"the controller's time-stamp is {ahead - self._ahead:.3g} s ahead of its arrival, beyond all before it"
            )
        self._ahead = ahead if math.isinf(self._ahead) else max(ahead, self._ahead)
        if not robot.is_number:
            raise self._garbled("the controller's pose or joints are no numbers")
        self._age.add([round(1e9 * robot.stamp)], [robot.seen])
        if robot.control is not None and (robot.leap is not None or robot.wrong_size is not None):
            raise self._garbled(f"the tip leapt by {1e3 * (robot.leap or 0.0):.0f} mm between two states: {_LEAP}")

    def check_modes(self) -> None:
        """Raise RobotFaultError where the controller's modes say that the arm cannot continue."""
        robot = self._robot
        if robot.control is None or (text := complaint(robot.modes)) is None:
            return
        if robot.modes[1] not in _SAFETY_MODES:
            raise self._garbled(text)
        raise RobotFaultError(text + (self._mute_control() if robot.modes == (RUNNING, NORMAL, STOPPED) else ""))

    def check_start(self) -> None:
        """Raise RobotFaultError where a robot at rest is slower than it would be commanded."""
        if self._robot.control is not None:
            self._safety = self._robot.modes[1]
            if (text := slowdown(self._robot.paces, self._safety, None)) is not None:
                raise RobotFaultError(text)

    def slowdown(self) -> str | None:
        """Why a robot in motion has become slower than it is commanded; None where it has not."""
        robot = self._robot
        return None if robot.control is None else slowdown(robot.paces, robot.modes[1], self._safety)

    def lateness(self, limit: float) -> str | None:
        """Why the arm is not where its states have it: the latest two were older than a limit [s]; None in time."""
        return self._age.complaint("the controller's states", limit)

    def check_links(self, now: int) -> None:
        """Raise RobotFaultError where a connection is lost or silent."""
        robot, age = self._robot, (now - self._robot.seen) / 1e9
        if not robot.receive.isConnected():
            raise RobotFaultError("the controller has closed the link")
        if robot.control is not None and robot.unheard > _LOST:
            raise RobotFaultError(
                f"the control link is lost: the controller has taken no command for {1e3 * robot.unheard:.0f} ms. What "
                "was sent meanwhile is dropped, and the controller's watchdog stops the arm. Check cable and switch"
            )
        if age > self._timeout:
            raise RobotFaultError(f"the controller is silent: its last state is {1e3 * age:.0f} ms old")

    def _garbled(self, text: str) -> RobotFaultError:
        """Why a state makes no sense, once the arm is stopped: the other connection shows whether its packets do."""
        heard = self.halt_in_doubt()
        self._robot.read_back()
        if (sizes := self._robot.wrong_size) is not None:
            text = (
                f"the controller sends states of {sizes[0]} bytes in place of {sizes[1]}: what the client library "
                "makes of them is not where the arm is"
            )
        return RobotFaultError(text + heard)

    def _mute_control(self) -> str:
        """A program that the control link still reports as running, although the other link reports that it is not."""
        for _ in range(_MUTE):
            if not self._robot.control.isProgramRunning():
                return ""
            clock().sleep(PERIOD)
        return " The control link still reports it as running: that link is mute, and commands did not arrive."

    def halt(self) -> None:
        """Stop servoing, then the program; both wait for the controller, who was heard of a moment ago."""
        if self._robot.control is not None:
            self._robot.control.servoStop()
            self._robot.control.stopScript()

    def halt_in_doubt(self) -> str:
        """Stop a robot that may not hear: the library would wait for its answer for minutes; the watchdog does not."""
        halting = clock().thread(self.halt, "halt")
        halting.start()
        deadline = clock().now() + _HEARD
        while halting.is_alive() and clock().now() < deadline:
            self._beat()
            clock().sleep(PERIOD)
        return " The control link does not answer: commands do not arrive." if halting.is_alive() else ""
