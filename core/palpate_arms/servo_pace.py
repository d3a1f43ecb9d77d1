"""The pace of the servo loop: absolute deadlines, and what the host makes of them.

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
_STEP = 5_000  # [ns] by which a deadline is moved at most: a quarter of a per cent of the speed
_SPAN = 250  # states; clocks part by less than 0.1 ms meanwhile, and one that has stood still is found again
_NEVER = 1 << 62  # [ns]
_AFTER = 200_000  # [ns] after the earliest state
_IN_TIME = 1_000_000  # [ns] after its deadline a command comes before a tick that is 0.8 ms before its state


def next_deadline(deadline: int, sent: int, now: int) -> tuple[int, int]:
    """Return the deadline [ns] after one whose command was `sent`, on its grid, and how many are left out until
    then."""
    taken = (sent - deadline - _IN_TIME) // _TICK + 1
    passed = (now - deadline - _IN_TIME) // _TICK
    left_out = max(taken, passed, 0)
    return deadline + (1 + left_out) * _TICK, left_out


class Beat:
    """When the controller ticks, by the states that it sends at each tick."""

    def __init__(self) -> None:
        self._before = self._now = _NEVER  # [ns] of its clock, by the state that was least late, in a span of states
        self._count = 0

    def saw(self, stamp: int, seen: int) -> None:
        """A state of the controller's time `stamp` [ns] was seen at a monotonic time [ns]."""
        if self._count % _SPAN == 0:
            self._before, self._now = self._now, _NEVER
        self._count += 1
        self._now = min(self._now, seen - stamp)

    def correction(self, deadline: int) -> int:
        """By how much to move a deadline [ns], towards the time at which states come."""
        if self._count == 0:
            return 0
        off = (deadline - min(self._before, self._now) - _AFTER) % _TICK
        return max(-_STEP, min(_STEP, -off if off < _TICK // 2 else _TICK - off))


class Pace:
    """Cycles at their deadlines; those that are `counted` go into the account of lateness."""

    def __init__(self, ring: Ring, beat: Beat, counted: Callable[[], bool]) -> None:
        self._ring, self._beat, self._counted = ring, beat, counted
        self._lateness = Lateness(ring.head, _TICK)
        self._random = random.Random(0)

    def run(self, cycle: Callable[[int, int], None], look: Callable[[], None]) -> NoReturn:
        """Call a cycle at each deadline, given the time [ns] and how many were left out; a look between two of
        them."""
        deadline, left_out = clock().now_ns() + _TICK, 0
        while True:
            now = self._sleep(max(deadline - clock().now_ns(), 0))
            self._ring.beat(now)
            self._lateness.add(now, now - deadline, self._counted())
            cycle(now, left_out)
            sent = clock().now_ns()
            # A look at a random instant between two deadlines: else a controller that ticks in step with this loop
            # would always be seen equally late, and its clock mapped wrongly by up to a period.
            rest = deadline + _TICK - clock().now_ns()
            if rest > _TICK // 4:
                self._sleep(round(rest * self._random.uniform(0.0, 0.95)))
                look()
            deadline, left_out = next_deadline(deadline, sent, clock().now_ns())
            deadline += self._beat.correction(deadline)
            if left_out and self._counted():
                self._lateness.skipped(left_out * _TICK)

    def _sleep(self, duration: int) -> int:
        """Sleep [ns]; the time then. What it takes longer is counted as the host's."""
        if duration <= 0:
            return clock().now_ns()
        until = clock().now_ns() + duration
        clock().sleep(duration / 1e9)
        now = clock().now_ns()
        if self._counted():
            self._lateness.overslept(now - until)
        return now
