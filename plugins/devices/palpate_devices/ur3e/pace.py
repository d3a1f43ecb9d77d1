"""The pace of the servo loop: absolute deadlines, and what the host makes of them.

What the host has held up is left out and told to the next cycle: a robot that reads one command in its tick would leap
where several came at once.
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


def next_deadline(deadline: int, now: int) -> tuple[int, int]:
    """The deadline [ns] after one, on its grid, and how many are left out because they passed half a period ago."""
    left_out = max((now - deadline - _TICK // 2 - 1) // _TICK, 0)
    return deadline + (1 + left_out) * _TICK, left_out


class Pace:
    """Cycles at their deadlines; those that are `counted` go into the account of lateness."""

    def __init__(self, ring: Ring, counted: Callable[[], bool]) -> None:
        self._ring, self._counted = ring, counted
        self._lateness = Lateness(ring.head, _TICK)

    def run(self, cycle: Callable[[int, int], None], look: Callable[[], None]) -> NoReturn:
        """A cycle at each deadline, told the time [ns] and how many were left out; a look between two of them."""
        deadline, left_out = time.monotonic_ns() + _TICK, 0
        while True:
            now = self._sleep(max(deadline - time.monotonic_ns(), 0))
            self._ring.beat(now)
            self._lateness.add(now, now - deadline, self._counted())
            cycle(now, left_out)
            # A look at a random instant between two deadlines: else a controller that ticks in step with this loop
            # would always be seen equally late, and its clock mapped wrongly by up to a period.
            rest = deadline + _TICK - time.monotonic_ns()
            if rest > _TICK // 4:
                self._sleep(round(rest * random.uniform(0.0, 0.95)))
                look()
            deadline, left_out = next_deadline(deadline, time.monotonic_ns())
            if left_out and self._counted():
                self._lateness.skipped(left_out * _TICK)

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
