"""Tables of many curves in few numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from palpate_engine import Pipeline, display_unit
from palpate_kit.curves.curve_fits import value_units
from palpate_kit.terminal.table import Table


def each_table(tracks: Mapping[str, Mapping[str, Any]], pipeline: Pipeline) -> Table:
    """Of many curves: how many were fitted, and median and quartiles of each value by track."""
    units = {name: unit for track in pipeline.tracks for name, unit in value_units(track.model).items()}
    shown = [name for name in units if any(name in found.get("quartiles", {}) for found in tracks.values())]
    heads = [f"{name}\n{display_unit(units[name])[0]}" for name in shown]
    left = ["track"] if len(tracks) > 1 else []
    rows = [
        [
            *([label] if left else []),
            *(str(found[name]) for name in ("curves", "failed", "flagged")),
            *(quartiles_text(found.get("quartiles", {}).get(name), display_unit(units[name])[1]) for name in shown),
        ]
        for label, found in tracks.items()
    ]
    title = "median (quartiles) of the curves"
    return Table.of(title, [*left, "curves", "failed", "flagged", *heads], rows, left)


def quartiles_text(found: Sequence[float] | None, factor: float) -> str:
    """Median and quartiles in a display unit; a dash without values."""
    if found is None:
        return "-"
    low, middle, high = (f"{value * factor:.4g}" for value in found)
    return f"{middle} ({low} to {high})"
