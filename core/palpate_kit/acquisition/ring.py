"""A ring of rows in shared memory: one process writes, one reads, neither ever waits."""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

HEAD = 64  # 64-bit words before the rows
_WRITTEN, _BEAT, _HOST_BEAT = 0, 1, 2
ROWS = 8192  # 8 s of a sensor of 1 kHz: a choice
_BYTES = 8  # of a 64-bit word
_MARGIN = 16  # rows behind the writer that are not read
WORDS = 8  # first word that a device may use as it likes


class Ring:
    """Rows of 64-bit floats, with a head of whole numbers: rows written, heartbeats of both sides, words.

    A row may carry whole numbers in columns that both sides read through `integers`. The counter is written after the
    row, so that a reader never sees half of one; a reader that is a whole ring late learns how many it lost.
    """

    def __init__(self, descriptor: int, columns: int, rows: int = ROWS) -> None:
        self._memory = mmap.mmap(descriptor, ring_size(columns, rows))
        self.head: NDArray[np.int64] = np.frombuffer(self._memory, np.int64, HEAD)
        self._table: Floats = np.frombuffer(self._memory, np.float64, offset=_BYTES * HEAD)
        self._table = self._table.reshape(rows, columns)
        self.columns, self._rows = columns, rows
        self._read = 0
        self.lost = 0

    def write(self, whole: tuple[int, ...], row: Floats | Sequence[float]) -> None:
        """Append a row: whole numbers first, then floats."""
        written = int(self.head[_WRITTEN])
        target = self._table[written % self._rows]
        target[: len(whole)].view(np.int64)[:] = whole
        target[len(whole) :] = row
        self.head[_WRITTEN] = written + 1

    def read(self) -> Floats:
        """Return a copy of the rows that have come since the last call (n, columns)."""
        written = int(self.head[_WRITTEN])
        # The writer may be at work on the row after the last: leave it a margin.
        first = max(self._read, written - self._rows + _MARGIN)
        self.lost += first - self._read
        rows = self._table[np.arange(first, written) % self._rows]
        self._read = written
        return rows

    def early(self) -> Floats:
        """Return what came before the first request for rows, or the latest of it; none of it counts as lost."""
        rows = self.read()
        self.lost = 0
        return rows

    def beat(self, now: int, host: bool = False) -> None:
        """Say that this side is alive at a monotonic time [ns]."""
        self.head[_HOST_BEAT if host else _BEAT] = now

    def last_beat(self, host: bool = False) -> int:
        """Return the monotonic time [ns] at which the other side last was alive; 0 before the first time."""
        return int(self.head[_HOST_BEAT if host else _BEAT])


def integers(rows: Floats, column: int) -> NDArray[np.int64]:
    """Return a column of whole numbers (n,)."""
    return np.ascontiguousarray(rows[:, column]).view(np.int64)


def ring_size(columns: int, rows: int = ROWS) -> int:
    """Return the bytes of shared memory that a ring takes."""
    return _BYTES * (HEAD + columns * rows)


def shared_memory(size: int) -> int:
    """Return the descriptor of memory that has no name and so vanishes with the last process that holds it."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("palpate")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, size)
    return descriptor
