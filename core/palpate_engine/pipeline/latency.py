"""Latency: from the arrival of a reading of the position to its estimate."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from palpate.clocks import host_time_ns
from palpate.device import Batch

from palpate_engine.alignment import Port

_SHORTEST, _LONGEST = 1e-4, 1e3  # [s]
_EDGES = np.geomspace(_SHORTEST, _LONGEST, 210)  # [s]; 8 % apart, the resolution of a quantile: a choice
_QUANTILES = 0.5, 0.99  # that the result states
_SECOND = 1e9  # [ns]


class Latency:
    """A histogram of how long positions took from the process that received them to their estimates."""

    def __init__(self, position: Port) -> None:
        self._port = position
        self._delay = round(_SECOND * position.signal.delay)
        self._arrived: deque[tuple[NDArray[np.int64], NDArray[np.int64]]] = deque()  # true times, arrivals [ns]
        self._counts = np.zeros(len(_EDGES) + 1, np.int64)
        self._largest = 0.0

    def arrived(self, arrivals: Iterable[tuple[str, Batch]]) -> None:
        """Take note of batches, each with its device."""
        for device, batch in arrivals:
            if (device, batch.stream) == self._port.key and len(batch.time):
                stamps = batch.time if self._port.signal.time == "stamp" else batch.received
                self._arrived.append((stamps - self._delay, batch.received))

    def served(self, stamps: NDArray[np.int64]) -> None:
        """Take note that positions of these true times (n,) [ns] have their estimates."""
        now, last = host_time_ns(), int(stamps[-1])
        served: list[NDArray[np.int64]] = []  # arrivals [ns]
        # Arrivals of all positions up to the last one that has an estimate.
        while self._arrived and int(self._arrived[0][0][0]) <= last:
            times, received = self._arrived.popleft()
            if (count := int(np.searchsorted(times, last, side="right"))) < len(times):
                self._arrived.appendleft((times[count:], received[count:]))
            served.append(received[:count])
        latency = (now - np.concatenate(served)) / _SECOND if served else np.zeros(0)  # [s]
        if len(latency):
            self._counts += np.bincount(np.searchsorted(_EDGES, latency), minlength=len(self._counts))
            self._largest = max(self._largest, float(latency.max()))

    def table(self) -> dict[str, float] | None:
        """Return median, 99th percentile (each at most 8 % too large) and maximum [s]; None without an estimate."""
        if not (total := int(self._counts.sum())):
            return None
        # A quantile is the upper edge of the bin in which it lies.
        ranks = np.searchsorted(np.cumsum(self._counts), [share * total for share in _QUANTILES])
        p50, p99 = (min(float(_EDGES[min(rank, len(_EDGES) - 1)]), self._largest) for rank in ranks)
        return {"p50": p50, "p99": p99, "max": self._largest}
