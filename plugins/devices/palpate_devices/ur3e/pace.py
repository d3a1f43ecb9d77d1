"""The pace of the servo loop: absolute deadlines, and what the host makes of them.

What the host holds up is not made up for: motion time stands still meanwhile, so that no motion is ever faster than it
was planned.
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


def next_deadline(deadline: int, now: int) -> int:
    """The next deadline [ns] after one; those that have passed while the host held the loop up are left out."""
    return deadline + max(-(-(now - deadline) // _TICK), 1) * _TICK


class Pace:
    """Cycles at their deadlines; those that are `counted` go into the account of lateness."""

    def __init__(self, ring: Ring, counted: Callable[[], bool]) -> None:
        self._ring, self._counted = ring, counted
        self._lateness = Lateness(ring.head, _TICK)

    def run(self, cycle: Callable[[int], None], look: Callable[[], None]) -> NoReturn:
        """A cycle at each deadline, told the time [ns]; a look between two of them."""
        deadline = time.monotonic_ns() + _TICK
        while True:
            wait = max(deadline - time.monotonic_ns(), 0)
            now = self._sleep(wait)
            self._ring.beat(now)
            self._lateness.add(now, now - deadline, self._counted())
            cycle(now)
            # A look at a random instant between two deadlines: else a controller that ticks in step with this loop
            # would always be seen equally late, and its clock mapped wrongly by up to a period.
            rest = deadline + _TICK - time.monotonic_ns()
            if rest > _TICK // 4:
                self._sleep(round(rest * random.uniform(0.0, 0.95)))
                look()
            following = next_deadline(deadline, time.monotonic_ns())
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
