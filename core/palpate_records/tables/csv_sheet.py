"""A table without a description: its dialect, names, numbers and units, found from its first lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from palpate import Floats, LogError, printable

from palpate_records.messages.readings import si_unit
from palpate_records.tables.binary_tables import is_binary_table
from palpate_records.tables.cell_units import cell_factor, number_and_unit
from palpate_records.tables.cells import POINTS, has_decimal_comma, is_cut_at_commas, number_or_nan
from palpate_records.tables.clock_times import Days, seconds_or_nan
from palpate_records.tables.csv_layout import StatedValue, TableLayout, first_lines, layout_of
from palpate_records.tables.csv_names import is_electrical, is_reading, looks_like_unit, plain_unit, unit_of, unit_text
from palpate_records.tables.dialect import Dialect, dialect_of, grouped_or_decimal
from palpate_records.tables.footer import is_event
from palpate_records.tables.plain_numbers import lines_from, plain_numbers, whole_lines
from palpate_records.tables.table_forms import table_form
from palpate_records.tables.table_record import OF_RECORD, TableRecord
from palpate_records.tables.table_rows import rows_below
from palpate_records.tables.table_text import bounded_lines, open_text

KEYS = ("delimiter", "decimal", "thousands", "comment", "encoding", "sheet", "header", "units")  # that can be stated
_DIALECT_KEYS = KEYS[:4]  # fields of a `Dialect`
# Choices.
_BLOCK_ROWS = 4096  # that are read at once
_MAX_NAME, _MAX_NAMES = 40, 12  # characters of a column's name, and columns, that are shown
_MAX_EXAMPLE = 40  # characters of a line that are shown
_MIN_NUMBERS = 10  # of a column that is chosen for a role
_MIN_PADDED_CELLS = 3  # such as "05", which are more than a coincidence
_DIALECT_ROWS = 100  # by which a mark between digits is judged
_COMMA_ROWS = 5  # by which a decimal comma is found
_UNIT_WITH_SIZE = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)?\s*(\D.*?)\s*")  # "mN", "10 N"
_PADDED = re.compile(r"0\d+")  # digits behind a decimal comma, which are not a number by themselves


@dataclass(frozen=True)
class Sheet:
    """A table in a file: its dialect, layout and names, by which its numbers are read."""

    path: Path
    names: tuple[str, ...]  # of the header, else "0", "1", ...
    dialect: Dialect = field(default_factory=Dialect)
    layout: TableLayout = field(default_factory=lambda: TableLayout(0, 0))
    stated: Mapping[str, str | int] = field(default_factory=dict)  # keys of the device that the user gave
    own_units: Mapping[str, str] = field(default_factory=dict)  # that a person states, by column: "mN", "10 N" for one
    record: TableRecord | None = None  # that is read of a file of several
    pages: int = 1  # tables under each other through which the only record of the file goes on
    footer: list[list[str]] = field(default_factory=list, compare=False)  # cells below the rows, after these are read
    events: list[str] = field(default_factory=list, compare=False)  # lines of words between rows, after these are read

    @classmethod
    def of(cls, path: Path, stated: Mapping[str, str] | None = None, record: TableRecord | None = None) -> Sheet:
        """Return the table by its first lines, with keys as `stated`; raises LogError without a table of numbers.

        A record states its own sheet and line of names.
        """
        # Keys that the record or a person states; all others are found in the first lines.
        record_keys = {} if record is None else {key: getattr(record, key) for key in OF_RECORD}
        texts = {**(stated or {}), **{key: str(value) for key, value in record_keys.items() if value}}
        keys = {key: _parse_key(path, key, text) for key, text in texts.items()}
        with open_text(path, _text_of_key(keys, "encoding"), _text_of_key(keys, "sheet")) as file:
            lines = first_lines(file, path, int(keys.get("header", 0)))
        if not any(line.strip() for line in lines):
            raise LogError(f"{path}: the file is empty")
        dialect, layout = table_form(
            lines, tuple(sorted(keys.items())), partial(_dialect_and_layout, path, lines, keys)
        )
        layout = layout if record is None else record.layout(layout)
        names = layout.names or tuple(map(str, range(layout.width)))
        return cls(path, names, dialect, layout, stated=keys, record=record)

    @property
    def header(self) -> bool:
        """True if its columns have names."""
        return self.layout.names is not None

    @property
    def facts(self) -> tuple[StatedValue, ...]:
        """Values about the experiment above the numbers."""
        return self.layout.facts

    @property
    def settings(self) -> dict[str, str | int]:
        """The keys of a device that reads the table, without those of the usual dialect."""
        usual = Dialect()
        keys: dict[str, str | int] = {}
        for key in _DIALECT_KEYS:
            if getattr(self.dialect, key) != getattr(usual, key):
                keys[key] = getattr(self.dialect, key)
        if self.record is None:
            return keys | dict(self.stated)
        stated = {key: text for key, text in self.stated.items() if key not in OF_RECORD}
        return keys | stated | {"record": self.record.name}

    @property
    def text_keys(self) -> tuple[str | None, str | None]:
        """Encoding and sheet; None for one that is not stated."""
        return _text_of_key(self.stated, "encoding"), _text_of_key(self.stated, "sheet")

    def blocks(self) -> Iterator[Floats]:
        """Yield the numbers (n, k), some thousand rows at a time; NaN for any other cell, seconds for times of day."""
        self.footer.clear()
        self.events.clear()
        row_count = 0
        is_plain = self.record is None and not self.layout.clocks
        with open_text(self.path, *self.text_keys) as file:
            for _ in islice(bounded_lines(file, self.path), self.layout.begin):
                pass
            for text in whole_lines(file):
                numbers = plain_numbers(text, self.dialect, len(self.names)) if is_plain else None
                if numbers is None:  # from the first cell that is not a plain number on, line by line
                    yield from self._blocks_by_line(lines_from(text, file, self.path), row_count)
                    break
                row_count += len(numbers)
                yield numbers

    def _blocks_by_line(self, lines: Iterator[str], rows_above: int) -> Iterator[Floats]:
        """Yield the numbers (n, k) of lines that may hold anything, below a number of rows that were read already.

        Cells are read one by one; lines below the table are added to its footer, lines of words between its rows to its
        events.
        """
        count = len(self.names)
        readers = [seconds_or_nan if k in self.layout.clocks else self._cell_reader(k) for k in range(count)]
        days = {k: Days() for k in self.layout.clocks if k < count}
        rows = rows_below(
            above=rows_above,
            lines=lines,
            layout=self.layout,
            dialect=self.dialect,
            record=self.record,
            pages=self._page_count,
            footer=self.footer,
        )
        while part := list(islice(rows, _BLOCK_ROWS)):
            self.events.extend(cells[0] for _, cells in part if is_event(cells, count, self.dialect))
            block = np.full((len(part), count), np.nan)
            for i, (_, cells) in enumerate(part):
                block[i, : len(cells)] = [read(cell) for read, cell in zip(readers, cells[:count])]
            # Times of day grow past midnight, from block to block.
            for k, day in days.items():
                block[:, k] = day.unwrapped(block[:, k])
            yield block[[bool(cells) for _, cells in part]]

    def _page_count(self) -> int:
        """Return the number of pages of the table or record; 0 if nothing is known of tables below it."""
        pages = self.pages if self.record is None else self.record.pages
        return 0 if pages == 1 and not self.stated.get("header") else pages

    def _cell_reader(self, column: int) -> Callable[[str], float]:
        """Return the function from a cell of a column to its number, NaN for any other cell."""
        read_number = partial(number_or_nan, decimal=self.dialect.decimal, thousands=self.dialect.thousands)
        column_unit = self._file_unit(column)
        if column_unit is None or not self.layout.cell_units[column : column + 1] or not self.layout.cell_units[column]:
            return read_number

        def read_with_unit(cell: str) -> float:
            """Return the number of a cell in the unit of its column."""
            text, unit = number_and_unit(cell.strip())
            with suppress(ValueError):
                return read_number(text) * (cell_factor(unit, column_unit) if unit else 1.0)
            return float("nan")

        return read_with_unit

    def unit(self, column: int) -> str | None:
        """Return the unit that the name of a column, the row of units, or else a person states; None for none.

        A load in grams is in gf.
        """
        return self._stated_unit(column)[1] if self._has_stated_unit(column) else self._file_unit(column)

    def _file_unit(self, column: int) -> str | None:
        """Return the unit of a column by the row of units, its name, or the cells; None without one."""
        row_unit = self.layout.units[column] if column < len(self.layout.units) else ""
        cell_unit = self.layout.cell_units[column] if column < len(self.layout.cell_units) else ""
        unit = unit_of(self.names[column], row_unit)
        return unit or (unit_of(self.names[column], cell_unit) if cell_unit else None)

    def _has_stated_unit(self, column: int) -> bool:
        """Return True if the unit of a column is that which a person states, since the file does not."""
        if self.names[column] not in self.own_units:
            return False
        return self._file_unit(column) is None or is_electrical(self.written_unit(column))

    def scale(self, column: int) -> float:
        """Return the size of one number of a column in its unit."""
        return self._stated_unit(column)[0] if self._has_stated_unit(column) else 1.0

    def _stated_unit(self, column: int) -> tuple[float, str]:
        """Return number and unit that a person states for one of a column, as 10, "N"; raises LogError for others."""
        text = self.own_units[self.names[column]]
        match = _UNIT_WITH_SIZE.fullmatch(text)
        try:
            if match is None or not si_unit(match[2]):
                raise ValueError(text)
            return float(match[1] or 1.0), match[2]
        except ValueError as error:
            name = column_text(self.column(column))
            raise LogError(
                f'{self.path}: unit of column {name}: {text!r} is not a unit; write "mN", or "10 N" for one'
            ) from error

    def written_unit(self, column: int) -> str:
        """Return the text in the place of a column's unit, whether it is a unit or not."""
        row_unit = self.layout.units[column] if column < len(self.layout.units) else ""
        return row_unit or plain_unit(unit_text(self.names[column]))

    def needs_scale(self, column: int) -> bool:
        """Return True if a column is in volts, counts or an unknown unit, whose scale only a person knows."""
        if self._has_stated_unit(column):
            return False
        unit_as_written = self.written_unit(column)
        name = self.names[column]
        if is_electrical(unit_as_written):
            return True
        return self.unit(column) is None and (looks_like_unit(unit_as_written, name) or is_reading(name))

    def column(self, index: int) -> int | str:
        """Return the name by which a pipeline refers to a column; its number if it has none of its own."""
        return self.names[index] if self.header and self.names.count(self.names[index]) == 1 else index

    @property
    def columns(self) -> str:
        """The names of the columns, not more than a line can hold."""
        names = [column_text(name) for name in self.names[:_MAX_NAMES]]
        return ", ".join(names) + (", ..." if len(self.names) > _MAX_NAMES else "")

    def index_of(self, role: str, choice: str) -> int:
        """Return the column that a choice names, by the header or by its number; raises LogError if it is missing."""
        if choice in self.names:
            return self.names.index(choice)
        if choice.isdigit() and int(choice) < len(self.names):
            return int(choice)
        raise LogError(f"{self.path}: --{role}: no column {choice!r} (there are: {self.columns})")

    def demand_numbers(self, role: str, column: int, values: Floats) -> None:
        """Raise LogError if the values (n,) of a column that was chosen for a role hardly contain a number."""
        count = int(np.isfinite(values).sum())
        if count >= min(_MIN_NUMBERS, len(values)):
            return
        text = self._first_text(column)
        contents = f"text ({printable(text)[:_MAX_NAME]!r})" if text else "empty cells"
        contents = f"{contents} and {count} numbers" if count else f"{contents}, no numbers"
        name = column_text(self.column(column))
        raise LogError(f"{self.path}: --{role}: column {name} contains {contents} (there are: {self.columns})")

    def _first_text(self, column: int) -> str | None:
        """Return the first cell of a column that is not empty and not a number; None without one."""
        with open_text(self.path, *self.text_keys) as file:
            lines = islice(bounded_lines(file, self.path), self.layout.begin, None)
            rows = enumerate(self.dialect.rows(lines))
            rows_of_table = rows if self.record is None else self.record.rows(rows)
            cells = (row[column].strip() for _, row in rows_of_table if column < len(row))
            return next((cell for cell in cells if cell and np.isnan(number_or_nan(cell, self.dialect.decimal))), None)


