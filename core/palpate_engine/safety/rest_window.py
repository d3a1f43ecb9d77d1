"""The latest states of a tip that is to stand, and whether they show that it does."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

SPAN = 100_000_000  # [ns] of states that show a standstill (0455)
_SECOND = 1e9  # [ns]
_MIN_STATES = 8  # of 10 that a controller of 100 Hz sends meanwhile: two may go unseen
_MAX_SPREAD = 0.1e-3  # [m] along any axis; 4 times what the noise of a pose, 5 um, spreads over 50 states
_MAX_SPEED = 0.5e-3  # [m/s] between the means of both halves; 10 times what that noise makes of it


class RestWindow:
    """States of the last `span` [ns], since an arm was stopped: their places lie together, and do not drift."""

    def __init__(self, span: int = SPAN) -> None:
        self._span = span
        self._states: deque[tuple[int, tuple[float, ...]]] = deque()  # time [ns], place [m]

    def add(self, time: int, place: Sequence[float]) -> None:
        """Take a state's time [ns], and its place [m]; one axis or three."""
        states = self._states
        states.append((time, tuple(place)))
        while len(states) > 1 and time - states[1][0] >= self._span:
            states.popleft()

    @property
    def is_full(self) -> bool:
        """True if the states cover the span."""
        return len(self._states) >= _MIN_STATES and self._states[-1][0] - self._states[0][0] >= self._span

    @property
    def speed(self) -> float | None:
        """Mean speed [m/s] from the first half of the states to the second; None of less than two states."""
        half = len(self._states) // 2
        if half == 0:
            return None
        states = list(self._states)
        first, second = _mean(states[:half]), _mean(states[half:])
        elapsed = (second[0] - first[0]) / _SECOND
        return math.dist(first[1], second[1]) / elapsed if elapsed > 0 else None

    @property
    def shows_rest(self) -> bool:
        """True if the states show that the tip stands."""
        if not self.is_full:
            return False
        axes = zip(*(place for _, place in self._states), strict=True)
        speed = self.speed
        return speed is not None and speed < _MAX_SPEED and all(max(axis) - min(axis) < _MAX_SPREAD for axis in axes)


def _mean(states: Sequence[tuple[int, tuple[float, ...]]]) -> tuple[float, list[float]]:
    """Return mean time [ns] and mean place [m] of some states."""
    times = [time for time, _ in states]
    axes = zip(*(place for _, place in states), strict=True)
    return sum(times) / len(times), [sum(axis) / len(states) for axis in axes]
