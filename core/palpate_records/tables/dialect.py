"""How a table is written: what stands between its columns, its decimals and thousands, its comments."""

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
_LOOKED = 15  # lines, the longest and the last, among which numbers are likeliest
_SPACES = " \u00a0\u202f"  # any of which stands between thousands where a space does
_BLANKS = ("", "-", "--", "n/a", "none", "null")
TableRow = tuple[int, list[str]]  # a line, counted from 1, and its cells


@dataclass(frozen=True)
class Dialect:
    """How a table is written."""

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
    """Return True if a cell holds nothing."""
    return cell.strip().lower() in _BLANKS


def dialect_of(lines: Sequence[str]) -> Dialect:
    """Return the likeliest dialect of lines: that in which most of their cells are numbers, and fewest are text."""
    late = lines[len(lines) // 2 :]
    likeliest = [*sorted(late, key=len)[-_LOOKED:], *late[-_LOOKED:]]
    different: dict[tuple[str, str, str], Dialect] = {}
    for dialect in _dialects(lines):
        different.setdefault(_marks_in("".join(likeliest), dialect), dialect)
    best = max(different.values(), key=partial(_score, likeliest))
    return replace(best, comment=_comment(lines, best))


def _marks_in(text: str, dialect: Dialect) -> tuple[str, str, str]:
    """Return the marks of a dialect that a text holds: it has the same cells in all dialects with the same of them."""
    delimiter = dialect.delimiter if dialect.delimiter in text or '"' in text else ""
    decimal = dialect.decimal if "." in text or "," in text else ""
    alike = _SPACES if dialect.thousands == " " else dialect.thousands
    return delimiter, decimal, dialect.thousands if any(mark in text for mark in alike) else ""


def _dialects(lines: Sequence[str]) -> Iterator[Dialect]:
    quoted = any('"' in line for line in lines)
    for delimiter in _SEPARATORS:
        yield Dialect(delimiter)
    for delimiter in _SEPARATORS if quoted else [s for s in _SEPARATORS if s != ","]:
        yield Dialect(delimiter, ",")
    for delimiter in _SEPARATORS:
        for decimal, marks in ((".", (",", " ", "'")), (",", (".", " ", "'"))):
            allowed = (mark for mark in marks if quoted or delimiter not in (mark, decimal))
            yield from (Dialect(delimiter, decimal, mark) for mark in allowed)


def _score(lines: Sequence[str], dialect: Dialect) -> tuple[float, float]:
    """Numbers and text in the usual row, over the rows."""
    numbers, texts = [], []
    for cells in dialect.rows(lines):
        values = sum(map(dialect.is_value, cells))
        if values:
            numbers.append(values)
            texts.append(sum(not is_blank(cell) for cell in cells) - values)
    if not numbers:
        return 0.0, 0.0
    usual = float(np.median(numbers))
    return (usual if usual >= 2 else 0.5 * usual) * len(numbers), -float(np.sum(texts))


def _comment(lines: Sequence[str], dialect: Dialect) -> str:
    begins = {line.lstrip()[:2] for line in lines}
    marks = [mark for mark in MARKS if mark != dialect.delimiter]
    return next((mark for mark in marks if any(begin.startswith(mark) for begin in begins)), "#")


def grouped_or_decimal(columns: Iterable[Sequence[str]], dialect: Dialect) -> str | None:
    """What the mark in numbers such as ``1,234`` is: "decimal", "thousands", None where neither is certain."""
    mark = dialect.decimal
    with_mark = [cell for cells in columns for cell in cells if mark in cell]
    if not with_mark or not all(is_grouped(cell, "." if mark == "," else ",", mark) for cell in with_mark):
        return "decimal"
    for cells in columns:
        plain = [abs(number(cell)) for cell in cells if mark not in cell and dialect.is_number(cell)]
        if any(mark in cell for cell in cells) and plain:
            return "thousands" if max(plain) < 1000 and min(plain) == int(min(plain)) else "decimal"
    return None if mark == "," else "decimal"
