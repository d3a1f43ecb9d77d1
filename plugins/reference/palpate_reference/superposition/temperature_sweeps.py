"""Sweeps by their temperature: tables are split where the temperature steps, and joined where it is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from palpate import ConfigurationError, to_si

from palpate_reference.material_table import MaterialTable

_TEMPERATURE_STEP = 1.0  # [K], a choice: within it sweeps have one temperature, above what an oven varies by
_MIN_ROWS = 3  # of a sweep, a choice: fewer have no curvature
ZERO = 273.15  # [K] of 0 °C


@dataclass(frozen=True)
class TemperatureSweep:
    """The tables that were measured at one temperature."""

    temperature: float  # [°C]
    tables: tuple[MaterialTable, ...]


def temperature_of(text: str) -> float:
    """Return a temperature [°C] as a person writes it, '25 °C' or '298 K'; raises ConfigurationError."""
    plain = text.strip().replace("°", "").replace("deg", "").strip()
    try:
        if plain.endswith("C"):
            return float(plain[:-1])
        return to_si(plain, "K") - ZERO
    except ValueError as error:
        raise ConfigurationError(f"--reference-temperature {text!r}: write for example '25 °C'") from error


def temperature_sweeps(tables: Sequence[MaterialTable]) -> list[TemperatureSweep]:
    """Return the sweeps from cold to warm; raises ConfigurationError where they cannot be of one master curve."""
    kinds = {(table.kind, table.shear) for table in tables}
    if len(kinds) > 1:
        names = ", ".join(f"{table.name} ({table.kind})" for table in tables)
        raise ConfigurationError(f"{names}: a master curve is of one kind of table, and of G or of E")
    parts = [part for table in tables for part in _constant_parts(table)]
    if not parts:
        raise ConfigurationError(f"{tables[0].name}: no sweep of {_MIN_ROWS} rows at one temperature")
    groups: list[list[MaterialTable]] = []
    for part in sorted(parts, key=_temperature):
        if groups and _temperature(part) - _temperature(groups[-1][0]) <= _TEMPERATURE_STEP:
            groups[-1].append(part)
        else:
            groups.append([part])
    if len(groups) < 2:
        raise ConfigurationError(
            f"{tables[0].name}: all sweeps are at {_temperature(parts[0]):.4g} °C: nothing to shift"
        )
    means = [float(np.mean([_temperature(table) for table in group])) for group in groups]
    return [TemperatureSweep(mean, tuple(group)) for mean, group in zip(means, groups, strict=True)]


def _temperature(table: MaterialTable) -> float:
    """Return the usual temperature [°C] of a table."""
    assert table.temperature is not None
    return float(np.nanmedian(table.temperature))


def shift_signs(table: MaterialTable) -> tuple[float, float]:
    """Return the signs by which ln a_T moves an axis and ln b_T a value.

    Frequencies are moved up, times down; moduli up, compliances down.
    """
    return (1.0 if table.kind == "oscillation" else -1.0), (-1.0 if table.kind == "creep" else 1.0)


def _constant_parts(table: MaterialTable) -> list[MaterialTable]:
    """Return a table, split where its temperature steps; raises ConfigurationError where it states none.

    Parts with too few rows, or all at one frequency or time, are left out.
    """
    if table.temperature is None or not np.isfinite(table.temperature).all():
        raise ConfigurationError(
            f"{table.name}: states no temperature of its rows: a master curve needs a column 'Temperature [°C]'"
        )
    steps = np.flatnonzero(np.abs(np.diff(table.temperature)) > _TEMPERATURE_STEP) + 1
    parts = []
    for rows in np.split(np.arange(len(table.x)), steps):
        if len(rows) >= _MIN_ROWS and float(np.ptp(np.log(table.x[rows]))) > 0.0:
            parts.append(
                replace(
                    table,
                    x=table.x[rows],
                    y=table.y[rows],
                    temperature=table.temperature[rows],
                    std=None if table.std is None else table.std[rows],
                    strain=None if table.strain is None else table.strain[rows],
                )
            )
    return parts
