"""What the page's process remembers: enough for a browser that comes late, in memory that does not grow."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.page.datagrams import Header, Rows, pack, pack_rows, unpack

ROWS = 24_000  # four minutes in full; of a longer run the older part is ever coarser
ROWS_RECORDED = 240_000
_MESSAGES = 2_000  # flags and states of the guard; the oldest go first
_MESSAGES_RECORDED = 200_000
_LATEST = ("health", "found")  # of these only the latest counts, by track


class History:
    """Rows of the whole run, the older the coarser, and the messages of its present state."""

    def __init__(self) -> None:
        self.run: Header | None = None
        self._time = np.zeros(0)
        self._columns = np.zeros((0, 0), np.float32)
        self._count = 0
        self._latest: dict[tuple[str, str | None], bytes] = {}
        self._events: deque[bytes] = deque(maxlen=_MESSAGES)

    @property
    def recorded(self) -> bool:
        """True if it is all of a record, not of a run in progress."""
        return bool(self.run and self.run["recorded"])

    @property
    def rows(self) -> Rows:
        """Times (n,) and columns (columns, n)."""
        return self._time[: self._count], self._columns[:, : self._count]

    def add(self, message: bytes) -> str:
        """Remember a message's contents; returns its kind."""
        header, rows = unpack(message)
        kind = header["kind"]
        if kind == "run":
            self.run = header
            size = ROWS_RECORDED if header["recorded"] else ROWS
            self._time, self._columns = np.empty(size), np.empty((header["columns"], size), np.float32)
            self._events = deque(maxlen=_MESSAGES_RECORDED if header["recorded"] else _MESSAGES)
        elif kind == "rows" and rows is not None:
            self._append(*rows)
        elif kind == "later" and rows is not None:
            self._fill(header["begin"], *rows)
        elif kind in _LATEST and not self.recorded:
            self._latest[kind, header.get("track")] = message
        else:
            self._events.append(message)
        return str(kind)

    def _append(self, time: Floats, columns: NDArray[np.float32]) -> None:
        if self._count + len(time) > len(self._time):
            self._thin()
        end = self._count + len(time)
        self._time[self._count : end], self._columns[:, self._count : end] = time, columns
        self._count = end

    def _thin(self) -> None:
        """Of the older three quarters every second row goes."""
        old = self._count * 3 // 4
        kept = np.concatenate([np.arange(0, old, 2), np.arange(old, self._count)])
        self._time[: len(kept)] = self._time[kept]
        self._columns[:, : len(kept)] = self._columns[:, kept]
        self._count = len(kept)

    def _fill(self, begin: int, time: Floats, columns: NDArray[np.float32]) -> None:
        """An offline estimator's results for known rows, by their times."""
        known = self._time[: self._count]
        places = np.searchsorted(known, time)
        found = np.flatnonzero(places < self._count)
        found = found[known[places[found]] == time[found]]
        self._columns[begin : begin + len(columns), places[found]] = columns[:, found]

    def messages(self) -> Iterator[bytes]:
        """Yield all that a browser needs to show what the others show."""
        if self.run is None:
            return
        yield pack(self.run)
        yield pack_rows({"kind": "rows"}, *self.rows)
        yield from self._latest.values()
        yield from self._events
