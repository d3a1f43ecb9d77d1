"""Vectors of numbers, and names for what stands in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""An array of floats of any shape."""

_Block = TypeVar("_Block")

_FEW = 64  # rows, for which a look at each is as fast as one at their sum


def finite_rows(values: Floats) -> NDArray[np.bool_]:
    """(n,) whether all numbers (n, k) of a row are finite: of few columns far faster than ``all(axis=1)``."""
    rows = np.ones(len(values), bool)
    if len(values) > _FEW:
        with np.errstate(all="ignore"):
            if np.isfinite(np.add.reduce(values, axis=None)):  # as it nearly always is; nothing not finite would vanish
                return rows
    for known in np.isfinite(values).T:
        rows &= known
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
    """Scalar products (n,) of vectors by their three columns (n,): the same bits however many rows there are.

    A matrix product may differ in its last bits with the size of a block.
    """
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


class Layout:
    """Where the named parts of a vector stand, one after another.

    ``Layout(depth=1, rate=1, parameters=2)`` is a vector of four entries: ``at("rate")`` is the place of a part that
    is one entry, ``layout["parameters"]`` the slice of a part of any length, and so also of one that is absent
    (length 0). Places and slices index lists, arrays and CasADi columns alike.
    """

    def __init__(self, **lengths: int) -> None:
        self._rows: dict[str, slice] = {}
        self.size = 0
        for name, length in lengths.items():
            if length < 0:
                raise ValueError(f"{name} has {length} entries")
            self._rows[name] = slice(self.size, self.size + length)
            self.size += length

    def __contains__(self, name: object) -> bool:
        """Whether a part of that name has any entries."""
        rows = self._rows.get(name) if isinstance(name, str) else None
        return rows is not None and rows.start < rows.stop

    def __getitem__(self, name: str) -> slice:
        """The slice of a part; raises KeyError where the layout has none of that name."""
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        """The names of the parts, in their order."""
        return iter(self._rows)

    def at(self, name: str) -> int:
        """The place of a part that is one entry; raises KeyError where it is absent, or longer."""
        rows = self._rows[name]
        if rows.stop - rows.start != 1:
            raise KeyError(f"{name} is {rows.stop - rows.start} entries, not one")
        return int(rows.start)

    def span(self, first: str, last: str) -> slice:
        """The slice from the beginning of one part to the end of another."""
        return slice(self._rows[first].start, self._rows[last].stop)
