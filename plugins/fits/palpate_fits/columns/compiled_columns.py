"""A function over columns as machine code by LLVM."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.kernel.llvm import COMPILING, code_addresses

from palpate_fits.columns.column_table import LANES, ColumnTable
from palpate_fits.columns.column_translation import ColumnTranslation

_DOUBLE = 8  # [bytes]


class CompiledColumns:
    """A function over columns as machine code; see `column_function.ColumnKernel`."""

    def __init__(self, function: Any) -> None:
        self._width = int(function.numel_out(1))
        self._columns = np.arange(self._width, dtype=np.uintp)
        with COMPILING:
            self._values, self._products = _compiled_columns(function.serialize())

    def values(self, table: ColumnTable, settings: Floats) -> Floats:
        """See `column_function.ColumnKernel`."""
        count = len(table)
        values = np.empty((self._width, count))
        if count:
            columns = values.ctypes.data + self._columns * np.uintp(_DOUBLE * count)
            ((_, _, places),) = table.addresses(count)
            self._values(count, places, settings.ctypes.data, columns.ctypes.data)
        return values

    def lanes(self, table: ColumnTable, settings: Floats, length: int) -> Floats:
        """See `column_function.ColumnKernel`."""
        blocks = table.addresses(length)
        sums = np.zeros((len(settings), len(blocks), self._width * (self._width + 1) // 2, LANES))
        # The addresses of the sums of each block, and of each row of settings.
        out, step = sums.ctypes.data, _DOUBLE * sums.shape[2] * LANES
        first, width = settings.ctypes.data, _DOUBLE * settings.shape[1]
        for row in range(first, first + width * len(settings), width):
            for count, _, places in blocks:
                self._products(count, places, row, out)
                out += step
        return sums


@cache
def _compiled_columns(text: str) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return a serialised function over columns as machine code: its values, and the sums of their products."""
    address = code_addresses("columns", text, ColumnTranslation)
    # A count of samples, then the addresses of samples, settings and result.
    prototype = ctypes.CFUNCTYPE(None, ctypes.c_int64, *([ctypes.c_void_p] * 3))
    return prototype(address("values")), prototype(address("products"))
