"""Units that stand in the cells, behind the numbers."""

from __future__ import annotations

import re
from functools import cache

from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_names import is_unit, plain_unit, weight_of

_WITH_UNIT = re.compile(r"\s*([-+]?[\d.,]*\d[.,]?(?:[eE][-+]?\d+)?)\s*([^\d\s.,+-][^\s]{0,9})\s*")


def number_and_unit(cell: str) -> tuple[str, str]:
    """Return the number of a cell as it is written, and the unit behind it; none without one.

    >>> number_and_unit("1.2 N"), number_and_unit("-3e-2mm"), number_and_unit("1.5D-03"), number_and_unit("12:30")
    (('1.2', 'N'), ('-3e-2', 'mm'), ('1.5D-03', ''), ('12:30', ''))
    """
    last = cell[-1:]
    if last.isdigit() or not last or (match := _WITH_UNIT.fullmatch(cell)) is None or not is_unit(match[2]):
        return cell, ""
    return match[1], plain_unit(match[2])


@cache
def cell_factor(unit: str, column: str) -> float:
    """How many of the unit of its column one of the unit in a cell is; a mass in a column of forces is its weight.

    Raises ValueError for another dimension.
    """
    (dimension, size), (wanted, one) = (si_unit(text) for text in (_weight(unit, column), column))
    if dimension != wanted:
        raise ValueError(f"{unit} is not a unit of a column in {column}")
    return size / one


def _weight(unit: str, column: str) -> str:
    return (weight_of(unit) or unit) if si_unit(column)[0] == "N" else unit
