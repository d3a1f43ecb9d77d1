"""Whether an arm's states let a motion go on."""

from __future__ import annotations

import math

from palpate import clock
from palpate_engine import ReadingAge

from palpate_arms.arm_driver import ArmFaultError, ArmReading, DeadLinkError, GarbledStateError
from palpate_arms.commanded_arm import CommandedArm

_LOST = 0.1  # [s] without a command taken: the link is lost
_AHEAD = 1.0  # [s] of a time-stamp, which no clock and no delay explains
_LEAP = "no arm does that; was another TCP set meanwhile?"


class ArmWatch:
    """Looks at every state of an arm; one that is only observed is not asked whether it could move."""

    def __init__(self, arm: CommandedArm, timeout: float) -> None:
        self._arm, self._timeout = arm, timeout
        self._first: ArmReading | None = None  # at the start of the motion
        self._age = ReadingAge()
        self._ahead = math.inf  # [s] of the time-stamp that was most ahead of its arrival
        self._stamp = -math.inf  # [s] of the latest state
        self._step_back = 0.0  # [s] from one time-stamp to the next, the latest time that one was older

    def check_state(self) -> None:
        """Raise ArmFaultError where the newest state makes no sense."""
        arm = self._arm
        if not math.isfinite(arm.stamp):
            raise self._garbled("the controller's time-stamp is not a number")
        self._stamp, back = arm.stamp, self._stamp - arm.stamp
        self._step_back = back if back > 0.0 else self._step_back
        ahead = arm.stamp - arm.seen / 1e9
        if ahead > self._ahead + _AHEAD:
            raise self._garbled(
                f"the controller's time-stamp is {ahead - self._ahead:.3g} s ahead of its arrival, beyond all before it"
            )
        self._ahead = ahead if math.isinf(self._ahead) else max(ahead, self._ahead)
        if not arm.is_number:
            raise self._garbled("the controller's pose or joints are not numbers")
        self._age.add([round(1e9 * arm.stamp)], [arm.seen])
        if not arm.observed and (arm.leap is not None or arm.driver.explain() is not None):
            raise self._garbled(f"the tip leapt by {1e3 * (arm.leap or 0.0):.0f} mm between two states: {_LEAP}")

    def check_modes(self) -> None:
        """Raise ArmFaultError where the controller says that the arm cannot continue."""
        if self._arm.observed:
            return
        try:
            self._arm.driver.check(self._arm.reading)
        except GarbledStateError as fault:
            raise self._garbled(str(fault)) from fault

    def check_start(self) -> None:
        """Raise ArmFaultError where an arm at rest is slower than it would be commanded."""
        if not self._arm.observed:
            self._first = self._arm.reading
            if (text := self._arm.driver.slowdown(self._arm.reading, None)) is not None:
                raise ArmFaultError(text)

    def slowdown(self) -> str | None:
        """Return why an arm in motion has become slower than it is commanded; None where it has not."""
        return None if self._arm.observed else self._arm.driver.slowdown(self._arm.reading, self._first)

    def lateness(self, limit: float) -> str | None:
        """Return why the arm is not where its states have it: the latest two were older than a limit [s]; None in
        time."""
        text = self._age.complaint("the controller's states", limit)
        # Older by so much at once: they are not late.
        if text is None or self._step_back <= limit:
            return text
        return (
            f"the controller's time-stamps go back by {1e3 * self._step_back:.4g} ms while its states go on: they "
            "arrive out of order, or its clock was set back; where the tip stands now is not known"
        )

    def check_links(self, now: int) -> None:
        """Raise ArmFaultError where a connection is lost or silent."""
        driver, age = self._arm.driver, (now - self._arm.seen) / 1e9
        if not driver.connected:
            raise DeadLinkError("the controller has closed the link")
        if not self._arm.observed and (unheard := driver.unheard) > _LOST:
            raise DeadLinkError(
                f"the control link is lost: the controller has taken no command for {1e3 * unheard:.0f} ms. What "
                "was sent meanwhile is dropped, and the controller's watchdog stops the arm. Check cable and switch"
                f"{clock().late_computer()}"
            )
        if age > self._timeout:
            late = clock().late_computer()
            raise DeadLinkError(f"the controller is silent: its last state is {1e3 * age:.0f} ms old{late}")

    def _garbled(self, text: str) -> GarbledStateError:
        """Return why a state makes no sense."""
        return GarbledStateError(self._arm.driver.explain() or text)
