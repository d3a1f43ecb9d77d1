"""The columns of a table that a pipeline names: their places in the file, their units, the numbers in their cells."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from palpate import Floats, LogError, to_si
from palpate_records.messages.readings import si_unit
from palpate_records.tables.cell_units import cell_factor, number_and_unit
from palpate_records.tables.cells import POINTS, has_decimal_comma, is_overload, number
from palpate_records.tables.clock_times import CLOCK, seconds_of_day
from palpate_records.tables.csv_layout import TableLayout
from palpate_records.tables.csv_names import weight_of
from palpate_records.tables.dialect import MARKS, Dialect, TableRow
from palpate_records.tables.plain_numbers import without_digits

from palpate_logs.csv_settings import Column, CsvSettings, Tally

_NANOSECOND = 1e-9  # [s]
_MAX_EXAMPLE = 40  # characters of a line that are shown, a choice: as those of a sheet


@dataclass(frozen=True)
class RequestedColumn:
    """A column that is read."""

    reference: int | str  # its number from 0, or its name in the header
    unit: str  # of its numbers
    factor: float  # size of one of its numbers [SI]
    settings: Column | None = None  # that name it; None for the nanoseconds of a time in two columns

    @property
    def is_clock(self) -> bool:
        """True for a column of times of day; a channel's unit is a unit of SI, so that this is a time."""
        return self.unit == CLOCK


def requested_columns(log: CsvSettings) -> list[RequestedColumn]:
    """Return the columns of the channels, then that of the nanoseconds, if there is one, then that of the time."""
    columns = [
        RequestedColumn(channel.column, channel.unit, si_unit(channel.unit)[1] * channel.scale, channel)
        for channel in log.columns.values()
    ]
    time = log.time
    if time is None:
        return columns
    if time.nanoseconds is not None:
        columns.append(RequestedColumn(time.nanoseconds, "s", _NANOSECOND))
    second = 1.0 if time.unit == CLOCK else to_si(f"1 {time.unit}", "s")
    columns.append(RequestedColumn(time.column, time.unit, second * time.scale, time))
    return columns


def column_indices(columns: Sequence[RequestedColumn], layout: TableLayout, path: Path) -> list[int]:
    """Return the index of each column in the file; raises LogError for a name that no column has, or two."""
    names = [*(layout.names or ())]
    indices = []
    for column in columns:
        if isinstance(column.reference, int):
            indices.append(column.reference)
            continue
        name = column.reference
        # The line of names may begin with the mark of a comment, which is not part of the first name.
        if name not in names:
            name = name.lstrip("".join(MARKS)).strip()
        if names.count(name) != 1:
            columns_there = ", ".join(names) if names else "its first line contains numbers"
            count = "two columns" if name in names else "no column"
            raise LogError(f"{path}: {count} of the name {name!r} ({columns_there})")
        indices.append(names.index(name))
    return indices


def demand_units(columns: Sequence[RequestedColumn], indices: Sequence[int], layout: TableLayout, path: Path) -> None:
    """Raise LogError for a column whose unit is not that in the file's own row of units.

    A text in that row that is not a unit, a scaled column and a time of day agree with any.
    """
    for column, index in zip(columns, indices, strict=True):
        if column.settings is None or column.settings.scale != 1.0 or column.is_clock:
            continue
        written_unit = layout.units[index] if index < len(layout.units) else ""
        try:
            file_unit = si_unit(weight_of(written_unit) or written_unit)
        except ValueError:
            continue
        if file_unit != si_unit(column.unit):
            raise LogError(
                f"{path}:{layout.units_line}: the row of units says {written_unit!r} for column "
                f"{column.settings.column!r}, and not {column.unit!r}; units = 0 lets this be"
            )


class CellReader:
    """The numbers in the cells of requested columns."""

    def __init__(
        self, path: Path, dialect: Dialect, columns: Sequence[RequestedColumn], indices: Sequence[int], tally: Tally
    ) -> None:
        self._path = path
        self._dialect = dialect
        self._columns = [*zip(indices, columns, strict=True)]
        self._tally = tally
        # Python's float reads numbers as they are written here.
        self._has_usual_numbers = dialect == Dialect(dialect.delimiter, comment=dialect.comment)

    def numbers(self, rows: Sequence[TableRow]) -> Floats:
        """Return the numbers (n, columns) of rows: at once if all cells look like numbers, else one by one."""
        with suppress(ValueError, IndexError):
            texts = [cells[index] for _, cells in rows for index, _ in self._columns]
            if self._has_usual_numbers and not without_digits("".join(texts)).strip(" "):
                return np.array([float(text) for text in texts]).reshape(len(rows), len(self._columns))
        return np.array(
            [[self._number(cells, line, index, column) for index, column in self._columns] for line, cells in rows]
        )

    def _number(self, cells: Sequence[str], line: int, index: int, column: RequestedColumn) -> float:
        """Return the number in the cell of a column, in its unit; NaN for an empty cell and for a mark of overload.

        Raises LogError for any other text, and for a line, counted from 1, without that cell.
        """
        if index >= len(cells):
            if len(cells) == 1 and not self._dialect.is_value(cells[0]):
                example = cells[0].strip()[:_MAX_EXAMPLE]
                raise LogError(f"{self._path}:{line}: {example!r} is not a row of numbers")
            raise LogError(f"{self._path}:{line}: no column {index}; the line has {len(cells)}, 0 to {len(cells) - 1}")
        text = cells[index].strip()
        try:
            return self._parse_number(text, column)
        except ValueError as error:
            if is_overload(text):
                self._tally.overload += 1
                return np.nan
            is_comma = not column.is_clock and self._dialect.decimal == "." and has_decimal_comma(text)
            advice = f"; a decimal comma? {POINTS}" if is_comma else ""
            form = "time of day" if column.is_clock else "number"
            problem = f"column {index} holds {text!r}, which is not a {form}{advice}"
            raise LogError(f"{self._path}:{line}: {problem}") from error

    def _parse_number(self, text: str, column: RequestedColumn) -> float:
        """Return the number of a text in the unit of its column, of a time of day in seconds; NaN without a text.

        Raises ValueError for a text of another form.
        """
        if not text:
            return np.nan
        if column.is_clock:
            return seconds_of_day(text)
        number_text, cell_unit = number_and_unit(text)
        factor = cell_factor(cell_unit, column.unit) if cell_unit else 1.0
        return number(number_text, self._dialect.decimal, self._dialect.thousands) * factor
