"""What a table must state and must not hold: frequencies that agree, moduli above zero, strains with their unit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from palpate import Floats, LogError

from palpate_reference.instrument_text import InstrumentText
from palpate_reference.material_table import TableSettings
from palpate_reference.table_blocks import TableBlock
from palpate_reference.table_columns import TableColumn, place

_SAME = 0.02  # relative difference of two frequencies of one row
_DECADE = 2e-3  # by which a frequency may miss a power of ten
_STRAINED = 3.0  # a strain that a solid does not reach


def demand_same_frequency(
    text: InstrumentText, block: TableBlock, column: TableColumn, x: Floats, other: Floats
) -> None:
    """Raise LogError where frequencies are not those that another column has."""
    ratio = float(np.nanmedian(other / x))
    if not math.isnan(ratio) and abs(ratio - 1.0) > _SAME:
        hint = " (2 pi: rad/s was taken for Hz, or the other way round)" if _is_turn(ratio) else ""
        raise LogError(
            f"{place(text, block, column)}: the frequency is {ratio:.4g} times that which the angular frequency or the "
            f'complex viscosity next to it states{hint}; state its unit with --unit "{column.name}=..."'
        )


def _is_turn(ratio: float) -> bool:
    return min(abs(ratio * 2 * math.pi - 1), abs(ratio / (2 * math.pi) - 1)) < _SAME


def ask_for_radians(text: InstrumentText, block: TableBlock, column: TableColumn, x: Floats) -> None:
    """Raise LogError where frequencies in Hz are those of rad/s in round Hz, or Hz that are round in rad/s."""

    def decades(values: Floats) -> int:
        logs = np.log10(values[values > 0])
        return int((np.abs(logs - np.rint(logs)) < _DECADE).sum())

    if decades(x / (2 * math.pi)) >= 2 and not decades(x):
        row = int(np.argmin(np.abs(np.log10(x / (2 * math.pi)) - np.rint(np.log10(x / (2 * math.pi))))))
        raise LogError(
            f"{place(text, block, column, row)}: {x[row]:.5g} Hz is 2 pi times a power of ten, as are others: are they "
            f'rad/s? State which with --unit "{column.name}=rad/s" or "{column.name}=Hz"'
        )


def demand_positive(
    text: InstrumentText,
    block: TableBlock,
    checked: Sequence[tuple[TableColumn, Floats]],
) -> None:
    """Raise LogError for a modulus, frequency, time or uncertainty that is not above zero, with line and column."""
    for column, values in checked:
        wrong = np.flatnonzero(values <= 0.0)
        if len(wrong):
            raise LogError(
                f"{place(text, block, column, int(wrong[0]))}: {values[wrong[0]]:.4g} is not above zero, as it is for "
                f"every passive material; {len(wrong)} of {len(values)} rows: take them out, or check the export"
            )


def ask_for_per_cent(
    text: InstrumentText, block: TableBlock, column: TableColumn, strain: Floats | None, settings: TableSettings
) -> None:
    """Raise LogError where a strain without per cent is larger than solids bear."""
    if strain is None or column.unit == "%" or column.name in settings.units:
        return
    largest = float(np.nanmax(np.abs(strain))) if np.isfinite(strain).any() else 0.0
    if largest > _STRAINED:
        row = int(np.nanargmax(np.abs(strain)))
        raise LogError(
            f"{place(text, block, column, row)}: a strain of {largest:.4g} is {100 * largest:.4g} %: is it in per "
            f'cent? State which with --unit "{column.name}=%" or "{column.name}=1"'
        )
