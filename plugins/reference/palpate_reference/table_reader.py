"""Tables of a material as the file of an instrument holds them."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError

from palpate_reference.instrument_text import InstrumentText, read_text
from palpate_reference.material_table import Kind, MaterialTable, TableSettings
from palpate_reference.table_blocks import TableBlock, table_blocks
from palpate_reference.table_checks import (
    ask_for_per_cent,
    ask_for_radians,
    demand_positive,
    demand_same_frequency,
)
from palpate_reference.table_columns import TableColumn, columns_of, demand_names, place, si_values

_VALUES: Mapping[Kind, tuple[str, ...]] = {
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
_HELD: Mapping[str, Kind] = {"strain": "relaxation", "stress": "creep"}  # what is held constant over time
_FLOWS = re.compile(r"\bflow\b|peak hold", re.IGNORECASE)  # steps that no solid is put to
_TIMES = ("step_time", "time", "test_time")  # the first that there is counts
_CONSTANT = 0.02  # relative difference from the median, within which it counts as constant
_SHARE = 0.8  # of the rows in which it must be
_ROWS = 3  # that make a relaxation or a creep


def read_tables(path: Path, settings: TableSettings) -> list[MaterialTable]:
    """Return every table of a file that holds moduli, a compliance, or stress over strain; raises LogError for none."""
    text = read_text(path)
    blocks = table_blocks(text)
    heads = {name for block in blocks for name in block.names}
    demand_names(text, heads, "--unit", settings.units)
    demand_names(text, heads, "--column", settings.columns.values())
    tables: list[MaterialTable] = []
    for block in blocks:
        columns = columns_of(text, block, settings.units, settings.columns)
        kind = _kind(text, block, columns)
        if kind is not None:
            tables.append(_table(text, block, columns, kind, settings))
    if not tables:
        first = blocks[0]
        names = ", ".join(name for name in first.names if name)
        raise LogError(
            f"{path}:{first.names_line or first.rows[0].number if first.rows else 1}: no table of a material: it needs "
            "columns named frequency, G' and G''; time and relaxation modulus or creep compliance; or strain and "
            f"stress (there are: {names})"
        )
    return tables


def _kind(text: InstrumentText, block: TableBlock, columns: Mapping[str, TableColumn]) -> Kind | None:
    """Return the kind of a table by the columns it fills; a flow curve, or a modulus over time in oscillation, is
    left out."""
    if _FLOWS.search(block.title):
        return None
    filled = {role for role, column in columns.items() if any(line.cell(column.index) for line in block.rows)}
    filled = filled or set(columns)
    time = filled & set(_TIMES)
    if moduli_among(filled):
        return "oscillation" if filled & {"frequency", "angular_frequency"} else None
    over_time: list[Kind] = [kind for kind in _HELD.values() if time and _VALUES[kind][0] in filled]
    if len(over_time) == 1 or (over_time and not {"strain", "stress"} <= filled):
        return over_time[0]
    if not {"strain", "stress"} <= filled:
        return None
    spreads = {role: _spread(si_values(text, block, columns[role])) for role in _HELD}
    steadier = min(spreads, key=spreads.__getitem__)  # of a stiff solid both are steady: the held one is so by control
    flows = "flow" in filled
    held = bool(time) and bool(_held(text, block, columns[steadier]).any())
    if held and (over_time or not (flows and steadier == "stress")):  # of any step some programs write J and G(t)
        return _HELD[steadier]
    return "stress-strain" if len(block.rows) > 1 and not flows else None


def moduli_among(roles: Collection[str]) -> tuple[str, ...]:
    """Return the two roles of columns by which storage and loss are known: themselves, or one with the angle between
    them."""
    return next((pair for pair in _MODULI if {*pair} <= {*roles}), ())


def _spread(values: Floats) -> float:
    """Return the usual distance from the median over that; infinite without one."""
    middle = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    return float(np.nanmean(np.abs(values - middle))) / abs(middle) if middle else math.inf


def _held(text: InstrumentText, block: TableBlock, column: TableColumn) -> NDArray[np.bool_]:
    """In which rows (n,) what is held has its value; in none where it is not held over most of them."""
    values = si_values(text, block, column)
    middle = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    steady = np.abs(values - middle) <= _CONSTANT * abs(middle) if middle else np.zeros(len(values), bool)
    return np.asarray(steady if steady.sum() >= max(_ROWS, _SHARE * len(values)) else np.zeros(len(values), bool))


def _table(
    text: InstrumentText, block: TableBlock, columns: dict[str, TableColumn], kind: Kind, settings: TableSettings
) -> MaterialTable:
    if not block.rows:
        raise LogError(f"{text.path}:{block.names_line}: the table has no rows")
    x, notes = _abscissa(text, block, columns, kind)
    y, std, value = _values(text, block, columns, kind, notes)
    if kind == "oscillation":
        _check_frequency(text, block, columns, settings, x, y)
    others = {
        role: si_values(text, block, columns[role]) if role in columns and kind != "stress-strain" else None
        for role in ("strain", "temperature")
    }
    complete = np.isfinite(x) & np.isfinite(y).all(axis=1)
    if kind in ("relaxation", "creep"):
        complete &= x != 0.0  # a step has no answer yet
    if missing := int((~complete).sum()):
        notes.append(f"{missing} rows without all numbers are left out")
    if not complete.any():
        raise LogError(f"{place(text, block, value)}: no row has all numbers")
    if kind != "stress-strain":
        demand_positive(text, block, _positive(columns, kind, x, np.where(complete[:, None], y, np.nan), std))
    if kind == "stress-strain" or (others["strain"] is not None and "strain" in columns):
        checked = x if kind == "stress-strain" else others["strain"]
        ask_for_per_cent(text, block, columns["strain"], checked, settings)
    shear = _shear(text, block, value, kind, settings)
    strain, temperature = (None if one is None else one[complete] for one in others.values())
    return MaterialTable(
        text.path.name, block.title, block.format, kind, shear, x[complete], y[complete],
        None if std is None else std[complete], strain, temperature, tuple(notes),
    )  # fmt: skip


def _values(
    text: InstrumentText, block: TableBlock, columns: Mapping[str, TableColumn], kind: Kind, notes: list[str]
) -> tuple[Floats, Floats | None, TableColumn]:
    """Values (n, 1 or 2), their uncertainties where all are stated, and the column of the first.

    A relaxation without a modulus is stress over the strain that is held, a creep strain over stress.
    """
    roles = _VALUES[kind]
    if kind == "oscillation" and (pair := moduli_among(columns)) != roles:
        first, second = (si_values(text, block, columns[role]) for role in pair)
        notes.append(f"of {columns[pair[0]].name} and {columns[pair[1]].name}")
        angle = second if pair[1] == "phase" else np.arctan(second)
        size = first if pair[0] == "magnitude" else first / np.cos(angle)
        return np.column_stack([size * np.cos(angle), size * np.sin(angle)]), None, columns[pair[0]]
    if roles[0] in columns and any(line.cell(columns[roles[0]].index) for line in block.rows):
        y = np.column_stack([si_values(text, block, columns[role]) for role in roles])
        stds = [columns.get(f"{role}_std") for role in roles]
        std = np.column_stack([si_values(text, block, one) for one in stds if one]) if all(stds) else None
        return y, std, columns[roles[0]]
    held, free = ("strain", "stress") if kind == "relaxation" else ("stress", "strain")
    steady = _held(text, block, columns[held])
    ratio = si_values(text, block, columns[free]) / si_values(text, block, columns[held])
    notes.append(f"{free} over the {held} that is held")
    return np.where(steady, ratio, np.nan)[:, None], None, columns["stress"]


def _positive(
    columns: Mapping[str, TableColumn], kind: Kind, x: Floats, y: Floats, std: Floats | None
) -> list[tuple[TableColumn, Floats]]:
    """Columns of which all values are above zero; a time may be zero, too."""
    axes = ("frequency", "angular_frequency") if kind == "oscillation" else _TIMES
    names = moduli_among(columns) if kind == "oscillation" else _VALUES[kind]
    axis = next(columns[role] for role in axes if role in columns)
    checked = [(axis, x if kind == "oscillation" else x + (x == 0.0))]
    checked += [(columns[role if role in columns else "stress"], y[:, k]) for k, role in enumerate(names)]
    checked += [(columns[f"{role}_std"], std[:, k]) for k, role in enumerate(names) if std is not None]
    return checked


def _abscissa(
    text: InstrumentText, block: TableBlock, columns: dict[str, TableColumn], kind: Kind
) -> tuple[Floats, list[str]]:
    """Frequencies [Hz], times [s] or strains, and what is to be said of them."""
    if kind == "stress-strain":
        return si_values(text, block, columns["strain"]), []
    if kind != "oscillation":
        return si_values(text, block, next(columns[role] for role in _TIMES if role in columns)), []
    column = _frequency(columns)
    x = si_values(text, block, column)
    if column.role == "angular_frequency":
        x = x / (2.0 * math.pi)
    return x, ["frequency in rad/s, divided by 2 pi"] if column.unit != "Hz" else []


def _frequency(columns: Mapping[str, TableColumn]) -> TableColumn:
    return columns["frequency"] if "frequency" in columns else columns["angular_frequency"]


def _check_frequency(
    text: InstrumentText,
    block: TableBlock,
    columns: Mapping[str, TableColumn],
    settings: TableSettings,
    x: Floats,
    moduli: Floats,
) -> None:
    """Raise LogError where frequencies [Hz] contradict the table, or may be in rad/s."""
    column = _frequency(columns)
    if column.role == "frequency" and "angular_frequency" in columns:
        angular = si_values(text, block, columns["angular_frequency"]) / (2.0 * math.pi)
        demand_same_frequency(text, block, column, x, angular)
    if "viscosity" in columns and columns["viscosity"].index < min(len(line.cells) for line in block.rows):
        by_viscosity = np.hypot(*moduli.T) / si_values(text, block, columns["viscosity"]) / (2.0 * math.pi)
        demand_same_frequency(text, block, column, x, by_viscosity)
    if column.unit == "Hz" and column.name not in settings.units:
        ask_for_radians(text, block, column, x)


def _shear(text: InstrumentText, block: TableBlock, column: TableColumn, kind: Kind, settings: TableSettings) -> bool:
    """Return True if moduli are those of shear, as a person, the column, the file or its format says; raises
    LogError."""
    if kind == "stress-strain":
        return "shear" in column.name.lower()
    said = [settings.shear, column.shear, block.shear]
    shear = next((one for one in said if one is not None), None)
    if shear is None:
        sheared = any(name.lower().startswith(("shear strain", "shear stress", "shear rate")) for name in block.names)
        shear = True if sheared else None
    if shear is None:
        raise LogError(
            f"{place(text, block, column)}: of shear (a rheometer's G) or of tension and compression (a DMA's E)? "
            "State --modulus shear or --modulus young"
        )
    return shear
