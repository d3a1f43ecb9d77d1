"""Tables of a material as the file of an instrument holds them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
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
from palpate_reference.table_values import VALUE_ROLES, constant_rows, moduli_among, table_values

_KIND_OF_HELD: Mapping[str, Kind] = {"strain": "relaxation", "stress": "creep"}  # by the quantity that is held constant
_FLOWS = re.compile(r"\bflow\b|peak hold", re.IGNORECASE)  # titles of steps for fluids
_TIMES = ("step_time", "time", "test_time")  # the first one in a table counts


def read_tables(path: Path, settings: TableSettings) -> list[MaterialTable]:
    """Return every table of a file that holds moduli, a compliance, or stress over strain; raises LogError for none."""
    text = read_text(path)
    blocks = table_blocks(text)
    headings = {name for block in blocks for name in block.names}
    demand_names(text, headings, "--unit", settings.units)
    demand_names(text, headings, "--column", settings.columns.values())
    tables: list[MaterialTable] = []
    for block in blocks:
        columns = columns_of(text, block, settings.units, settings.columns)
        table_kind = _kind(text, block, columns)
        if table_kind is not None:
            tables.append(_table(text, block, columns, table_kind, settings))
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
    """Return the kind of a table by the columns that have numbers; None for a table that is left out.

    Left out are flow curves, and moduli of an oscillation over time.
    """
    if _FLOWS.search(block.title):
        return None
    filled = {role for role, column in columns.items() if any(line.cell(column.index) for line in block.rows)}
    filled = filled or set(columns)
    has_time = bool(filled & set(_TIMES))
    if moduli_among(filled):
        return "oscillation" if filled & {"frequency", "angular_frequency"} else None

    # A column of a modulus or of a compliance over time, if it is the only one or nothing contradicts it.
    over_time: list[Kind] = [
        table_kind for table_kind in _KIND_OF_HELD.values() if has_time and VALUE_ROLES[table_kind][0] in filled
    ]
    has_both = {"strain", "stress"} <= filled
    if len(over_time) == 1 or (over_time and not has_both):
        return over_time[0]
    if not has_both:
        return None

    return _step_or_curve(text, block, columns, has_time, flows="flow" in filled, has_response=bool(over_time))


def _step_or_curve(
    text: InstrumentText,
    block: TableBlock,
    columns: Mapping[str, TableColumn],
    has_time: bool,
    *,
    flows: bool,
    has_response: bool,
) -> Kind | None:
    """Return the kind of a table with strain and stress: a step of the one that is held, or a curve; None of a fluid.

    `flows`: the table has a shear rate or a viscosity. `has_response`: it has J and G(t), which some programs write of
    any step.
    """
    spreads = {role: _relative_spread(si_values(text, block, columns[role])) for role in _KIND_OF_HELD}
    steadier = min(spreads, key=spreads.__getitem__)  # of a stiff solid both are steady: the held one is so by control
    is_step = has_time and bool(constant_rows(text, block, columns[steadier]).any())
    if is_step and (has_response or not (flows and steadier == "stress")):
        return _KIND_OF_HELD[steadier]
    return "stress-strain" if len(block.rows) > 1 and not flows else None


def _relative_spread(values: Floats) -> float:
    """Return the mean distance from the median over the median; infinite without one."""
    median = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    return float(np.nanmean(np.abs(values - median))) / abs(median) if median else math.inf


def _table(
    text: InstrumentText, block: TableBlock, columns: dict[str, TableColumn], table_kind: Kind, settings: TableSettings
) -> MaterialTable:
    """Return the rows of a table that have all numbers; raises LogError for what it must state and must not hold."""
    if not block.rows:
        raise LogError(f"{text.path}:{block.names_line}: the table has no rows")
    is_curve = table_kind == "stress-strain"
    x, notes = _abscissa(text, block, columns, table_kind)
    y, std, value_column = table_values(text, block, columns, table_kind, notes)
    if table_kind == "oscillation":
        _check_frequency(text, block, columns, settings, x, y)
    strain, temperature = (
        si_values(text, block, columns[role]) if role in columns and not is_curve else None
        for role in ("strain", "temperature")
    )

    # Rows with all numbers; a step has no answer at the time 0.
    is_complete = np.isfinite(x) & np.isfinite(y).all(axis=1)
    if table_kind in ("relaxation", "creep"):
        is_complete &= x != 0.0
    if missing := int((~is_complete).sum()):
        notes.append(f"{missing} rows without all numbers are left out")
    if not is_complete.any():
        raise LogError(f"{place(text, block, value_column)}: no row has all numbers")

    # Signs, units of strains, and shear or Young.
    if not is_curve:
        complete_y = np.where(is_complete[:, None], y, np.nan)
        demand_positive(text, block, _positive_columns(columns, table_kind, x, complete_y, std))
    if is_curve or strain is not None:
        ask_for_per_cent(text, block, columns["strain"], x if is_curve else strain, settings)
    shear = _is_shear(text, block, value_column, table_kind, settings)
    return MaterialTable(
        text.path.name,
        block.title,
        block.format,
        table_kind,
        shear,
        x=x[is_complete],
        y=y[is_complete],
        std=None if std is None else std[is_complete],
        strain=None if strain is None else strain[is_complete],
        temperature=None if temperature is None else temperature[is_complete],
        notes=tuple(notes),
    )


def _positive_columns(
    columns: Mapping[str, TableColumn], table_kind: Kind, x: Floats, y: Floats, std: Floats | None
) -> list[tuple[TableColumn, Floats]]:
    """Return the columns of which all values are above zero, with these values (n,); a time may be zero, too."""
    is_oscillation = table_kind == "oscillation"
    axis_roles = ("frequency", "angular_frequency") if is_oscillation else _TIMES
    value_roles = moduli_among(columns) if is_oscillation else VALUE_ROLES[table_kind]
    axis_column = next(columns[role] for role in axis_roles if role in columns)
    checked = [(axis_column, x if is_oscillation else x + (x == 0.0))]
    for k, role in enumerate(value_roles):
        checked.append((columns[role if role in columns else "stress"], y[:, k]))
    if std is not None:
        checked += [(columns[f"{role}_std"], std[:, k]) for k, role in enumerate(value_roles)]
    return checked


def _abscissa(
    text: InstrumentText, block: TableBlock, columns: dict[str, TableColumn], table_kind: Kind
) -> tuple[Floats, list[str]]:
    """Return frequencies [Hz], times [s] or strains (n,), and notes on a conversion."""
    if table_kind == "stress-strain":
        return si_values(text, block, columns["strain"]), []
    if table_kind != "oscillation":
        return si_values(text, block, next(columns[role] for role in _TIMES if role in columns)), []
    column = _frequency_column(columns)
    x = si_values(text, block, column)
    if column.role == "angular_frequency":
        x = x / (2.0 * math.pi)
    return x, ["frequency in rad/s, divided by 2 pi"] if column.unit != "Hz" else []


def _frequency_column(columns: Mapping[str, TableColumn]) -> TableColumn:
    """Return the column of the frequency, else that of the angular frequency."""
    return columns["frequency"] if "frequency" in columns else columns["angular_frequency"]


def _check_frequency(
    text: InstrumentText,
    block: TableBlock,
    columns: Mapping[str, TableColumn],
    settings: TableSettings,
    x: Floats,
    moduli: Floats,
) -> None:
    """Raise LogError where frequencies x (n,) [Hz] contradict the table, or may be in rad/s.

    With G* of the moduli (n, 2), |eta*| = |G*|/omega gives a frequency, too.
    """
    column = _frequency_column(columns)
    if column.role == "frequency" and "angular_frequency" in columns:
        angular = si_values(text, block, columns["angular_frequency"]) / (2.0 * math.pi)
        demand_same_frequency(text, block, column, x, angular)
    shortest_row = min(len(line.cells) for line in block.rows)
    if "viscosity" in columns and columns["viscosity"].index < shortest_row:
        by_viscosity = np.hypot(*moduli.T) / si_values(text, block, columns["viscosity"]) / (2.0 * math.pi)
        demand_same_frequency(text, block, column, x, by_viscosity)
    if column.unit == "Hz" and column.name not in settings.units:
        ask_for_radians(text, block, column, x)


def _is_shear(
    text: InstrumentText, block: TableBlock, column: TableColumn, table_kind: Kind, settings: TableSettings
) -> bool:
    """Return True if moduli are those of shear, as a person, the column, the file or its format states.

    Raises LogError where none of them does.
    """
    if table_kind == "stress-strain":
        return "shear" in column.name.lower()
    for shear in (settings.shear, column.shear, block.shear):
        if shear is not None:
            return shear
    if any(name.lower().startswith(("shear strain", "shear stress", "shear rate")) for name in block.names):
        return True
    raise LogError(
        f"{place(text, block, column)}: of shear (a rheometer's G) or of tension and compression (a DMA's E)? "
        "State --modulus shear or --modulus young"
    )
