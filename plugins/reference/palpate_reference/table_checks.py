"""Checks of a table: frequencies that agree, moduli above zero, strains with their unit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from palpate import Floats, LogError

from palpate_reference.instrument_text import InstrumentText
from palpate_reference.material_table import TableSettings
from palpate_reference.table_blocks import TableBlock
from palpate_reference.table_columns import TableColumn, place

_FREQUENCY_TOLERANCE = 0.02  # relative, a choice: for two frequencies of one row, beyond the rounding of a table
_DECADE_TOLERANCE = 2e-3  # of log10, a choice: by which a rounded frequency may miss a power of ten
_MIN_DECADES = 2  # rows at powers of ten, a choice: one may be chance
_MAX_STRAIN = 3.0  # that a solid reaches (0270)
_TURN = 2 * math.pi  # [rad]


def demand_same_frequency(
    text: InstrumentText, block: TableBlock, column: TableColumn, x: Floats, other: Floats
) -> None:
    """Raise LogError where frequencies x (n,) [Hz] of a column are not those by another column."""
    ratio = float(np.nanmedian(other / x))
    if not math.isnan(ratio) and abs(ratio - 1.0) > _FREQUENCY_TOLERANCE:
        hint = " (2 pi: rad/s was taken for Hz, or the other way round)" if _is_turn(ratio) else ""
        raise LogError(
            f"{place(text, block, column)}: the frequency is {ratio:.4g} times that which the angular frequency or the "
            f'complex viscosity next to it states{hint}; state its unit with --unit "{column.name}=..."'
        )


def _is_turn(ratio: float) -> bool:
    """Return True if a ratio is 2 pi, or its inverse."""
    return min(abs(ratio * 2 * math.pi - 1), abs(ratio / _TURN - 1)) < _FREQUENCY_TOLERANCE


def ask_for_radians(text: InstrumentText, block: TableBlock, column: TableColumn, x: Floats) -> None:
    """Raise LogError where frequencies x (n,) in Hz are powers of ten only after a division by 2 pi.

    Such numbers are in rad/s, of round frequencies in Hz.
    """
    positive = x[x > 0]
    is_round = _decade_distance(positive) < _DECADE_TOLERANCE
    is_round_turned = _decade_distance(positive / _TURN) < _DECADE_TOLERANCE
    if is_round_turned.sum() >= _MIN_DECADES and not is_round.any():
        row = int(np.argmin(_decade_distance(x / _TURN)))
        raise LogError(
            f"{place(text, block, column, row)}: {x[row]:.5g} Hz is 2 pi times a power of ten, as are others: are they "
            f'rad/s? State which with --unit "{column.name}=rad/s" or "{column.name}=Hz"'
        )


def _decade_distance(values: Floats) -> Floats:
    """Return the distance (n,) of the decimal logarithm to the nearest whole number."""
    logs = np.log10(values)
    return np.asarray(np.abs(logs - np.rint(logs)))


def demand_positive(
    text: InstrumentText,
    block: TableBlock,
    checked: Sequence[tuple[TableColumn, Floats]],
) -> None:
    """Raise LogError for a modulus, frequency, time or uncertainty that is not above zero, with line and column."""
    for column, values in checked:
        wrong_rows = np.flatnonzero(values <= 0.0)
        if len(wrong_rows):
            first = int(wrong_rows[0])
            raise LogError(
                f"{place(text, block, column, first)}: {values[first]:.4g} is not above zero, as it is for "
                f"every passive material; {len(wrong_rows)} of {len(values)} rows: take them out, or check the export"
            )


def ask_for_per_cent(
    text: InstrumentText, block: TableBlock, column: TableColumn, strain: Floats | None, settings: TableSettings
) -> None:
    """Raise LogError where a strain (n,) without per cent, and without a stated unit, is larger than solids bear."""
    if strain is None or column.unit == "%" or column.name in settings.units:
        return
    largest = float(np.nanmax(np.abs(strain))) if np.isfinite(strain).any() else 0.0
    if largest > _MAX_STRAIN:
        row = int(np.nanargmax(np.abs(strain)))
        raise LogError(
            f"{place(text, block, column, row)}: a strain of {largest:.4g} is {100 * largest:.4g} %: is it in per "
            f'cent? State which with --unit "{column.name}=%" or "{column.name}=1"'
        )
