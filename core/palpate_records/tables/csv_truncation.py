"""A last number of a table that was cut short."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from palpate_records.tables.binary_tables import is_binary_table

# Choices.
_TAIL_SIZE = 1 << 16  # [bytes] of the end of a file that are looked into
_MIN_LINES = 100  # above the last one: where digits vary, none of them is as short in one table of a hundred
_NUMBER = re.compile(r"[+-]?(\d*)(?:\.(\d*))?(?:[eE][+-]?(\d+))?")


@dataclass(frozen=True)
class _DigitCounts:
    """The numbers of digits of a number: before its point, behind it, and of its exponent."""

    whole: int
    decimals: int
    exponent: int


def cut_number(path: Path, delimiter: str, decimal: str = ".") -> str | None:
    """Return the last number of a file, if its line has no end and all numbers above it have more digits.

    Digits of the exponent, else behind the point, else of whole numbers: of a number that was cut, those that matter
    are the first to go. Tables written by hand often have no last end of line; a file that was packed is whole.
    """
    lines = _unended_lines(path)
    if lines is None:
        return None
    if decimal == ",":
        lines = [line.replace(",", ".") for line in lines]
    *lines_above, last_line = lines
    last_cells = last_line.split(delimiter)
    last_cell = last_cells[-1].strip()
    digits = _digit_counts(last_cell)
    digits_above = list(_digits_above(lines_above, delimiter, width=len(last_cells)))
    if digits is None or len(digits_above) < _MIN_LINES:
        return None
    # A cut exponent changes a number most, then decimals, then digits of a whole number.
    if digits.exponent < min(other.exponent for other in digits_above):
        return last_cell
    if digits.exponent:
        return None
    has_whole_numbers = not any(other.decimals or other.exponent for other in digits_above)
    has_fewer_digits = has_whole_numbers and digits.whole < min(other.whole for other in digits_above)
    has_fewer_decimals = digits.decimals < min(other.decimals for other in digits_above)
    return last_cell if has_fewer_decimals or has_fewer_digits else None


def _unended_lines(path: Path) -> list[str] | None:
    """Return the whole lines at the end of a text, if the last one has no end.

    None for any other file, and for text in UTF-16 or with quotation marks, whose cells are not those between the
    separators.
    """
    if path.suffix.lower() == ".gz" or is_binary_table(path):
        return None
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - 1, 0))
        if file.read() in b"\r\n":
            return None
        file.seek(max(size - _TAIL_SIZE, 0))
        text = file.read().decode(errors="replace")
    if "\0" in text or '"' in text:
        return None
    lines = text.splitlines() or [""]
    has_cut_line = size > _TAIL_SIZE  # the first one, which is left out
    return [*lines[:-1][has_cut_line:], lines[-1]]


def _digits_above(lines: Iterable[str], delimiter: str, width: int) -> Iterator[_DigitCounts]:
    """Yield the digits of the last number in each line with as many cells as the last line."""
    for line in lines:
        cells = line.split(delimiter)
        digits = _digit_counts(cells[-1].strip()) if len(cells) == width else None
        if digits is not None:
            yield digits


def _digit_counts(cell: str) -> _DigitCounts | None:
    """Return the digits of a number; None for any other cell."""
    match = _NUMBER.fullmatch(cell)
    if match is None or not cell:
        return None
    return _DigitCounts(len(match[1]), len(match[2] or ""), len(match[3] or ""))
