"""The pace of the servo loop: absolute deadlines, and those that the host lets pass.

A controller takes its inputs at each tick and sends its state soon after: cycles begin at that time, so that a command
is there well before the next tick. Where commands come as it ticks it reads now two and now none, and the arm trembles.
A command that was sent so late that it may be read in the tick after takes the place of the next one: of two in a tick
only the last counts, and the arm leaps. What the host has held up is left out in the same way, and reported to the next
cycle.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import NoReturn

from palpate import clock
from palpate_kit.acquisition.ring import Ring

from palpate_arms.lateness import Lateness
from palpate_arms.setpoint_buffer import PERIOD

_TICK = round(PERIOD * 1e9)  # [ns]
_NEVER = 1 << 62  # [ns], later than any time
# Choices (0151).
_MAX_CORRECTION = 5_000  # [ns] by which a deadline is moved: a quarter of a per cent of the speed
_SPAN = 250  # states; clocks part by less than 0.1 ms meanwhile, and one that has stood still is found again
_BEHIND_STATE = 200_000  # [ns] from the earliest state to the deadline
_IN_TIME = 1_000_000  # [ns] after its deadline a command comes before a tick that is 0.8 ms before its state
_LOOK_SHARE = 0.95  # of the time to the next deadline, within which the state is read once more


def next_deadline(deadline: int, sent: int, now: int) -> tuple[int, int]:
    """Return the deadline [ns] after one whose command was `sent`, on its grid, and the number left out until then."""
    # Those whose tick may take the command that was late, and those that have passed by now.
    late_ticks = (sent - deadline - _IN_TIME) // _TICK + 1
    passed_ticks = (now - deadline - _IN_TIME) // _TICK
    left_out = max(late_ticks, passed_ticks, 0)
    return deadline + (1 + left_out) * _TICK, left_out


class Beat:
    """The ticks of the controller, by the states that it sends at each of them."""

    def __init__(self) -> None:
        # [ns] from its clock to the host's, by the least late state of the last span of states, and of this one.
        self._last_offset = self._offset = _NEVER
        self._count = 0

    def saw(self, stamp: int, arrival: int) -> None:
        """Take over a state of the controller's time `stamp` [ns] that arrived at a monotonic time [ns]."""
        if self._count % _SPAN == 0:
            self._last_offset, self._offset = self._offset, _NEVER
        self._count += 1
        self._offset = min(self._offset, arrival - stamp)

    def correction(self, deadline: int) -> int:
        """Return by how much [ns] to move a deadline [ns] towards the time at which states arrive."""
        if self._count == 0:
            return 0
        lateness = (deadline - min(self._last_offset, self._offset) - _BEHIND_STATE) % _TICK
        correction = -lateness if lateness < _TICK // 2 else _TICK - lateness
        return max(-_MAX_CORRECTION, min(_MAX_CORRECTION, correction))


class Pace:
    """Cycles at their deadlines; those that are `counted` go into the account of lateness."""

    def __init__(self, ring: Ring, beat: Beat, counted: Callable[[], bool]) -> None:
        self._ring, self._beat, self._counted = ring, beat, counted
        self._lateness = Lateness(ring.head, _TICK)
        self._random = random.Random(0)

    def run(self, cycle: Callable[[int, int], None], look: Callable[[], None]) -> NoReturn:
        """Call a cycle at each deadline, with the time [ns] and the number of periods left out; never returns.

        Between two deadlines `look` takes the newest state.
        """
        deadline, left_out = clock().now_ns() + _TICK, 0
        while True:
            now = self._sleep(max(deadline - clock().now_ns(), 0))
            self._ring.beat(now)
            self._lateness.add(now, now - deadline, self._counted())
            cycle(now, left_out)
            sent = clock().now_ns()
            # A look at a random instant between two deadlines: else a controller that ticks in step with this loop
            # would always be seen equally late, and its clock mapped wrongly by up to a period. None where less than a
            # quarter of a period remains (a choice): the look might make the next command late.
            remaining = deadline + _TICK - clock().now_ns()
            if remaining > _TICK // 4:
                self._sleep(round(remaining * self._random.uniform(0.0, _LOOK_SHARE)))
                look()
            deadline, left_out = next_deadline(deadline, sent, clock().now_ns())
            deadline += self._beat.correction(deadline)
            if left_out and self._counted():
                self._lateness.skipped(left_out * _TICK)

    def _sleep(self, duration: int) -> int:
        """Sleep [ns], and return the time [ns] then; what it takes longer is counted as the host's."""
        if duration <= 0:
            return clock().now_ns()
        until = clock().now_ns() + duration
        clock().sleep(duration / 1e9)
        now = clock().now_ns()
        if self._counted():
            self._lateness.overslept(now - until)
        return now
