"""The text of an instrument's table: its lines, their cells, and the numbers in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from palpate import LogError
from palpate_records.tables.binary_tables import is_binary_table
from palpate_records.tables.cells import number
from palpate_records.tables.dialect import Dialect, dialect_of
from palpate_records.tables.table_text import bounded_lines, open_text

_MAX_CHARACTERS = 50_000_000  # a choice: a table of an instrument is smaller by far
_MIN_NUMBERS = 2  # in a row: one number alone stands in many texts
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")  # "1,234"


@dataclass(frozen=True)
class TextLine:
    """The cells of one line."""

    number: int  # counted from 1
    cells: tuple[str, ...]

    def cell(self, column: int) -> str:
        """Return a cell; empty where the line ends before it."""
        return self.cells[column] if column < len(self.cells) else ""


@dataclass(frozen=True)
class InstrumentText:
    """All lines of a file, and their dialect: delimiter, decimal and thousands signs."""

    path: Path
    lines: tuple[TextLine, ...]
    dialect: Dialect
    raw: tuple[str, ...] = ()

    @cached_property
    def first_cells(self) -> list[str]:
        """First cell of each line, in small letters."""
        return [line.cell(0).lower() for line in self.lines]

    def is_number(self, cell: str) -> bool:
        """Return True if a cell is a number."""
        return self.dialect.is_number(cell)

    def is_row(self, line: TextLine) -> bool:
        """Return True if a line is one of numbers: two at least, and more of them than of texts."""
        filled = [cell for cell in line.cells if cell]
        number_count = sum(map(self.is_number, filled))
        return number_count >= _MIN_NUMBERS and number_count > len(filled) - number_count

    def number(self, cell: str) -> float:
        """Return the number in a cell; raises ValueError."""
        return number(cell, self.dialect.decimal, self.dialect.thousands)


def read_text(path: Path) -> InstrumentText:
    """Return the lines of a file: text, plain or gzipped, or a workbook.

    Raises LogError where it cannot be read, is empty, or is too large for a table of an instrument.
    """
    raw: list[str] = []
    with open_text(path) as file:
        size = 0
        for line in bounded_lines(file, path):
            raw.append(line.rstrip("\r\n"))
            size += len(line)
            if size > _MAX_CHARACTERS or "\0" in line:
                raise LogError(f"{path}: is not an instrument's table as text: export it from the instrument's program")
    if not any(line.strip() for line in raw):
        raise LogError(f"{path}: is empty")
    dialect = Dialect("\t") if is_binary_table(path) else dialect_of([line for line in raw if line.strip()])
    if dialect.delimiter == " ":
        raw = [line.replace("\t", " ") for line in raw]  # tabs between names above spaces between numbers
    cells = [tuple(cell.strip() for cell in next(dialect.rows([line]), [])) for line in raw]
    lines = tuple(TextLine(number, line_cells) for number, line_cells in enumerate(cells, 1))
    text = InstrumentText(path, lines, dialect, tuple(raw))
    if dialect.decimal == ",":
        _refuse_thousands(text)
    return text


def _refuse_thousands(text: InstrumentText) -> None:
    """Raise LogError where every comma may stand between thousands as well."""
    rows = [line for line in text.lines if text.is_row(line)]
    comma_cells = [(row.number, cell) for row in rows for cell in row.cells if "," in cell]
    if comma_cells and all(_GROUPED.fullmatch(cell) for _, cell in comma_cells):
        number, cell = comma_cells[0]
        raise LogError(
            f"{text.path}:{number}: {cell!r} can be one and a fraction or a thousand: export the table with points"
        )
