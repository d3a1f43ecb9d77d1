"""Sweeps by their temperature: tables are parted where the temperature steps, and joined where it is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from palpate import ConfigurationError, to_si

from palpate_reference.material_table import MaterialTable

_SAME = 1.0  # [K] within which sweeps have one temperature
_ROWS = 3  # of a sweep at least
ZERO = 273.15  # [K] of 0 °C


@dataclass(frozen=True)
class TemperatureSweep:
    """What was measured at one temperature."""

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
    """Sweeps from cold to warm; raises ConfigurationError where they cannot be of one master curve."""
    kinds = {(table.kind, table.shear) for table in tables}
    if len(kinds) > 1:
        names = ", ".join(f"{table.name} ({table.kind})" for table in tables)
        raise ConfigurationError(f"{names}: a master curve is of one kind of table, and of G or of E")
    parts = [part for table in tables for part in _parts(table)]
    if not parts:
        raise ConfigurationError(f"{tables[0].name}: no sweep of {_ROWS} rows at one temperature")
    groups: list[list[MaterialTable]] = []
    for part in sorted(parts, key=_temperature):
        if groups and _temperature(part) - _temperature(groups[-1][0]) <= _SAME:
            groups[-1].append(part)
        else:
            groups.append([part])
    if len(groups) < 2:
        raise ConfigurationError(
            f"{tables[0].name}: all sweeps are at {_temperature(parts[0]):.4g} °C: nothing to shift"
        )
    return [TemperatureSweep(float(np.mean([_temperature(one) for one in group])), tuple(group)) for group in groups]


def _temperature(table: MaterialTable) -> float:
    assert table.temperature is not None
    return float(np.nanmedian(table.temperature))


def _parts(table: MaterialTable) -> list[MaterialTable]:
    """Return a table, parted where its temperature steps; raises ConfigurationError where it states none."""
    if table.temperature is None or not np.isfinite(table.temperature).all():
        raise ConfigurationError(
            f"{table.name}: states no temperature of its rows: a master curve needs a column 'Temperature [°C]'"
        )
    steps = np.flatnonzero(np.abs(np.diff(table.temperature)) > _SAME) + 1
    rows = [part for part in np.split(np.arange(len(table.x)), steps) if len(part) >= _ROWS]
    return [
        replace(
            table, x=table.x[part], y=table.y[part], temperature=table.temperature[part],
            std=None if table.std is None else table.std[part],
            strain=None if table.strain is None else table.strain[part],
        )
        for part in rows
        if float(np.ptp(np.log(table.x[part]))) > 0.0
    ]  # fmt: skip
