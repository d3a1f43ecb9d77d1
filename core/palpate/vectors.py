"""Vectors of numbers, and names for their parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""An array of floats of any shape."""

_Block = TypeVar("_Block")

_SUMMED_ROWS = 64  # a choice: of fewer rows a test of each is as fast as one of their sum


def finite_rows(values: Floats) -> NDArray[np.bool_]:
    """Return True (n,) for rows of finite numbers (n, k): of few columns far faster than ``all(axis=1)``."""
    rows = np.ones(len(values), bool)
    if len(values) > _SUMMED_ROWS:
        # A sum is finite only if every number is, which is the usual case.
        with np.errstate(all="ignore"):
            if np.isfinite(np.add.reduce(values, axis=None)):
                return rows
    for is_finite in np.isfinite(values).T:
        rows &= is_finite
    return rows


def read_only_view(values: NDArray[Any]) -> NDArray[Any]:
    """Return an array that shares its numbers and cannot be written to; the array itself stays writable."""
    view = np.asarray(values).view()
    view.flags.writeable = False
    return view


def read_only(block: _Block) -> _Block:
    """Return a dataclass with each of its arrays as a read-only view: one block is shared by all plugins."""
    shared = object.__new__(type(block))
    for name, value in vars(block).items():
        is_writable = isinstance(value, np.ndarray) and value.flags.writeable
        shared.__dict__[name] = read_only_view(value) if is_writable else value
    return shared


def dot_columns(one: Sequence[Floats] | Floats, other: Sequence[Floats] | Floats) -> Floats:
    """Return scalar products (n,) of vectors by their three columns (n,): the same bits however many rows there are.

    A matrix product may differ in its last bits with the size of a block.
    """
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


class Layout:
    """The places of the named parts of a vector, one after another.

    ``Layout(depth=1, rate=1, parameters=2)`` is a vector of four entries: ``at("rate")`` is the place of a part that
    is one entry, ``layout["parameters"]`` the slice of a part of any length, and so also of one that is absent
    (length 0). Places and slices index lists, arrays and CasADi columns alike.
    """

    def __init__(self, **lengths: int) -> None:
        """Take the name and length of each part, in their order; raises ValueError for a negative length."""
        self._rows: dict[str, slice] = {}
        self.size = 0
        for name, length in lengths.items():
            if length < 0:
                raise ValueError(f"{name} has {length} entries")
            self._rows[name] = slice(self.size, self.size + length)
            self.size += length

    def __contains__(self, name: object) -> bool:
        """Return True if a part of that name has any entries."""
        rows = self._rows.get(name) if isinstance(name, str) else None
        return rows is not None and rows.start < rows.stop

    def __getitem__(self, name: str) -> slice:
        """Return the slice of a part; raises KeyError where the layout has none of that name."""
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the parts, in their order."""
        return iter(self._rows)

    def at(self, name: str) -> int:
        """Return the place of a part that is one entry; raises KeyError where it is absent, or longer."""
        rows = self._rows[name]
        if rows.stop - rows.start != 1:
            raise KeyError(f"{name} is {rows.stop - rows.start} entries, not one")
        return int(rows.start)

    def span(self, first: str, last: str) -> slice:
        """Return the slice from the beginning of one part to the end of another."""
        return slice(self._rows[first].start, self._rows[last].stop)
