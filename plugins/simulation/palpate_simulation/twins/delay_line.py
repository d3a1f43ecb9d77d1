"""A connection on which what is sent arrives late."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

LATENESS_RATE = 0.5  # [s/s] at which the lateness grows (a choice): arrivals become rarer, and never end
MAX_LATENESS = 60.0  # [s] (a choice): longer than any run waits
_Item = TypeVar("_Item")


class DelayLine(Generic[_Item]):
    """A queue that holds items back for a time that grows up to a final lateness; it keeps their order."""

    def __init__(self) -> None:
        self._lateness, self._start = 0.0, 0.0  # [s] in the end; [s] from which it grows
        self._queue: deque[tuple[float, _Item]] = deque()  # with the time [s] at which each item arrives

    def set(self, lateness: float, now: float) -> None:
        """Let the lateness grow from a time [s] on, up to `lateness` [s]; raises ValueError below 0 and from 60 s."""
        if not 0.0 <= lateness < MAX_LATENESS:
            raise ValueError("a time from 0 to 60 s")
        self._lateness, self._start = lateness, now

    def clear(self) -> None:
        """End the lateness; the items on their way are lost."""
        self._lateness = 0.0
        self._queue.clear()

    @property
    def is_on(self) -> bool:
        """True if items are held back."""
        return self._lateness > 0.0

    def put(self, item: _Item, now: float) -> None:
        """Send an item at a time [s]."""
        lateness = min(self._lateness, LATENESS_RATE * max(now - self._start, 0.0))
        self._queue.append((now + lateness, item))

    def take(self, now: float) -> list[_Item]:
        """Return the items that have arrived by a time [s], and remove them."""
        items = []
        while self._queue and self._queue[0][0] <= now:
            items.append(self._queue.popleft()[1])
        return items
