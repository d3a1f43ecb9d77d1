"""The pace of the servo loop: absolute deadlines, and what the host makes of them.

What the host has held up is left out and told to the next cycle: a robot that reads one command in its tick would leap
where several came at once. And the deadlines are drawn to the middle between two ticks of the controller, as its states
show them: commands that come as it ticks are now two in a tick and now none, and the arm trembles.
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
_STEP = 5_000  # [ns] by which a deadline is moved at most: a quarter of a per cent of the speed
_WANDER = 300  # [ns] in a period by which clocks may part


def next_deadline(deadline: int, now: int) -> tuple[int, int]:
    """The deadline [ns] after one, on its grid, and how many are left out because they passed half a period ago."""
    left_out = max((now - deadline - _TICK // 2 - 1) // _TICK, 0)
    return deadline + (1 + left_out) * _TICK, left_out


class Beat:
    """When the controller ticks, by the states that it sends at each tick."""

    def __init__(self) -> None:
        self._offset: int | None = None  # [ns] of its clock, by the state that was least late

    def saw(self, stamp: int, seen: int) -> None:
        """A state of the controller's time `stamp` [ns] was seen at a monotonic time [ns]."""
        offset = seen - stamp
        self._offset = offset if self._offset is None else min(self._offset + _WANDER, offset)

    def correction(self, deadline: int) -> int:
        """By how much to move a deadline [ns], towards the middle between two ticks."""
        if self._offset is None:
            return 0
        off = (deadline - self._offset - _TICK // 2) % _TICK
        return max(-_STEP, min(_STEP, -off if off < _TICK // 2 else _TICK - off))


class Pace:
    """Cycles at their deadlines; those that are `counted` go into the account of lateness."""

    def __init__(self, ring: Ring, beat: Beat, counted: Callable[[], bool]) -> None:
        self._ring, self._beat, self._counted = ring, beat, counted
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
            deadline += self._beat.correction(deadline)
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
