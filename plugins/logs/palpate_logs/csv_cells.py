"""Cells of a CSV log: their numbers, and decimal commas, which it must not have."""

from __future__ import annotations

from collections.abc import Sequence

from palpate import is_number

POINTS = "write the numbers with points"  # the advice where they have commas


def number(cell: str) -> float:
    """The number in a cell; raises ValueError. ``1_5`` is none: Python alone takes it for 15."""
    if "_" in cell:
        raise ValueError(cell)
    return float(cell)


def number_or_nan(cell: str) -> float:
    """The number in a cell; NaN where it is none."""
    try:
        return number(cell)
    except ValueError:
        return float("nan")


def has_decimal_comma(cell: str) -> bool:
    """Whether a cell is a number but for a comma in place of its point.

    >>> has_decimal_comma("1,5"), has_decimal_comma("1.5"), has_decimal_comma("1,5,2")
    (True, False, False)
    """
    return not is_number(cell) and is_number(cell.replace(",", ".", 1))


def is_cut_at_commas(cells: Sequence[str], header: Sequence[str] | None, delimiter: str) -> bool:
    """Whether a line has twice the cells of its header, as one whose decimal commas were taken for separators."""
    return delimiter == "," and header is not None and len(cells) == 2 * len(header)
