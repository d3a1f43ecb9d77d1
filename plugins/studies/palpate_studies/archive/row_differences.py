"""How two tables of fits differ: each number by how many of its standard uncertainties."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from palpate import is_number
from palpate_kit.curves.curve_fits import Row

_NO_CELLS = ("curve", "track", "settings")


@dataclass(frozen=True)
class RowDifference:
    """A cell that is another one."""

    curve: str
    track: str
    column: str
    packed: str
    found: str
    in_u: float | None = None  # of a number: by how many of its combined uncertainties; None where that is not known


def row_differences(packed: Iterable[Row], found: Iterable[Row]) -> Iterator[RowDifference]:
    """Yield the cells of rows of one curve and track that are not the same text."""
    before, after = ({(row["curve"], row["track"]): row for row in rows} for rows in (packed, found))
    for curve, track in {**before, **after}:
        old, new = before.get((curve, track)), after.get((curve, track))
        if old is None or new is None:
            yield RowDifference(
                curve, track, "row", "none" if old is None else "there", "none" if new is None else "there"
            )
            continue
        for column in {**old, **new}:
            one, other = old.get(column, ""), new.get(column, "")
            if column not in _NO_CELLS and one != other:
                yield RowDifference(curve, track, column, one, other, _in_u(old, column, one, other))


def _in_u(row: Mapping[str, str], column: str, one: str, other: str) -> float | None:
    """Return the difference of two numbers in the combined uncertainty of the value that the column belongs to."""
    name = column.removesuffix("_combined").removesuffix("_std")
    u = row.get(f"{name}_combined", "")
    if not (is_number(one) and is_number(other) and is_number(u) and float(u)):
        return None
    apart = abs(float(other) - float(one)) / abs(float(u))
    return apart if math.isfinite(apart) else None
