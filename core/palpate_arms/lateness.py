"""The wake-up delay of a loop: a histogram in shared memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Upper edges [ns], a choice: in steps of some 1.5, from the noise of a timer to what ends a motion; the last bin is for
# what is later.
EDGES = np.array([20, 50, 100, 200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 7000, 10000, 20000, 50000]) * 1000
_CYCLES, _MISSED, _LATEST, _FIRST, _LAST, _LOST, _HOST, _BINS = 16, 17, 18, 19, 20, 21, 22, 24  # words of a ring's head
_PERCENTILE = 0.99
_SECOND = 1e9  # [ns]
_MS = 1e3  # per second


class Lateness:
    """Counts the delay of each cycle in the words of a ring's head."""

    def __init__(self, head: NDArray[np.int64], period: int) -> None:
        self._head = head
        self._period = period
        self._edges = EDGES.tolist()

    def add(self, now: int, late: int, counted: bool) -> None:
        """Count one cycle that began at a time [ns], so late [ns]; only cycles that command are counted."""
        if not counted:
            return
        head, number = self._head, 0
        for edge in self._edges:
            if late <= edge:
                break
            number += 1
        head[_BINS + number] += 1
        head[_FIRST], head[_LAST] = head[_FIRST] or now, now
        head[_CYCLES] += 1
        head[_MISSED] += late > self._period
        head[_LATEST] = max(int(head[_LATEST]), late)

    def overslept(self, late: int) -> None:
        """Count the periods of a sleep that the host ended so late [ns]."""
        self._head[_HOST] += max(late, 0) // self._period

    def skipped(self, late: int) -> None:
        """Count the periods that the loop gives up, being behind by so much [ns]."""
        self._head[_LOST] += late // self._period


def lateness_table(head: NDArray[np.int64]) -> dict[str, Any]:
    """Return cycles, mean rate [Hz], missed deadlines (later than a period), largest lateness and p99 [s], histogram.

    `head` has the words that the loop keeps in shared memory: numbers, times [ns], and a count for each bin.
    "periods_lost" had no cycle at all; "periods_lost_to_host" passed while the loop slept and the host, which had been
    asked to wake it, did not.
    """
    counts = head[_BINS : _BINS + len(EDGES) + 1]
    total = int(counts.sum())
    table: dict[str, Any] = {"cycles": int(head[_CYCLES]), "missed": int(head[_MISSED])}
    table |= {"periods_lost": int(head[_LOST]), "periods_lost_to_host": int(head[_HOST])}
    if total:
        span = int(head[_LAST] - head[_FIRST]) / _SECOND
        table["rate"] = (total - 1) / span if span > 0 else None
        rank = int(np.searchsorted(np.cumsum(counts), _PERCENTILE * total))
        edges = [*(EDGES / _SECOND).tolist(), float(head[_LATEST]) / _SECOND]
        table |= {"largest": edges[-1], "p99_below": min(edges[rank], edges[-1])}
        table["histogram"] = {f"{edge * _MS:g} ms": int(n) for edge, n in zip(edges, counts, strict=True) if n}
    return table
