"""Tables of the arrays in a file: named arrays of equal length are the columns of one table."""

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
_MIN_ROWS = 20  # of a record; shorter arrays are values of the experiment, or lists of them: a choice
_PRESS_ROLES = {"force", "position"}  # that every press has
_MAX_WIDTH = 64  # columns of a matrix; a wider one is an image: a choice
_MAX_FACT = 40  # characters of a single value that are kept: a choice

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
            out.write(f"{_one_line(name)}: {_one_line(value)}\n")
        writer = csv.writer(out, delimiter="\t", lineterminator="\n")
        if any(not name.isdigit() for name in self.columns):
            writer.writerow(map(_one_line, self.columns))
        writer.writerows(zip(*map(_cells, self.columns.values()), strict=True))
        return out.getvalue()


def demand_readable_size(numbers: int) -> None:
    """Raise ValueError for more numbers than are read."""
    if not 0 <= numbers <= MAX_NUMBERS:
        raise ValueError(f"it states that it holds {numbers:.3g} numbers; {MAX_NUMBERS / 1e6:.0f} million are read")


def tables_of(arrays: Iterable[tuple[Sequence[str], Any]], name: str) -> list[ArrayTable]:
    """Return the tables of arrays, each with its path of names; the one with most columns first.

    Arrays of one length are one table; but where groups have the same names, as of several specimens, a table each.
    Groups such as "wrench" and "pose", of which none holds both a force and a height, are columns of the group above.
    """
    named_arrays = [(tuple(path), np.asarray(values)) for path, values in arrays]
    columns, facts = _columns_and_facts(named_arrays)
    if _is_repeated(columns):
        columns = _below_groups_of_presses(columns)
    # Columns of one length are a table; of repeated groups, those of one group.
    is_repeated = _is_repeated(columns)
    columns_by_table: dict[tuple[str, int], dict[str, Array]] = {}  # by group and length
    for path, array in columns.items():
        group = " ".join(path[:-1]) if is_repeated else ""
        columns_by_table.setdefault((group, len(array)), {})[path[-1]] = array
    # A single column does not make a table.
    tables = [(key, table) for key, table in columns_by_table.items() if len(table) > 1]
    tables.sort(key=lambda item: -len(item[1]))
    only_name = name if len(tables) == 1 else ""
    return [ArrayTable(group or only_name or f"{rows} rows", table, facts) for (group, rows), table in tables]


def _columns_and_facts(
    arrays: Sequence[tuple[tuple[str, ...], Array]],
) -> tuple[dict[tuple[str, ...], Array], dict[str, str]]:
    """Return the columns by their paths, and single values by their names; short arrays are neither."""
    columns: dict[tuple[str, ...], Array] = {}
    facts: dict[str, str] = {}
    for path, array in arrays:
        if array.ndim == 2 and min(array.shape) == 1:
            array = array.ravel()
        if array.size == 1 and array.dtype.kind in "biufUS":
            facts[path[-1]] = _text(array.ravel()[0])[:_MAX_FACT]
        elif array.ndim and len(array) >= _MIN_ROWS:
            names = _names_of_columns(arrays, path[:-1], array.shape[-1]) if array.ndim == 2 else ()
            columns |= _columns(path, array, names)
    return columns, facts


def _is_repeated(paths: Iterable[tuple[str, ...]]) -> bool:
    """Return True if arrays of several groups have the same name."""
    names = [path[-1] for path in paths]
    return len({*names}) < len(names)


def _below_groups_of_presses(columns: Mapping[tuple[str, ...], Array]) -> dict[tuple[str, ...], Array]:
    """Return columns with names such as "wrench.force.z" below the innermost groups of which one holds a press."""
    for depth in range(max(map(len, columns)) - 1, -1, -1):
        regrouped: dict[tuple[str, ...], Array] = {}
        roles: dict[tuple[str, ...], set[str | None]] = {}
        for path, array in columns.items():
            level = min(depth, len(path) - 1)
            group = path[:level]
            name = ".".join(path[level:])
            regrouped[(*group, name)] = array
            roles.setdefault(group, set()).add(stated_role(name))
        if any(group_roles >= _PRESS_ROLES for group_roles in roles.values()):
            return regrouped
    return {**columns}


def _names_of_columns(
    arrays: Iterable[tuple[tuple[str, ...], Array]], group: tuple[str, ...], width: int
) -> Sequence[str]:
    """Return the names of the columns of a matrix; empty if they are not stated.

    They are the only array of `width` texts in its group, or the only one besides an array of units.
    """
    texts = {}
    for path, array in arrays:
        if path[:-1] == group and array.size == width > 1 and all(isinstance(text, str) for text in array.ravel()):
            texts[path[-1].lower()] = [str(text) for text in array.ravel()]
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
        names = [f"{path[-1]}[{k}]" if path[-1] else str(k) for k in range(array.shape[1])]
        return {(*path[:-1], name): array[:, k] for k, name in enumerate(names)}
    return {path: array} if array.ndim == 1 else {}


def _cells(array: Array) -> Iterable[str]:
    """Return the cells of a column: numbers in full, durations in seconds, dates in the form of ISO 8601."""
    if array.dtype.kind == "m":
        array = array / np.timedelta64(1, "s")
    cell_of_kind: Mapping[str, Callable[[Any], str]] = {"f": _number_text, "S": _text, "U": _text}
    if array.dtype.kind == "M":
        return map(str, np.datetime_as_string(array))
    values = array.astype(np.int64) if array.dtype.kind == "b" else array
    return map(cell_of_kind.get(array.dtype.kind, str), values.tolist())


def _number_text(value: float) -> str:
    """Return a number in full; empty for NaN."""
    return "" if value != value else repr(value)


def _text(value: Any) -> str:
    """Return bytes or any other value as text."""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _one_line(text: str) -> str:
    """Return a text without line breaks and tabs."""
    return " ".join(str(text).split())
