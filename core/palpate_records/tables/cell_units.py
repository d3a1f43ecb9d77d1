"""Units in the cells of a table, behind the numbers."""

from __future__ import annotations

import re
from functools import cache

from palpate_records.messages.readings import si_unit
from palpate_records.tables.csv_names import is_unit, plain_unit, weight_of

_WITH_UNIT = re.compile(r"\s*([-+]?[\d.,]*\d[.,]?(?:[eE][-+]?\d+)?)\s*([^\d\s.,+-][^\s]{0,9})\s*")


def number_and_unit(cell: str) -> tuple[str, str]:
    """Return the number of a cell as it is written, and the unit behind it; "" without one.

    >>> number_and_unit("1.2 N"), number_and_unit("-3e-2mm"), number_and_unit("1.5D-03"), number_and_unit("12:30")
    (('1.2', 'N'), ('-3e-2', 'mm'), ('1.5D-03', ''), ('12:30', ''))
    """
    last = cell[-1:]
    if last.isdigit() or not last or (match := _WITH_UNIT.fullmatch(cell)) is None or not is_unit(match[2]):
        return cell, ""
    return match[1], plain_unit(match[2])


@cache
def cell_factor(unit: str, column: str) -> float:
    """Return the size of the unit in a cell relative to that of its column; a mass in a column of forces is its weight.

    Raises ValueError for another dimension.
    """
    cell_dimension, cell_size = si_unit(_force_unit(unit, column))
    column_dimension, column_size = si_unit(column)
    if cell_dimension != column_dimension:
        raise ValueError(f"{unit} is not a unit of a column in {column}")
    return cell_size / column_size


def _force_unit(unit: str, column: str) -> str:
    """Return the weight of a unit of mass if the unit of the column is one of force, else the unit."""
    return (weight_of(unit) or unit) if si_unit(column)[0] == "N" else unit
