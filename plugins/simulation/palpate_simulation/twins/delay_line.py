"""A connection on which what is sent arrives late."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

_PACE = 0.5  # [s/s] at which the lateness grows: what arrives thins out, and is never silent
_Item = TypeVar("_Item")


class DelayLine(Generic[_Item]):
    """Holds things back for a time that grows until it is as long as set, and keeps their order."""

    def __init__(self) -> None:
        self._most, self._since = 0.0, 0.0  # [s]
        self._held: deque[tuple[float, _Item]] = deque()  # when each arrives [s]

    def set(self, most: float, now: float) -> None:
        """Be late by `most` [s] in the end, from a time [s] on; raises ValueError where it is not positive."""
        if not 0.0 <= most < 60.0:
            raise ValueError("a time from 0 to 60 s")
        self._most, self._since = most, now

    def clear(self) -> None:
        """Nothing is late any more; what is held back is lost."""
        self._most = 0.0
        self._held.clear()

    @property
    def is_on(self) -> bool:
        """True if anything is held back."""
        return self._most > 0.0

    def put(self, item: _Item, now: float) -> None:
        """Send at a time [s]."""
        self._held.append((now + min(self._most, _PACE * max(now - self._since, 0.0)), item))

    def take(self, now: float) -> list[_Item]:
        """What has arrived by a time [s]."""
        found = []
        while self._held and self._held[0][0] <= now:
            found.append(self._held.popleft()[1])
        return found
