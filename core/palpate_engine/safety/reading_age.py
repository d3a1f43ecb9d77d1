"""How old readings are when they arrive: how much later they come than the promptest of the last half minute."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

DRIFT = 200e-6  # by which two clocks may run apart
_WINDOW = 30_000_000_000  # [ns]


class ReadingAge:
    """The age of the newest reading of each batch: its lateness, above the lower envelope of the last 30 s.

    Lateness is the time of arrival less the stamp of the device's clock. The envelope rises by `drift`, so that a
    device whose clock is slow is followed; what was late from the start, and what grows more slowly than that, is not
    seen. The newest counts alone: where the computer was held up, the last of many readings is fresh.
    """

    def __init__(self, drift: float = DRIFT) -> None:
        self._drift = drift
        self._first: tuple[int, int] | None = None  # arrival and lateness [ns]
        self._least: deque[tuple[int, float]] = deque()  # arrival, and lateness without drift [ns]; both increase
        self._before = self.latest = 0.0  # [s] of the last two batches

    def add(self, stamps: Sequence[int], arrivals: Sequence[int]) -> None:
        """A batch: stamps [ns] and arrivals [ns], in their order."""
        if not len(stamps):
            return
        now = arrivals[-1]
        if self._first is None:
            self._first = arrivals[0], arrivals[0] - stamps[0]
        began, usual = self._first
        lateness = [
            arrival - stamp - usual - self._drift * (arrival - began)
            for stamp, arrival in zip(stamps, arrivals, strict=True)
        ]
        least = min(lateness)
        while self._least and self._least[-1][1] >= least:
            self._least.pop()
        self._least.append((now, least))
        while now - self._least[0][0] > _WINDOW:
            self._least.popleft()
        self._before, self.latest = self.latest, (lateness[-1] - self._least[0][1]) / 1e9

    def is_over(self, limit: float) -> bool:
        """Whether the newest readings of the last two batches were older than a limit [s]."""
        return min(self._before, self.latest) > limit

    def complaint(self, what: str, limit: float) -> str | None:
        """Why the arm has to stop, in words; None where the last two batches were in time."""
        if not self.is_over(limit):
            return None
        return (
            f"{what} come late: the newest is {1e3 * self.latest:.0f} ms old when it arrives, for the second time over "
            f"[safety] reading_age = {1e3 * limit:g} ms; what the tip feels and where it stands now is not known"
        )
