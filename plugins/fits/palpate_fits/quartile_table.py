"""Tables of many curves in few numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from palpate_engine import Pipeline, display_unit
from palpate_kit.curves.curve_fits import value_units
from palpate_kit.terminal.table import Table

_COUNTS = ("curves", "failed", "flagged")


def each_table(tracks: Mapping[str, Mapping[str, Any]], pipeline: Pipeline) -> Table:
    """Return the table of many curves: how many were fitted, and median and quartiles of each value, by track.

    `tracks` are the summaries by the tracks' names; a column of these is left out where there is one alone.
    """
    units = {name: unit for track in pipeline.tracks for name, unit in value_units(track.model).items()}
    names = [name for name in units if any(name in summary.get("quartiles", {}) for summary in tracks.values())]
    headings = [f"{name}\n{display_unit(units[name])[0]}" for name in names]
    label_columns = ["track"] if len(tracks) > 1 else []
    rows = []
    for label, summary in tracks.items():
        cells = [label] if label_columns else []
        cells += [str(summary[count]) for count in _COUNTS]
        quartiles = summary.get("quartiles", {})
        cells += [quartiles_text(quartiles.get(name), display_unit(units[name])[1]) for name in names]
        rows.append(cells)
    title = "median (quartiles) of the curves"
    return Table.of(title, [*label_columns, *_COUNTS, *headings], rows, label_columns)


def quartiles_text(quartiles: Sequence[float] | None, factor: float) -> str:
    """Return lower quartile, median and upper quartile [SI] as text, in a display unit; a dash without values."""
    if quartiles is None:
        return "-"
    low, median, high = (f"{value * factor:.4g}" for value in quartiles)
    return f"{median} ({low} to {high})"
