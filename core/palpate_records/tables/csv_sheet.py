"""A table without a description: how it is written, its names, its numbers, and the units of its columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice
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
_BLOCK = 4096  # rows at once
_NAME, _NAMED = 40, 12  # characters of a column's name, and columns, that are shown
_OWN_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)?\s*(\D.*?)\s*")
_PADDED = re.compile(r"0\d+")  # what is behind a comma, and no number of its own
_LEAST = 10  # numbers of a column that is to be something
_SURE = 3  # such cells that are not a coincidence
_TWICE = 100  # rows by which a mark between digits is judged


@dataclass(frozen=True)
class Sheet:
    """How a file is written."""

    path: Path
    names: tuple[str, ...]  # of the header, or "0", "1", ...
    dialect: Dialect = field(default_factory=Dialect)
    layout: TableLayout = field(default_factory=lambda: TableLayout(0, 0))
    stated: Mapping[str, str | int] = field(default_factory=dict)  # keys of the device that the user gave
    own_units: Mapping[str, str] = field(default_factory=dict)  # that a person states, by column: "mN", "10 N" for one
    record: TableRecord | None = None  # of a file of several, the one that is read
    pages: int = 1  # tables under each other through which the only record of the file goes on
    footer: list[list[str]] = field(default_factory=list, compare=False)  # cells below the rows, once these are read
    events: list[str] = field(default_factory=list, compare=False)  # lines of words between them, the same

    @classmethod
    def of(cls, path: Path, stated: Mapping[str, str] | None = None, record: TableRecord | None = None) -> Sheet:
        """Found from the first lines, but for what is stated; raises LogError where they are not a table of numbers."""
        own = {} if record is None else {key: str(value) for key in OF_RECORD if (value := getattr(record, key))}
        given = {key: _checked(path, key, text) for key, text in ({**(stated or {}), **own}).items()}
        with open_text(path, _text(given, "encoding"), _text(given, "sheet")) as file:
            lines = first_lines(file, path, int(given.get("header", 0)))
        if not any(line.strip() for line in lines):
            raise LogError(f"{path}: the file is empty")
        stated_keys = tuple(sorted(given.items()))
        dialect, layout = table_form(lines, stated_keys, partial(_dialect_and_layout, path, lines, given))
        layout = layout if record is None else record.layout(layout)
        return cls(path, layout.names or tuple(map(str, range(layout.width))), dialect, layout, given, record=record)

    @property
    def header(self) -> bool:
        """True if its columns have names."""
        return self.layout.names is not None

    @property
    def facts(self) -> tuple[StatedValue, ...]:
        """What it states above its numbers."""
        return self.layout.facts

    @property
    def settings(self) -> dict[str, str | int]:
        """The keys of a device that reads it, where they are not the usual ones."""
        usual, mine = Dialect(), self.dialect
        keys: dict[str, str | int] = {
            key: getattr(mine, key) for key in KEYS[:4] if getattr(mine, key) != getattr(usual, key)
        }
        if self.record is None:
            return keys | dict(self.stated)
        return (
            keys
            | {key: text for key, text in self.stated.items() if key not in OF_RECORD}
            | {"record": self.record.name}
        )

    @property
    def text_keys(self) -> tuple[str | None, str | None]:
        """Encoding and sheet, where they are stated."""
        return _text(self.stated, "encoding"), _text(self.stated, "sheet")

    def blocks(self) -> Iterator[Floats]:
        """Yield the numbers (n, k), some thousand rows at a time; NaN for any other cell, seconds for times of day."""
        self.footer.clear()
        self.events.clear()
        above = 0
        is_plain = self.record is None and not self.layout.clocks
        with open_text(self.path, *self.text_keys) as file:
            for _ in islice(bounded_lines(file, self.path), self.layout.begin):
                pass
            for text in whole_lines(file):
                numbers = plain_numbers(text, self.dialect, len(self.names)) if is_plain else None
                if numbers is None:  # anything else than plain numbers is read line by line from there on
                    yield from self._by_line(lines_from(text, file, self.path), above)
                    break
                above += len(numbers)
                yield numbers

    def _by_line(self, lines: Iterator[str], above: int) -> Iterator[Floats]:
        """Yield the numbers (n, k) of lines that may hold anything; so many rows were read above them."""
        count = len(self.names)
        readers = [seconds_or_nan if k in self.layout.clocks else self._reader(k) for k in range(count)]
        days = {k: Days() for k in self.layout.clocks if k < count}
        pages = self.pages if self.record is None else self.record.pages
        if not self.stated.get("header") and pages == 1:
            pages = 0  # nothing is known of tables below it
        rows = rows_below(above, lines, self.layout, self.dialect, self.record, lambda: pages, self.footer)
        while part := list(islice(rows, _BLOCK)):
            self.events.extend(cells[0] for _, cells in part if is_event(cells, count, self.dialect))
            block = np.full((len(part), count), np.nan)
            for i, (_, cells) in enumerate(part):
                block[i, : len(cells)] = [read(cell) for read, cell in zip(readers, cells[:count])]
            for k, day in days.items():
                block[:, k] = day.unwrapped(block[:, k])
            yield block[[bool(cells) for _, cells in part]]

    def _reader(self, column: int) -> Callable[[str], float]:
        """What makes a number of the cells of a column, NaN where they are not numbers."""
        plain = partial(number_or_nan, decimal=self.dialect.decimal, thousands=self.dialect.thousands)
        usual = self._unit_there(column)
        if usual is None or not self.layout.cell_units[column : column + 1] or not self.layout.cell_units[column]:
            return plain

        def read(cell: str) -> float:
            text, unit = number_and_unit(cell.strip())
            with suppress(ValueError):
                return plain(text) * (cell_factor(unit, usual) if unit else 1.0)
            return float("nan")

        return read

    def unit(self, column: int) -> str | None:
        """Return the unit that the name of a column, the row of units, or else a person states; None for none.

        A load in grams is in gf.
        """
        return self._own_unit(column)[1] if self._is_own(column) else self._unit_there(column)

    def _unit_there(self, column: int) -> str | None:
        below = self.layout.units[column] if column < len(self.layout.units) else ""
        own = self.layout.cell_units[column] if column < len(self.layout.cell_units) else ""
        return unit_of(self.names[column], below) or (unit_of(self.names[column], own) if own else None)

    def _is_own(self, column: int) -> bool:
        """Return True if the unit of a column is that which a person states, since the file does not."""
        if self.names[column] not in self.own_units:
            return False
        return self._unit_there(column) is None or is_electrical(self.written_unit(column))

    def scale(self, column: int) -> float:
        """Return how many of its unit one number of a column is."""
        return self._own_unit(column)[0] if self._is_own(column) else 1.0

    def _own_unit(self, column: int) -> tuple[float, str]:
        """Return how many of which unit a person has stated one to be; raises LogError for anything else."""
        text = self.own_units[self.names[column]]
        match = _OWN_UNIT.fullmatch(text)
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
        """What is written as the unit of a column, whether it is one or not."""
        below = self.layout.units[column] if column < len(self.layout.units) else ""
        return below or plain_unit(unit_text(self.names[column]))

    def needs_scale(self, column: int) -> bool:
        """Return True if a column is in volts, counts or an unknown unit, so that only a person knows how much one
        is."""
        if self._is_own(column):
            return False
        written, name = self.written_unit(column), self.names[column]
        unstated = self.unit(column) is None
        return is_electrical(written) or (unstated and (looks_like_unit(written, name) or is_reading(name)))

    def column(self, index: int) -> int | str:
        """How a pipeline names a column: by the header where that is clear, else by its number."""
        return self.names[index] if self.header and self.names.count(self.names[index]) == 1 else index

    @property
    def columns(self) -> str:
        """The columns that there are, not more than a line can hold."""
        names = [column_text(name) for name in self.names[:_NAMED]]
        return ", ".join(names) + (", ..." if len(self.names) > _NAMED else "")

    def index_of(self, role: str, choice: str) -> int:
        """Return the column that a choice names, by the header or by its number; raises LogError if it is missing."""
        if choice in self.names:
            return self.names.index(choice)
        if choice.isdigit() and int(choice) < len(self.names):
            return int(choice)
        raise LogError(f"{self.path}: --{role}: no column {choice!r} (there are: {self.columns})")

    def demand_numbers(self, role: str, column: int, values: Floats) -> None:
        """Raise LogError where a column (n,) that was chosen for a role contains hardly a number."""
        count = int(np.isfinite(values).sum())
        if count >= min(_LEAST, len(values)):
            return
        name = column_text(self.column(column))
        with open_text(self.path, *self.text_keys) as file:
            lines = islice(bounded_lines(file, self.path), self.layout.begin, None)
            rows = enumerate(self.dialect.rows(lines))
            mine = rows if self.record is None else self.record.rows(rows)
            cells = (row[column].strip() for _, row in mine if column < len(row))
            text = next((cell for cell in cells if cell and np.isnan(number_or_nan(cell, self.dialect.decimal))), None)
        found = f"text ({printable(text)[:_NAME]!r})" if text else "empty cells"
        found = f"{found} and {count} numbers" if count else f"{found}, no numbers"
        raise LogError(f"{self.path}: --{role}: column {name} contains {found} (there are: {self.columns})")


def column_text(column: int | str) -> str:
    """Return the name or the number of a column, cut and without what a terminal would obey."""
    return printable(str(column))[:_NAME]


def together(blocks: Iterator[Floats], limit: int) -> Floats:
    """Return the first rows of a table, up to a limit."""
    kept: list[Floats] = []
    for block in chain(blocks):
        kept.append(block)
        if sum(map(len, kept)) >= limit:
            break
    return np.concatenate(kept)[:limit]


def _checked(path: Path, key: str, text: str) -> str | int:
    """What a person states of a file; raises LogError where it cannot be that."""
    text = text.replace("\\t", "\t") if key == "delimiter" else text
    wanted = {
        "header": ("a line, counted from 1, or 0", text.isdigit()),
        "units": ("a line, counted from 1, or 0", text.isdigit()),
        "delimiter": ("one character", len(text) == 1),
        "decimal": ('"." or ","', text in (".", ",")),
        "thousands": ("one character or none", len(text) < 2),
    }
    words, right = wanted.get(key, ("", True))
    if not right:
        raise LogError(f"{path}: {key} = {text!r}: expected {words}")
    return int(text) if key in ("header", "units") else text


def _dialect_and_layout(path: Path, lines: list[str], given: Mapping[str, str | int]) -> tuple[Dialect, TableLayout]:
    """Return the dialect and layout of a table by its first lines and what is stated; raises LogError."""
    dialect = Dialect("\t") if is_binary_table(path) else dialect_of(lines)
    dialect = replace(dialect, **{key: str(given[key]) for key in KEYS[:4] if key in given})
    layout = layout_of(path, lines, dialect, *(given.get(key) for key in ("header", "units")))  # type: ignore[arg-type]
    rows = [row for row in islice(dialect.rows(lines[layout.begin :]), _TWICE) if row]
    if "decimal" not in given:
        _refuse_decimal_commas(path, lines, dialect, layout, rows)
    if "decimal" not in given and "thousands" not in given:
        dialect = _with_thousands(path, dialect, rows, layout)
    return dialect, layout


def _text(given: Mapping[str, str | int], key: str) -> str | None:
    return str(given[key]) if key in given else None


def _refuse_decimal_commas(
    path: Path, lines: list[str], dialect: Dialect, layout: TableLayout, rows: list[list[str]]
) -> None:
    cut = bool(rows) and all(is_cut_at_commas(row, layout.names, dialect.delimiter) for row in rows)
    advice = "write the numbers with points, or another separator"
    if cut:
        raise LogError(f"{path}: its numbers have decimal commas ({lines[-1].strip()[:40]!r}) between commas: {advice}")
    whole = dialect.delimiter == "," and not any("." in cell for row in rows for cell in row)
    if whole and sum(_PADDED.fullmatch(cell.strip()) is not None for row in rows for cell in row) >= _SURE:
        example = ",".join(rows[-1])[:40]
        raise LogError(f"{path}: its numbers seem to have decimal commas ({example!r}) between commas: {advice}")
    if dialect.decimal == "." and any(has_decimal_comma(cell) for row in rows[:5] for cell in row):
        raise LogError(f"{path}: its numbers have decimal commas ({lines[-1].strip()[:40]!r}): {POINTS}")


def _with_thousands(path: Path, dialect: Dialect, rows: list[list[str]], layout: TableLayout) -> Dialect:
    """Return the dialect, where ``1,234`` may be a fraction or a thousand; raises LogError where neither is certain."""
    columns = [[row[k] for row in rows if k < len(row)] for k in range(layout.width) if k not in layout.clocks]
    if dialect.thousands:
        return dialect
    meaning = grouped_or_decimal(columns, dialect)
    if meaning == "thousands":
        return replace(dialect, decimal="," if dialect.decimal == "." else ".", thousands=dialect.decimal)
    if meaning is None:
        example = next(cell for cells in columns for cell in cells if "," in cell)
        raise LogError(
            f'{path}: {example!r} can be one and a fraction or a thousand: state decimal = "," or thousands = ","'
        )
    return dialect
