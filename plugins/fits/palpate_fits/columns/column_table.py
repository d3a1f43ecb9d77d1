"""Columns of samples as machine code reads them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate import Floats

LANES = 4  # samples that are added at a time (choice)
_DOUBLE = 8  # [bytes]


class ColumnTable:
    """Columns (nw times (n,)) of samples, as a function over columns reads them: contiguous, never changed."""

    def __init__(self, columns: Sequence[Floats]) -> None:
        self.columns = tuple(np.ascontiguousarray(column, np.float64) for column in columns)
        self._addresses: dict[int, list[tuple[int, Any, int]]] = {}

    def __len__(self) -> int:
        return len(self.columns[0])

    def part(self, begin: int, end: int) -> ColumnTable:
        """Return the rows from begin to end, which share the memory of the table."""
        return ColumnTable([column[begin:end] for column in self.columns])

    def addresses(self, length: int) -> list[tuple[int, Any, int]]:
        """Return count, addresses of the columns, and the address of these, of each block of at most `length` rows."""
        if length not in self._addresses:
            begins = np.array([column.ctypes.data for column in self.columns], np.uintp)
            count = len(self)
            starts = range(0, count, length)
            places = [begins + np.uintp(_DOUBLE * start) for start in starts] if count > length else [begins]
            self._addresses[length] = [
                (min(length, count - start), place, place.ctypes.data)
                for start, place in zip(starts, places, strict=False)
            ]
        return self._addresses[length]
