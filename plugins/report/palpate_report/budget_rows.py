"""The budget of uncertainty of a track, as rows of the table on a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate_kit.runs.result_file import estimate_of

from palpate_report.number_texts import number_text

_PREFIX = "systematic_"  # of the keys of a parameter that hold what one source contributes


@dataclass(frozen=True)
class _BudgetSource:
    """A source of uncertainty: its standard deviation [unit], None where none is declared, and its effects by
    parameter."""

    name: str
    std: float | None = None
    unit: str = ""
    effects: dict[str, Mapping[str, Any]] = field(default_factory=dict)


def budget_rows(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the sources of a track's uncertainty, with contribution and share of the combined variance [%].

    Nothing where a parameter has no estimate.
    """
    parameters = table["parameters"]
    if any(estimate_of(value) is None for value in parameters.values()):
        return []
    rows = []
    for source in (*_listed_sources(table), *_unlisted_sources(table)):
        std_text = "" if source.std is None else number_text(source.std, source.unit)
        rows.append({"source": source.name, "std": std_text, "cells": _cells(source, parameters)})
    return rows


def _listed_sources(table: Mapping[str, Any]) -> Iterator[_BudgetSource]:
    """Yield the sources in the budget of a track."""
    for row in table.get("budget", ()):
        yield _BudgetSource(row["source"], row["std"], row["unit"], row["effects"])


def _unlisted_sources(table: Mapping[str, Any]) -> Iterator[_BudgetSource]:
    """Yield the sources that have a systematic term in a parameter, and no row in the budget of the track."""
    # A row may have a note behind the name, such as "tip-mass (not declared)".
    listed = {row["source"].partition(" ")[0].replace("-", "_") for row in table.get("budget", ())}
    sources: dict[str, _BudgetSource] = {}
    for parameter, value in table["parameters"].items():
        for key, contribution in value.items():
            name = key.removeprefix(_PREFIX)
            if key.startswith(_PREFIX) and contribution is not None and name not in listed:
                source = sources.setdefault(name, _BudgetSource(name.replace("_", "-")))
                source.effects[parameter] = {"contribution": contribution}
    yield from sources.values()


def _cells(source: _BudgetSource, parameters: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return text of the contribution of a source, and its share of the combined variance [%], by parameter."""
    cells = {}
    for name, value in parameters.items():
        contribution = source.effects.get(name, {}).get("contribution")
        if contribution is None:
            continue
        combined = value.get("combined")
        share = 100 * (contribution / combined) ** 2 if combined else None
        cells[name] = {"shown": number_text(contribution, value["unit"]), "share": share}
    return cells
