"""The end of the process that commands an arm: it stops the arm, sees it stand, says why, and goes."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, NoReturn

from palpate import clock
from palpate_engine import EMERGENCY, call_for_stop
from palpate_kit.acquisition.child import Parent
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.ring import Ring

from palpate_arms.arm_driver import ArmFaultError, DeadLinkError, GarbledStateError
from palpate_arms.arm_rest import ArmRest, Rest
from palpate_arms.commanded_arm import CommandedArm
from palpate_arms.servo import Commander
from palpate_arms.setpoint_buffer import PERIOD

_DISOBEDIENCE = "the arm does not obey: it was stopped, and no states show that its tip stands"
_STILL_SPEED = 0.5e-3  # [m/s] of commands, a choice: below it an arm is not commanded to move; as a standstill shows


class ArmExit:
    """The three ways in which the process ends: a motion that is over, a main job that is gone, a fault.

    `record` takes over and records a new state, whatever it says, and returns False without one; states older
    than `timeout` [s] are missing. None for a commander means that no state has come yet.
    """

    def __init__(
        self, parent: Parent, ring: Ring, robot: CommandedArm, record: Callable[[], bool], timeout: float
    ) -> None:
        self._parent, self._ring, self._robot = parent, ring, robot
        self._record, self._timeout = record, timeout

    def finish(self, commander: Commander | None, facts: dict[str, Any], take_state: Callable[[], object]) -> NoReturn:
        """End the process after a motion that is over, finished or broken off; never returns.

        The main job gets the `facts` of the motion, and says when to go; until then `take_state` records the states.
        """
        # The arm has to stand before the motion is reported as done.
        standstill = self._come_to_rest(commander, _DISOBEDIENCE, True)
        if standstill.complaint or not standstill.is_shown:
            fault = standstill.complaint.removeprefix(" And ").strip() or _DISOBEDIENCE
            self._parent.tell("fault", text=fault, stands=standstill.is_shown)
            host().leave(1)
        self._parent.tell("done", **facts)
        # States are recorded until the main job closes.
        while not self._parent.gone:
            self._ring.beat(clock().now_ns())
            take_state()
            if any(message["say"] == "close" for message in self._parent.messages()):
                break
            clock().sleep(PERIOD)
        with contextlib.suppress(Exception):  # whatever a driver raises: the arm stands
            self._robot.driver.close()
        host().leave(0)

    def leave(self, commander: Commander | None) -> NoReturn:
        """Stop the arm where the main job is gone, or closes: nobody else says where an arm stays in motion."""
        if not self._come_to_rest(commander, "", True).is_shown:
            call_for_stop(f"{EMERGENCY}: the program has gone, and no states show that the tip stands")
        host().leave(0)

    def fail(self, commander: Commander | None, fault: ArmFaultError) -> NoReturn:
        """Report a fault to the main job, stop the arm, see it stand, and end the process at once.

        At once, for a client library's destructors and reconnecting threads hang and crash.

        A lost link to a controller with a watchdog is left at once: what is on it must not be carried out later. Other
        faults of an arm with a watchdog stop it by the lack of commands, where its states can be trusted.
        """
        # A lost link, with a watchdog: at once.
        text, driver = str(fault), self._robot.driver
        if isinstance(fault, DeadLinkError) and driver.has_watchdog:
            self._parent.tell("fault", text=text, stands=False)
            host().leave(1)
        # Else the arm is stopped first, which takes its time.
        self._parent.tell("failing", text=text)
        standstill = self._come_to_rest(
            commander, text, isinstance(fault, GarbledStateError) or not driver.has_watchdog
        )
        self._parent.tell("fault", text=text + standstill.complaint, stands=standstill.is_shown)
        host().leave(1)

    def _come_to_rest(self, commander: Commander | None, fault: str, at_once: bool) -> Rest:
        """Stop the arm until its states show that it stands; the main job is warned of one that does not.

        `at_once`: not left to a watchdog of the controller. An arm that is observed is not stopped.
        """
        robot = self._robot
        if robot.observed:
            return Rest(True)
        beat = lambda: self._ring.beat(clock().now_ns())  # noqa: E731
        warn = lambda speed: self._parent.tell("astray", text=fault, speed=speed)  # noqa: E731
        arm_rest = ArmRest(robot, self._record, beat, warn)
        if commander is None or commander.mode == "hold":
            return arm_rest.stop_once()
        return arm_rest.come_to_rest(at_once, commander.speed > _STILL_SPEED, self._timeout)
