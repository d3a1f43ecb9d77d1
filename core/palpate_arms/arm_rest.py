"""The end of an arm's motion: it is stopped, again and again, until its states show that its tip stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from palpate import Thread, clock
from palpate_engine import RestWindow

from palpate_arms.commanded_arm import CommandedArm
from palpate_arms.setpoint_buffer import PERIOD

# Choices.
_ANSWER_TIME = 0.25  # [s] for a stop to be carried out; until then a driver is asked for nothing else
_WATCHDOG_TIME = 0.2  # [s] after which a controller's own watchdog, of 0.1 s, has stopped an arm
_BRAKING_TIME = 1.0  # [s] at most, from a stop to a standstill
_STANDSTILL = 120_000_000  # [ns] of states that show one; the guard, which hears of the stop later, needs 0.1 s
_STOP_DURATION = 2.0  # [s] for which a stop is repeated
_STOP_INTERVAL = 0.1  # [s] between two of them
_SECOND = 1e9  # [ns]


@dataclass(frozen=True)
class Rest:
    """The end of a motion."""

    is_shown: bool  # that the tip stands, by its states
    complaint: str = ""  # of `stop`, a sentence


class ArmRest:
    """Stops an arm, and checks by its states that it obeys.

    `take_state` records a state and returns True where there is a new one, `beat` shows the main job that this process
    lives, and `warn` is called once with the speed [m/s] of a tip that does not stand in time, None where no states
    show one.
    """

    def __init__(
        self,
        arm: CommandedArm,
        take_state: Callable[[], bool],
        beat: Callable[[], object],
        warn: Callable[[float | None], object],
    ) -> None:
        self._arm, self._take_state, self._beat, self._warn = arm, take_state, beat, warn
        self._stopping: Thread | None = None
        self._next_stop = 0.0  # monotonic [s]
        self._failure = ""
        self._window, self._unasked = RestWindow(_STANDSTILL), 0  # [ns] until when no state was asked for
        self._first_place: list[float] | None = None  # [m] after the stop
        self._place_changes = False

    def come_to_rest(self, at_once: bool, is_moving: bool, timeout: float) -> Rest:
        """Stop the arm until its states show that it stands, for up to 2 s; those older than `timeout` [s] are missing.

        `at_once`: the first stop is not left to a watchdog of the controller. Where the arm was commanded to move, a
        pose that has not changed in any digit since then does not count.
        """
        # Stopped again and again, while states show whether the tip stands.
        window, began = self._window, clock().now()
        is_shown = has_warned = False
        self._next_stop = began if at_once else began + _WATCHDOG_TIME
        while (waited := clock().now() - began) < _STOP_DURATION:
            self._stop_if_due()
            is_blind = not self._take_newest(timeout)
            is_blind |= window.is_full and is_moving and not self._place_changes
            is_shown = window.shows_rest and not is_blind
            if is_shown and not self._is_stopping:
                return Rest(True, self._complaint)
            # Once: of a tip that does not stand, or that nobody sees.
            if not is_shown and not has_warned and (is_blind or waited >= _BRAKING_TIME):
                has_warned = True
                self._warn(None if is_blind else window.speed)
            self._beat()
            clock().sleep(PERIOD)
        return Rest(is_shown, self._complaint)

    def stop_once(self) -> Rest:
        """Stop an arm that was not commanded to move: it stands."""
        deadline = clock().now() + _ANSWER_TIME
        self._stop_if_due()
        while self._is_stopping and clock().now() < deadline:
            self._beat()
            clock().sleep(PERIOD)
        return Rest(True, self._complaint)

    def _take_newest(self, timeout: float) -> bool:
        """Take the newest state; return False where states are missing."""
        arm, now = self._arm, clock().now_ns()
        if self._is_stopping and clock().now() < self._next_stop - _STOP_INTERVAL + _ANSWER_TIME:
            self._unasked = now  # a driver that waits for its controller is not asked for a state
            return True
        try:
            if self._take_state() and arm.is_number:
                self._note(arm.seen, arm.position.tolist())
            silence = (now - max(arm.seen, self._unasked)) / _SECOND
            return arm.is_number and arm.driver.connected and silence < timeout
        except Exception:  # whatever a driver raises: it shows no state
            return False

    def _note(self, arrival: int, place: list[float]) -> None:
        """Add the place (3,) [m] of a state that arrived at a time [ns]."""
        self._window.add(arrival, place)
        self._first_place = self._first_place or place
        self._place_changes |= place != self._first_place

    @property
    def _is_stopping(self) -> bool:
        return self._stopping is not None and self._stopping.is_alive()

    def _stop_if_due(self) -> None:
        """Call the driver's `stop` in a thread, which it may hold up, unless the last call has not returned."""
        if clock().now() < self._next_stop or self._is_stopping:
            return
        self._next_stop = clock().now() + _STOP_INTERVAL
        self._stopping = clock().thread(self._stop, "stop")
        self._stopping.start()

    def _stop(self) -> None:
        """Call the driver's `stop`, and keep its first failure."""
        try:
            self._arm.driver.stop()
        except Exception as error:  # whatever a driver raises
            self._failure = self._failure or f" And it could not be stopped: {type(error).__name__}: {error}."

    @property
    def _complaint(self) -> str:
        """The sentence on a stop that does not return, or failed; empty without one."""
        if self._is_stopping:
            return " The control link does not answer: commands do not arrive."
        return self._failure
