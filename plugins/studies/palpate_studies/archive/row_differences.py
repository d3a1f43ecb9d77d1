"""Differences of two tables of fits, those of numbers in their standard uncertainties."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from palpate import is_number
from palpate_kit.curves.curve_fits import Row

_KEYS = ("curve", "track", "settings")  # columns that name a row and its settings, and are not compared


@dataclass(frozen=True)
class RowDifference:
    """A cell that differs between the packed table and one that was made again."""

    curve: str
    track: str
    column: str
    packed: str
    found: str
    in_u: float | None = None  # difference of two numbers over their combined uncertainty; None if that is not known


def row_differences(packed_rows: Iterable[Row], new_rows: Iterable[Row]) -> Iterator[RowDifference]:
    """Yield the cells that are not the same text in two rows of one curve and track."""
    packed_by_key = {(row["curve"], row["track"]): row for row in packed_rows}
    new_by_key = {(row["curve"], row["track"]): row for row in new_rows}
    for curve, track in {**packed_by_key, **new_by_key}:
        packed_row = packed_by_key.get((curve, track))
        new_row = new_by_key.get((curve, track))
        if packed_row is None or new_row is None:
            packed_state = "none" if packed_row is None else "there"
            new_state = "none" if new_row is None else "there"
            yield RowDifference(curve, track, "row", packed_state, new_state)
            continue
        for column in {**packed_row, **new_row}:
            packed_text, new_text = packed_row.get(column, ""), new_row.get(column, "")
            if column not in _KEYS and packed_text != new_text:
                difference = _difference_in_u(packed_row, column, packed_text, new_text)
                yield RowDifference(curve, track, column, packed_text, new_text, difference)


def _difference_in_u(row: Mapping[str, str], column: str, packed_text: str, new_text: str) -> float | None:
    """Return the difference of two numbers over the combined uncertainty of the value that the column belongs to.

    None for texts that are not numbers, and without an uncertainty in the packed row.
    """
    name = column.removesuffix("_combined").removesuffix("_std")
    u_text = row.get(f"{name}_combined", "")
    if not (is_number(packed_text) and is_number(new_text) and is_number(u_text) and float(u_text)):
        return None
    ratio = abs(float(new_text) - float(packed_text)) / abs(float(u_text))
    return ratio if math.isfinite(ratio) else None
