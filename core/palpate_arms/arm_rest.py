"""How an arm comes to rest: it is stopped, again and again, until its states show that its tip stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from palpate import Thread, clock
from palpate_engine import RestWindow

from palpate_arms.commanded_arm import CommandedArm
from palpate_arms.setpoint_buffer import PERIOD

_ANSWER = 0.25  # [s] for a stop to be carried out; until then a driver is asked for nothing else
_WATCHDOG = 0.2  # [s] after which a controller's own watchdog, of 0.1 s, has stopped an arm
_BRAKES = 1.0  # [s] at most, from a stop to a standstill
_SPAN = 120_000_000  # [ns] of states that show a standstill; the guard, which hears of the stop later, needs 0.1 s
_REPEATS = 2.0  # [s] for which a stop is repeated
_AGAIN = 0.1  # [s] between two of them


@dataclass(frozen=True)
class Rest:
    """The end of a motion: whether states have shown that the tip stands, and what was wrong with `stop`."""

    is_shown: bool
    complaint: str = ""  # a sentence


class ArmRest:
    """Stops an arm and looks whether it obeys.

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
        self._window, self._unasked = RestWindow(_SPAN), 0  # [ns] until when no state was asked for
        self._first_place: list[float] | None = None  # [m] after the stop
        self._place_changes = False

    def come_to_rest(self, at_once: bool, is_moving: bool, timeout: float) -> Rest:
        """Stop the arm until its states show that it stands, for up to 2 s; those older than `timeout` [s] are missing.

        `at_once`: the first stop is not left to a watchdog of the controller. Where the arm was commanded to move, a
        pose that has not changed in any digit since then does not count.
        """
        window, began = self._window, clock().now()
        is_shown = has_warned = False
        self._next_stop = began if at_once else began + _WATCHDOG
        while (waited := clock().now() - began) < _REPEATS:
            self._stop_if_due()
            is_blind = not self._look(timeout)
            is_blind |= window.is_full and is_moving and not self._place_changes
            is_shown = window.shows_rest and not is_blind
            if is_shown and not self._is_stopping:
                return Rest(True, self._complaint)
            if not is_shown and not has_warned and (is_blind or waited >= _BRAKES):
                has_warned = True
                self._warn(None if is_blind else window.speed)
            self._beat()
            clock().sleep(PERIOD)
        return Rest(is_shown, self._complaint)

    def stop_once(self) -> Rest:
        """Stop an arm that was not commanded to move: it stands."""
        deadline = clock().now() + _ANSWER
        self._stop_if_due()
        while self._is_stopping and clock().now() < deadline:
            self._beat()
            clock().sleep(PERIOD)
        return Rest(True, self._complaint)

    def _look(self, timeout: float) -> bool:
        """Take the newest state; False where states are missing."""
        arm, now = self._arm, clock().now_ns()
        if self._is_stopping and clock().now() < self._next_stop - _AGAIN + _ANSWER:
            self._unasked = now  # a driver that waits for its controller is not asked for a state
            return True
        try:
            if self._take_state() and arm.is_number:
                self._note(arm.seen, arm.position.tolist())
            silence = (now - max(arm.seen, self._unasked)) / 1e9
            return arm.is_number and arm.driver.connected and silence < timeout
        except Exception:  # whatever a driver raises: it shows no state
            return False

    def _note(self, seen: int, place: list[float]) -> None:
        self._window.add(seen, place)
        self._first_place = self._first_place or place
        self._place_changes |= place != self._first_place

    @property
    def _is_stopping(self) -> bool:
        return self._stopping is not None and self._stopping.is_alive()

    def _stop_if_due(self) -> None:
        """Call the driver's `stop` in a thread, which it may hold up, unless the last call has not returned."""
        if clock().now() < self._next_stop or self._is_stopping:
            return
        self._next_stop = clock().now() + _AGAIN
        self._stopping = clock().thread(self._stop, "stop")
        self._stopping.start()

    def _stop(self) -> None:
        try:
            self._arm.driver.stop()
        except Exception as error:  # whatever a driver raises
            self._failure = self._failure or f" And it could not be stopped: {type(error).__name__}: {error}."

    @property
    def _complaint(self) -> str:
        if self._is_stopping:
            return " The control link does not answer: commands do not arrive."
        return self._failure
