"""Tables made of the arrays that a file holds by name: those of equal length are the columns of one table."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate_records.tables.csv_names import stated_role

MAX_NUMBERS = 10_000_000  # of a file, all columns together: some 200 MB as text
_MIN_ROWS = 20  # of a record; shorter arrays are values of the experiment, or a list of them
_PRESS = {"force", "position"}  # roles that every press has
_MAX_WIDTH = 64  # columns of a matrix; a wider one is an image
_FACT_LENGTH = 40  # characters of a single value

Array = NDArray[Any]


@dataclass(frozen=True)
class ArrayTable:
    """Columns of equal length, and single values above them."""

    name: str
    columns: Mapping[str, Array]  # by name, (n,) each
    facts: Mapping[str, str]

    def text(self) -> str:
        """Return the table with tabs between its cells, its numbers in full."""
        out = io.StringIO()
        for name, value in self.facts.items():
            out.write(f"{_line(name)}: {_line(value)}\n")
        writer = csv.writer(out, delimiter="\t", lineterminator="\n")
        if any(not name.isdigit() for name in self.columns):
            writer.writerow(map(_line, self.columns))
        writer.writerows(zip(*map(_cells, self.columns.values()), strict=True))
        return out.getvalue()


def demand_readable_size(numbers: int) -> None:
    """Raise ValueError for more numbers than are read."""
    if not 0 <= numbers <= MAX_NUMBERS:
        raise ValueError(f"it states that it holds {numbers:.3g} numbers; {MAX_NUMBERS / 1e6:.0f} million are read")


def tables_of(arrays: Iterable[tuple[Sequence[str], Any]], name: str) -> list[ArrayTable]:
    """Return the tables of arrays, each with its path of names; the one with most columns first.

    Arrays of one length are one table, but where groups have the same names, as of several specimens, a table each.
    Groups such as "wrench" and "pose", of which none holds a force and a height, are columns of the group above them.
    """
    columns: dict[tuple[str, ...], Array] = {}
    facts: dict[str, str] = {}
    named = [(tuple(path), np.asarray(values)) for path, values in arrays]
    for path, array in named:
        if array.ndim == 2 and min(array.shape) == 1:
            array = array.ravel()
        if array.size == 1 and array.dtype.kind in "biufUS":
            facts[path[-1]] = _text(array.ravel()[0])[:_FACT_LENGTH]
        elif array.ndim and len(array) >= _MIN_ROWS:
            names = _names_of_columns(named, path[:-1], array.shape[-1]) if array.ndim == 2 else ()
            columns |= _columns(path, array, names)
    if _is_repeated(columns):
        columns = _below_groups_of_presses(columns)
    is_repeated = _is_repeated(columns)
    groups: dict[tuple[str, int], dict[str, Array]] = {}
    for path, array in columns.items():
        group = " ".join(path[:-1]) if is_repeated else ""
        groups.setdefault((group, len(array)), {})[path[-1]] = array
    usual = [(key, table) for key, table in groups.items() if len(table) > 1]
    usual.sort(key=lambda item: -len(item[1]))
    return [ArrayTable(group or (name if len(usual) == 1 else f"{rows} rows"), table, facts)
            for (group, rows), table in usual]  # fmt: skip


def _is_repeated(paths: Iterable[tuple[str, ...]]) -> bool:
    """Return True if arrays of several groups have the same name."""
    names = [path[-1] for path in paths]
    return len({*names}) < len(names)


def _below_groups_of_presses(columns: Mapping[tuple[str, ...], Array]) -> dict[tuple[str, ...], Array]:
    """Return columns with names such as "wrench.force.z" below the innermost groups of which one holds a press."""
    for depth in range(max(map(len, columns)) - 1, -1, -1):
        below: dict[tuple[str, ...], Array] = {}
        roles: dict[tuple[str, ...], set[str | None]] = {}
        for path, array in columns.items():
            level = min(depth, len(path) - 1)
            group, name = path[:level], ".".join(path[level:])
            below[(*group, name)] = array
            roles.setdefault(group, set()).add(stated_role(name))
        if any(group_roles >= _PRESS for group_roles in roles.values()):
            return below
    return {**columns}


def _names_of_columns(
    arrays: Iterable[tuple[tuple[str, ...], Array]], group: tuple[str, ...], width: int
) -> Sequence[str]:
    """Return the names of a matrix's columns, by the one array of so many texts in its group, with units of another."""
    texts = {
        path[-1].lower(): [str(text) for text in array.ravel()]
        for path, array in arrays
        if path[:-1] == group and array.size == width > 1 and all(isinstance(text, str) for text in array.ravel())
    }
    units = [texts.pop(name) for name in ("unit", "units") if name in texts]
    if len(texts) != 1:
        return ()
    (names,) = texts.values()
    return [f"{name} [{unit}]" for name, unit in zip(names, units[0], strict=True)] if units else names


def _columns(path: tuple[str, ...], array: Array, names: Sequence[str] = ()) -> dict[tuple[str, ...], Array]:
    """Return an array (n,), the columns of a matrix (n, k), or the fields of records (n,), by their paths of names."""
    if array.dtype.names is not None:
        fields = [_columns((*path[:-1], field), array[field]) for field in array.dtype.names]
        return {key: values for field in fields for key, values in field.items()}
    if array.dtype.kind not in "biufmMSU":
        return {}
    if array.ndim == 2 and len({*names}) == array.shape[1]:
        return {(*path[:-1], name): array[:, k] for k, name in enumerate(names)}
    if array.ndim == 2 and array.shape[1] <= _MAX_WIDTH:
        return {(*path[:-1], f"{path[-1]}[{k}]" if path[-1] else str(k)): array[:, k] for k in range(array.shape[1])}
    return {path: array} if array.ndim == 1 else {}


def _cells(array: Array) -> Iterable[str]:
    """Return the cells of a column; numbers are read back to the bit, durations are seconds."""
    if array.dtype.kind == "m":
        array = array / np.timedelta64(1, "s")
    kinds: Mapping[str, Callable[[Any], str]] = {"f": _number, "S": _text, "U": _text}
    if array.dtype.kind == "M":
        return map(str, np.datetime_as_string(array))
    values = array.astype(np.int64) if array.dtype.kind == "b" else array
    return map(kinds.get(array.dtype.kind, str), values.tolist())


def _number(value: float) -> str:
    return "" if value != value else repr(value)


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _line(text: str) -> str:
    return " ".join(str(text).split())
