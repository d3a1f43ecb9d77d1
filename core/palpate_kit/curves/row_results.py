"""Rows of fits.csv as rows of the table of results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from palpate import ContactModel
from palpate_engine import Registry, remedy_of

from palpate_kit.curves.curve_fits import row_conditions, value_units
from palpate_kit.terminal.result_table import ResultFinding, ResultRow, ResultTable, TableValue


def row_table(rows: Iterable[Mapping[str, str]], model: ContactModel, registry: Registry) -> ResultTable:
    """Return the table of rows of fits, whose values are those of a model."""
    units = value_units(model)
    severities = {code: meaning.severity for code, meaning in registry.meanings.items()}
    results = tuple(result_row(row, units, severities) for row in rows)
    track_count = len({row.track for row in results if row.track})
    return ResultTable(results, thing="file" if track_count <= 1 else "row")


def result_row(row: Mapping[str, str], units: Mapping[str, str], severities: Mapping[str, str]) -> ResultRow:
    """Return a row of fits as a row of the table; `units` by value, `severities` by code."""
    conditions = row_conditions(row)
    return ResultRow(
        record=row.get("curve", ""),
        track=row.get("track", ""),
        values={name: _table_value(row, name, unit) for name, unit in units.items()},
        conditions=conditions,
        remedies={fact: remedy for fact in conditions if (remedy := remedy_of(fact))},
        findings=tuple(ResultFinding.of_cell(row.get("findings", ""), severities)),
        error=row.get("error", ""),
    )


def _table_value(row: Mapping[str, str], name: str, unit: str) -> TableValue:
    verdict = row.get(f"{name}_verdict") or row.get("verdict") or ""
    value = float(row[name]) if row.get(name) else None
    return TableValue(name, value, float(row.get(f"{name}_combined") or math.nan), unit, verdict)
