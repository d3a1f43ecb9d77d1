"""Cells of a table: the numbers and the times of day in them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

from palpate import is_number

POINTS = 'state decimal = ","'  # advice for numbers with decimal commas

_FORTRAN_DOUBLE = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))[dD]([+-]?\d+)")
_OVERLOAD = re.compile(r"\*{2,}|#+|#nv|#n/a|#wert!|#value!|over|ovf|ovld|over ?flow|over ?load|over ?range|ol", re.I)


def is_overload(cell: str) -> bool:
    """Return True if a cell holds the mark of an instrument for a reading beyond its range.

    >>> is_overload("OVER"), is_overload("#NV"), is_overload("***"), is_overload("load")
    (True, True, True, False)
    """
    return _OVERLOAD.fullmatch(cell.strip()) is not None


def number(cell: str, decimal: str = ".", thousands: str = "") -> float:
    """Return the number in a cell; raises ValueError. ``1_5`` is not a number, though Python reads it as 15.

    >>> number("1.234,5", ",", "."), number("1.5D-03")
    (1234.5, 0.0015)
    """
    text = cell.strip()
    if "_" in text:
        raise ValueError(cell)
    if thousands:
        text = text.replace("\u00a0", " ").replace("\u202f", " ")
        if _grouped_pattern(decimal, thousands).fullmatch(text):
            text = text.replace(thousands, "")
    if decimal == ",":
        if "." in text:
            raise ValueError(cell)
        text = text.replace(",", ".", 1)
    try:
        return float(text)
    except ValueError:  # perhaps a double of Fortran, 1.0D-05
        if (match := _FORTRAN_DOUBLE.fullmatch(text)) is None:
            raise
        return float(f"{match[1]}e{match[2]}")


def number_or_nan(cell: str, decimal: str = ".", thousands: str = "") -> float:
    """Return the number in a cell; NaN for any other cell."""
    try:
        return number(cell, decimal, thousands)
    except ValueError:
        return float("nan")


@cache
def _grouped_pattern(decimal: str, thousands: str) -> re.Pattern[str]:
    """Return the pattern of a number with marks between its thousands."""
    return re.compile(rf"[+-]?\d{{1,3}}(?:{re.escape(thousands)}\d{{3}})+(?:{re.escape(decimal)}\d*)?")


def is_grouped(cell: str, decimal: str, thousands: str) -> bool:
    """Return True if a cell can be a number with marks between its thousands.

    >>> is_grouped("1,234", ".", ","), is_grouped("0,234", ".", ","), is_grouped("1,23", ".", ",")
    (True, False, False)
    """
    text = cell.strip().lstrip("+-")
    return not text.startswith("0") and _grouped_pattern(decimal, thousands).fullmatch(text) is not None


def has_decimal_comma(cell: str) -> bool:
    """Return True if a cell is a number but for a comma in place of its point.

    >>> has_decimal_comma("1,5"), has_decimal_comma("1.5"), has_decimal_comma("1,5,2")
    (True, False, False)
    """
    return not is_number(cell) and is_number(cell.replace(",", ".", 1))


def is_cut_at_commas(cells: Sequence[str], header: Sequence[str] | None, delimiter: str) -> bool:
    """Return True if a line has twice the cells of its header: its decimal commas were taken for separators."""
    return delimiter == "," and header is not None and len(cells) == 2 * len(header)
