"""Checks of every state of an arm, and of its links: they end a motion that must not go on."""

from __future__ import annotations

import math

from palpate import clock
from palpate_engine import ReadingAge

from palpate_arms.arm_driver import ArmFaultError, ArmReading, DeadLinkError, GarbledStateError
from palpate_arms.commanded_arm import CommandedArm

# Choices.
_MAX_UNHEARD = 0.1  # [s] without a command taken: the link is lost (0213)
_MAX_AHEAD = 1.0  # [s] of a time-stamp, which no clock and no delay explains
_MAX_STEP_BACK = 1e-3  # [s] from a time-stamp to an older one: half a state, which no unsteady clock makes (0532)
_ANSWER_PERIODS = 2.0  # of states: a command waits for a tick, and its answer for a state (0532)
_SECOND = 1e9  # [ns]
_MS = _MM = 1e3  # per second, per metre
_LEAP = "no arm does that; was another TCP set meanwhile?"


class ArmWatch:
    """The checks of an arm's states; one that is only observed is not asked whether it could move."""

    def __init__(self, arm: CommandedArm, timeout: float) -> None:
        self._arm, self._timeout = arm, timeout
        self._first: ArmReading | None = None  # at the start of the motion
        self._age = ReadingAge()
        self._ahead = math.inf  # [s] of the time-stamp that was most ahead of its arrival
        self._stamp = -math.inf  # [s] of the latest state
        self._step_back = 0.0  # [s] from one time-stamp to the next, the largest of those that were older

    def check_state(self) -> None:
        """Raise ArmFaultError where the newest state makes no sense."""
        arm = self._arm
        if not math.isfinite(arm.stamp):
            raise self._garbled("the controller's time-stamp is not a number")
        # Stamps that go back, and those from the future.
        self._step_back = max(self._stamp - arm.stamp, self._step_back)
        self._stamp = arm.stamp
        ahead = arm.stamp - arm.seen / _SECOND  # [s] between two clocks, whose offset is unknown but steady
        if ahead > self._ahead + _MAX_AHEAD:
            raise self._garbled(
                f"the controller's time-stamp is {ahead - self._ahead:.3g} s ahead of its arrival, beyond all before it"
            )
        self._ahead = ahead if math.isinf(self._ahead) else max(ahead, self._ahead)
        # Numbers that no arm has.
        if not arm.is_number:
            raise self._garbled("the controller's pose or joints are not numbers")
        self._age.add([round(_SECOND * arm.stamp)], [arm.seen])
        if not arm.observed and (arm.leap is not None or arm.driver.explain() is not None):
            raise self._garbled(f"the tip leapt by {_MM * (arm.leap or 0.0):.0f} mm between two states: {_LEAP}")

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
        """Return why the arm is not where its states have it; None where they are in their order and in time.

        Out of order is one that is older than the one before it; late are the latest two beyond a limit [s].
        """
        if self._step_back <= _MAX_STEP_BACK:
            return self._age.complaint("the controller's states", limit)
        return (
            f"the controller's time-stamps go back by {_MS * self._step_back:.4g} ms while its states go on: they "
            "arrive out of order, or its clock was set back; where the tip stands now is not known"
        )

    def late_answer(self, limit: float) -> str | None:
        """Return why an arm must not be moved whose states were late from the start, by more than a limit [s].

        No time-stamp shows that: the state that answers a command does, where the controller reads commands back.
        """
        answer_time, period = self._arm.driver.answer_time, self._arm.state_period
        if answer_time <= limit + _ANSWER_PERIODS * period:
            return None
        return (
            "the controller's states, or its commands, come late from the start: a command shows "
            f"{_MS * answer_time:.0f} ms after it was sent, over [safety] reading_age = {_MS * limit:g} ms and two "
            f"states of {_MS * period:g} ms; where the tip stands while it is commanded is not known"
            f"{clock().late_computer()}"
        )

    def check_links(self, now: int) -> None:
        """Raise ArmFaultError where a connection is lost or silent."""
        driver, age = self._arm.driver, (now - self._arm.seen) / _SECOND
        if not driver.connected:
            raise DeadLinkError("the controller has closed the link")
        if not self._arm.observed and (unheard := driver.unheard) > _MAX_UNHEARD:
            raise DeadLinkError(
                f"the control link is lost: the controller has taken no command for {_MS * unheard:.0f} ms. What "
                "was sent meanwhile is dropped, and the controller's watchdog stops the arm. Check cable and switch"
                f"{clock().late_computer()}"
            )
        if age > self._timeout:
            late = clock().late_computer()
            raise DeadLinkError(f"the controller is silent: its last state is {_MS * age:.0f} ms old{late}")

    def _garbled(self, text: str) -> GarbledStateError:
        """Return the error of a state that makes no sense; the driver may know more about it than the text."""
        return GarbledStateError(self._arm.driver.explain() or text)
