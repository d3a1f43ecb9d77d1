"""The memory of the page's process: enough for a browser that comes late, and of limited size."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.page.datagrams import Header, Rows, pack, pack_rows, unpack

# Choices.
ROWS = 24_000  # four minutes at 100 Hz in full; of a longer run the older part is ever coarser
ROWS_RECORDED = 240_000  # 40 minutes
_THINNED_SHARE = 3, 4  # numerator and denominator of the older rows, of which every second one goes
_MESSAGES = 2_000  # flags and states of the guard; the oldest go first
_MESSAGES_RECORDED = 200_000
_LATEST_KINDS = ("health", "found")  # messages of which only the latest counts, by track


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
        """Times (n,) [s] and columns (columns, n)."""
        return self._time[: self._count], self._columns[:, : self._count]

    def add(self, message: bytes) -> str:
        """Remember a message's contents, and return its kind.

        The first message, "run", states the number of columns. "rows" are appended; "later" are those of an offline
        estimator for columns from "begin" on; of some kinds the latest counts, the others are kept in their order.
        """
        header, rows = unpack(message)
        kind = header["kind"]
        if kind == "run":
            self.run = header
            capacity = ROWS_RECORDED if header["recorded"] else ROWS
            self._time, self._columns = np.empty(capacity), np.empty((header["columns"], capacity), np.float32)
            self._events = deque(maxlen=_MESSAGES_RECORDED if header["recorded"] else _MESSAGES)
        elif kind == "rows" and rows is not None:
            self._append(*rows)
        elif kind == "later" and rows is not None:
            self._fill(header["begin"], *rows)
        elif kind in _LATEST_KINDS and not self.recorded:
            self._latest[kind, header.get("track")] = message
        else:
            self._events.append(message)
        return str(kind)

    def _append(self, time: Floats, columns: NDArray[np.float32]) -> None:
        """Append rows at times (n,) with columns (columns, n); thin the older ones where the capacity is reached."""
        if self._count + len(time) > len(self._time):
            self._thin()
        end = self._count + len(time)
        self._time[self._count : end] = time
        self._columns[:, self._count : end] = columns
        self._count = end

    def _thin(self) -> None:
        """Drop every second row of the older three quarters."""
        numerator, denominator = _THINNED_SHARE
        old_count = self._count * numerator // denominator
        remaining = np.concatenate([np.arange(0, old_count, 2), np.arange(old_count, self._count)])
        self._time[: len(remaining)] = self._time[remaining]
        self._columns[:, : len(remaining)] = self._columns[:, remaining]
        self._count = len(remaining)

    def _fill(self, first_column: int, time: Floats, columns: NDArray[np.float32]) -> None:
        """Write an offline estimator's columns (columns, n) to the rows that have its times (n,); others are left."""
        row_times = self._time[: self._count]
        rows = np.searchsorted(row_times, time)
        inside = np.flatnonzero(rows < self._count)
        matching = inside[row_times[rows[inside]] == time[inside]]
        self._columns[first_column : first_column + len(columns), rows[matching]] = columns[:, matching]

    def messages(self) -> Iterator[bytes]:
        """Yield all that a browser needs to show what the others show."""
        if self.run is None:
            return
        yield pack(self.run)
        yield pack_rows({"kind": "rows"}, *self.rows)
        yield from self._latest.values()
        yield from self._events