def column_text(column: int | str) -> str:
    """Return the name or the number of a column, cut and without control characters."""
    return printable(str(column))[:_MAX_NAME]


def together(blocks: Iterator[Floats], limit: int) -> Floats:
    """Return the first rows of a table, up to a limit."""
    first_blocks: list[Floats] = []
    for block in blocks:
        first_blocks.append(block)
        if sum(map(len, first_blocks)) >= limit:
            break
    return np.concatenate(first_blocks)[:limit]


def _parse_key(path: Path, key: str, text: str) -> str | int:
    """Return the value of a stated key; raises LogError for one that is not allowed."""
    text = text.replace("\\t", "\t") if key == "delimiter" else text
    conditions = {
        "header": ("a line, counted from 1, or 0", text.isdigit()),
        "units": ("a line, counted from 1, or 0", text.isdigit()),
        "delimiter": ("one character", len(text) == 1),
        "decimal": ('"." or ","', text in (".", ",")),
        "thousands": ("one character or none", len(text) < 2),
    }
    expected, is_allowed = conditions.get(key, ("", True))
    if not is_allowed:
        raise LogError(f"{path}: {key} = {text!r}: expected {expected}")
    return int(text) if key in ("header", "units") else text


def _dialect_and_layout(path: Path, lines: list[str], keys: Mapping[str, str | int]) -> tuple[Dialect, TableLayout]:
    """Return the dialect and layout of a table by its first lines and the stated keys; raises LogError."""
    dialect = Dialect("\t") if is_binary_table(path) else dialect_of(lines)
    dialect = replace(dialect, **{key: str(keys[key]) for key in _DIALECT_KEYS if key in keys})
    layout = layout_of(path, lines, dialect, *(keys.get(key) for key in ("header", "units")))  # type: ignore[arg-type]
    rows = [row for row in islice(dialect.rows(lines[layout.begin :]), _DIALECT_ROWS) if row]
    if "decimal" not in keys:
        _refuse_decimal_commas(path, lines, dialect, layout, rows)
    if "decimal" not in keys and "thousands" not in keys:
        dialect = _with_thousands(path, dialect, rows, layout)
    return dialect, layout


