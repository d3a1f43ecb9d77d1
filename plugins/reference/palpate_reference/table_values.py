"""The values of a table: moduli or compliances as they stand, or computed from the columns that are there."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_reference.instrument_text import InstrumentText
from palpate_reference.material_table import Kind
from palpate_reference.table_blocks import TableBlock
from palpate_reference.table_columns import TableColumn, si_values

VALUE_ROLES: Mapping[Kind, tuple[str, ...]] = {
    "oscillation": ("storage", "loss"),
    "relaxation": ("modulus",),
    "creep": ("compliance",),
    "stress-strain": ("stress",),
}
_MODULI = (
    ("storage", "loss"),
    ("storage", "loss_factor"),
    ("magnitude", "phase"),
    ("magnitude", "loss_factor"),
    ("storage", "phase"),
)
# Choices: a quantity is held if so many rows are within so much of its median, at least three of them.
_CONSTANT_TOLERANCE = 0.02  # relative
_MIN_CONSTANT_SHARE = 0.8
_MIN_CONSTANT_ROWS = 3


def moduli_among(roles: Collection[str]) -> tuple[str, ...]:
    """Return the two roles that determine storage and loss modulus: both, or one modulus and the angle; else none."""
    return next((pair for pair in _MODULI if {*pair} <= {*roles}), ())


def constant_rows(text: InstrumentText, block: TableBlock, column: TableColumn) -> NDArray[np.bool_]:
    """Return a mask (n,) of the rows in which a held quantity has its value; none unless it is held over most rows."""
    values = si_values(text, block, column)
    median = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    none = np.zeros(len(values), bool)
    is_constant = np.abs(values - median) <= _CONSTANT_TOLERANCE * abs(median) if median else none
    is_held = is_constant.sum() >= max(_MIN_CONSTANT_ROWS, _MIN_CONSTANT_SHARE * len(values))
    return np.asarray(is_constant if is_held else none)


def table_values(
    text: InstrumentText, block: TableBlock, columns: Mapping[str, TableColumn], table_kind: Kind, notes: list[str]
) -> tuple[Floats, Floats | None, TableColumn]:
    """Return values (n, 1 or 2), their uncertainties where all are stated, and the column of the first.

    A relaxation without a modulus is stress over the strain that is held, a creep strain over stress. `notes` gets a
    sentence on values that are computed.
    """
    roles = VALUE_ROLES[table_kind]
    pair = moduli_among(columns) if table_kind == "oscillation" else roles
    if pair != roles:
        notes.append(f"of {columns[pair[0]].name} and {columns[pair[1]].name}")
        return _moduli_by_angle(text, block, columns, pair), None, columns[pair[0]]
    if roles[0] in columns and any(line.cell(columns[roles[0]].index) for line in block.rows):
        y = np.column_stack([si_values(text, block, columns[role]) for role in roles])
        std_columns = [columns[f"{role}_std"] for role in roles if f"{role}_std" in columns]
        std = None
        if len(std_columns) == len(roles):
            std = np.column_stack([si_values(text, block, column) for column in std_columns])
        return y, std, columns[roles[0]]
    held, free = ("strain", "stress") if table_kind == "relaxation" else ("stress", "strain")
    is_held = constant_rows(text, block, columns[held])
    ratio = si_values(text, block, columns[free]) / si_values(text, block, columns[held])
    notes.append(f"{free} over the {held} that is held")
    return np.where(is_held, ratio, np.nan)[:, None], None, columns["stress"]


def _moduli_by_angle(
    text: InstrumentText, block: TableBlock, columns: Mapping[str, TableColumn], pair: tuple[str, ...]
) -> Floats:
    """Return G' = |G*| cos(delta) and G'' = |G*| sin(delta) (n, 2), by a modulus, and the angle or its tangent."""
    modulus, angle = (si_values(text, block, columns[role]) for role in pair)
    if pair[1] == "loss_factor":
        angle = np.arctan(angle)
    magnitude = modulus if pair[0] == "magnitude" else modulus / np.cos(angle)
    return np.column_stack([magnitude * np.cos(angle), magnitude * np.sin(angle)])
