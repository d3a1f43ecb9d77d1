"""The pace of the servo loop: absolute deadlines, and what the host makes of them.

What the host has held up is made up for a little faster than planned, never by a jump.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from typing import NoReturn

from palpate_devices.process.lateness import Lateness
from palpate_devices.process.ring import Ring
from palpate_devices.ur3e.servo import PERIOD

_TICK = round(PERIOD * 1e9)  # [ns]
_MOST_BEHIND = 25 * _TICK  # what is later is not made up for


def next_cycle(deadline: int, began: int, now: int, haste: float) -> tuple[int, int]:
    """The deadline [ns] of the grid after one, and when its cycle is due, from when the last one began.

    Motion that the host has held up is made up for by at most the part `haste` faster than planned; where there is no
    room for haste, or more to make up for than 50 ms, deadlines that have passed are left out and the motion is later.
    """
    following = deadline + _TICK
    behind = now - following
    if behind > (_MOST_BEHIND if haste > 0 else 0):
        following += -(-behind // _TICK) * _TICK
    return following, max(following, began + round(_TICK / (1.0 + haste)) if haste > 0 else 0)


class Pace:
    """Cycles at their deadlines; those that are `counted` go into the account of lateness."""

    def __init__(self, ring: Ring, counted: Callable[[], bool], haste: Callable[[], float]) -> None:
        self._ring, self._counted, self._haste = ring, counted, haste
        self._lateness = Lateness(ring.head, _TICK)

    def run(self, cycle: Callable[[int], None], look: Callable[[], None]) -> NoReturn:
        """A cycle at each deadline, told the time [ns]; a look between two of them."""
        deadline = due = time.monotonic_ns() + _TICK
        while True:
            now = self._sleep(max(due - time.monotonic_ns(), 0))
            self._ring.beat(now)
            self._lateness.add(now, now - due, self._counted())
            cycle(now)
            # A look at a random instant between two cycles: else a controller that ticks in step with this loop
            # would always be seen equally late, and its clock mapped wrongly by up to a period.
            rest = now + _TICK - time.monotonic_ns()
            if rest > _TICK // 4:
                self._sleep(round(rest * random.uniform(0.0, 0.95)))
                look()
            following, due = next_cycle(deadline, now, time.monotonic_ns(), self._haste())
            if following > deadline + _TICK and self._counted():
                self._lateness.skipped(following - deadline - _TICK)
            deadline = following

    def _sleep(self, duration: int) -> int:
        """Sleep [ns]; the time then. What it takes longer is counted as the host's."""
        if duration <= 0:
            return time.monotonic_ns()
        until = time.monotonic_ns() + duration
        time.sleep(duration / 1e9)
        now = time.monotonic_ns()
        if self._counted():
            self._lateness.overslept(now - until)
        return now