def _text_of_key(keys: Mapping[str, str | int], key: str) -> str | None:
    """Return the text of a key; None for one that is not stated."""
    return str(keys[key]) if key in keys else None


def _refuse_decimal_commas(
    path: Path, lines: list[str], dialect: Dialect, layout: TableLayout, rows: list[list[str]]
) -> None:
    """Raise LogError for numbers with decimal commas: between commas they are lost, else a key states them.

    `rows` are the cells of the first lines of numbers by the `dialect`, which is how the text is written, as far as
    that was found.
    """
    last_line = lines[-1].strip()[:_MAX_EXAMPLE]
    advice = "write the numbers with points, or another separator"
    if rows and all(is_cut_at_commas(row, layout.names, dialect.delimiter) for row in rows):
        raise LogError(f"{path}: its numbers have decimal commas ({last_line!r}) between commas: {advice}")
    has_points = any("." in cell for row in rows for cell in row)
    if dialect.delimiter == "," and not has_points:
        padded_count = sum(_PADDED.fullmatch(cell.strip()) is not None for row in rows for cell in row)
        if padded_count >= _MIN_PADDED_CELLS:
            example = ",".join(rows[-1])[:_MAX_EXAMPLE]
            raise LogError(f"{path}: its numbers seem to have decimal commas ({example!r}) between commas: {advice}")
    if dialect.decimal == "." and any(has_decimal_comma(cell) for row in rows[:_COMMA_ROWS] for cell in row):
        raise LogError(f"{path}: its numbers have decimal commas ({last_line!r}): {POINTS}")


def _with_thousands(path: Path, dialect: Dialect, rows: list[list[str]], layout: TableLayout) -> Dialect:
    """Return the dialect with its mark of thousands, if ``1,234`` has one; raises LogError if neither is certain."""
    if dialect.thousands:
        return dialect
    columns = [[row[k] for row in rows if k < len(row)] for k in range(layout.width) if k not in layout.clocks]
    meaning = grouped_or_decimal(columns, dialect)
    if meaning == "thousands":
        return replace(dialect, decimal="," if dialect.decimal == "." else ".", thousands=dialect.decimal)
    if meaning is None:
        example = next(cell for cells in columns for cell in cells if "," in cell)
        raise LogError(
            f'{path}: {example!r} can be one and a fraction or a thousand: state decimal = "," or thousands = ","'
        )
    return dialect
