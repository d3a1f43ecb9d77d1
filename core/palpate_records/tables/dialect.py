"""The dialect of a table: the marks between columns, of decimals and thousands, and of comments."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from palpate_records.tables.cell_units import number_and_unit
from palpate_records.tables.cells import is_grouped, number
from palpate_records.tables.clock_times import seconds_of_day

MARKS = ("#", "%", "//", ";", "!")  # at the beginning of a line that is a comment
_SEPARATORS = ("\t", ";", ",", " ")
_PROBE_LINES = 15  # the longest and the last ones, among which numbers are likeliest: a choice
_SINGLE_NUMBER_WEIGHT = 0.5  # of a row with one number alone, which may be text with a number: a choice
_SPACES = " \u00a0\u202f"  # spaces between thousands, of any width
_BLANKS = ("", "-", "--", "n/a", "none", "null")
TableRow = tuple[int, list[str]]  # a line, counted from 1, and its cells


@dataclass(frozen=True)
class Dialect:
    """The marks of a table between columns, of decimals and thousands, and of comments."""

    delimiter: str = ","
    decimal: str = "."
    thousands: str = ""
    comment: str = "#"

    def rows(self, lines: Iterable[str]) -> Iterator[list[str]]:
        """Return the cells of lines; several spaces separate as one."""
        if self.delimiter == " ":
            return csv.reader((line.strip() for line in lines), delimiter=" ", skipinitialspace=True)
        return csv.reader(lines, delimiter=self.delimiter)

    def is_number(self, cell: str) -> bool:
        """Return True if a cell is a number."""
        try:
            number(cell, self.decimal, self.thousands)
        except ValueError:
            return False
        return True

    def is_value(self, cell: str) -> bool:
        """Return True if a cell is a number, with or without its unit, or a time of day."""
        if self.is_number(cell):
            return True
        plain, unit = number_and_unit(cell)
        return (bool(unit) and self.is_number(plain)) or is_clock(cell)

    def is_comment(self, line: str) -> bool:
        """Return True if a line is a comment."""
        return bool(self.comment) and line.lstrip().startswith(self.comment)


def is_clock(cell: str) -> bool:
    """Return True if a cell is a time of day, with or without a date."""
    if ":" not in cell:
        return False
    try:
        seconds_of_day(cell)
    except ValueError:
        return False
    return True


def is_blank(cell: str) -> bool:
    """Return True if a cell is empty or holds a mark for nothing."""
    return cell.strip().lower() in _BLANKS


def dialect_of(lines: Sequence[str]) -> Dialect:
    """Return the likeliest dialect of lines: that in which most cells are numbers, and of such the fewest are text."""
    last_half = lines[len(lines) // 2 :]
    probe_lines = [*sorted(last_half, key=len)[-_PROBE_LINES:], *last_half[-_PROBE_LINES:]]
    # Dialects that read these lines alike are compared once.
    candidates: dict[tuple[str, str, str], Dialect] = {}
    for dialect in _dialects(lines):
        candidates.setdefault(_marks_in("".join(probe_lines), dialect), dialect)
    best = max(candidates.values(), key=partial(_score, probe_lines))
    return replace(best, comment=_comment_mark(lines, best))


def _marks_in(text: str, dialect: Dialect) -> tuple[str, str, str]:
    """Return the marks of a dialect that a text holds; in dialects with the same of them it has the same cells."""
    delimiter = dialect.delimiter if dialect.delimiter in text or '"' in text else ""
    decimal = dialect.decimal if "." in text or "," in text else ""
    thousands_marks = _SPACES if dialect.thousands == " " else dialect.thousands
    thousands = dialect.thousands if any(mark in text for mark in thousands_marks) else ""
    return delimiter, decimal, thousands


def _dialects(lines: Sequence[str]) -> Iterator[Dialect]:
    """Yield all dialects, the usual ones first; a mark between columns is in cells only if these are quoted."""
    is_quoted = any('"' in line for line in lines)
    for delimiter in _SEPARATORS:
        yield Dialect(delimiter)
    for delimiter in _SEPARATORS:
        if is_quoted or delimiter != ",":
            yield Dialect(delimiter, ",")
    for delimiter in _SEPARATORS:
        for decimal, marks in ((".", (",", " ", "'")), (",", (".", " ", "'"))):
            for thousands in marks:
                if is_quoted or delimiter not in (thousands, decimal):
                    yield Dialect(delimiter, decimal, thousands)


def _score(lines: Sequence[str], dialect: Dialect) -> tuple[float, float]:
    """Return the numbers in the usual row times the rows with a number, then minus the cells of text in these."""
    number_counts, text_counts = [], []
    for cells in dialect.rows(lines):
        number_count = sum(map(dialect.is_value, cells))
        if number_count:
            number_counts.append(number_count)
            text_counts.append(sum(not is_blank(cell) for cell in cells) - number_count)
    if not number_counts:
        return 0.0, 0.0
    usual_count = float(np.median(number_counts))
    weight = usual_count if usual_count >= 2 else _SINGLE_NUMBER_WEIGHT * usual_count
    return weight * len(number_counts), -float(np.sum(text_counts))


def _comment_mark(lines: Sequence[str], dialect: Dialect) -> str:
    """Return the first mark with which a line begins, "#" without one."""
    begins = {line.lstrip()[:2] for line in lines}
    marks = [mark for mark in MARKS if mark != dialect.delimiter]
    return next((mark for mark in marks if any(begin.startswith(mark) for begin in begins)), "#")


def grouped_or_decimal(columns: Iterable[Sequence[str]], dialect: Dialect) -> str | None:
    """Return the meaning of the mark in numbers such as ``1,234``: "decimal", "thousands", None if neither is certain.

    It is that of thousands in a column whose other numbers are whole and below a thousand. `dialect` is how the text is
    written, with the mark in question as that of decimals.
    """
    mark = dialect.decimal
    cells_with_mark = [cell for cells in columns for cell in cells if mark in cell]
    thousands_decimal = "." if mark == "," else ","
    if not cells_with_mark or not all(is_grouped(cell, thousands_decimal, mark) for cell in cells_with_mark):
        return "decimal"
    for cells in columns:
        plain_numbers = [abs(number(cell)) for cell in cells if mark not in cell and dialect.is_number(cell)]
        if plain_numbers and any(mark in cell for cell in cells):
            is_below_thousand = max(plain_numbers) < 1000 and min(plain_numbers) == int(min(plain_numbers))
            return "thousands" if is_below_thousand else "decimal"
    return None if mark == "," else "decimal"
