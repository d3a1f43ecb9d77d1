"""Moduli over depth, as in "elasticity 348.0 ± 2.0, 218.33 ± 0.46 kPa over 0.33-1.1, 1.1-2.2 mm"."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from palpate_engine import Result, TrackResult, display_unit

from palpate_kit.terminal.quantities import value_with_uncertainty

_MIN_MILLIMETRES = 1e-4  # [m], depth from which on depths are written in mm, else in um: a choice


def stiffness_lines(result: Result) -> list[str]:
    """Return a line for each model whose law the record of a press does not follow to its noise."""
    lines = dict[str, str]()
    has_several_models = len({track.model for track in result.tracks.values()}) > 1
    for track in result.tracks.values():
        table = track.diagnoses.get("stiffness-over-depth")
        has_misfit = "reasons" in track.diagnoses.get("model-discrepancy", {})
        if table and has_misfit:
            prefix = f"{track.model}: " if has_several_models else ""
            lines.setdefault(track.model, prefix + stiffness_text(track, table))
    return list(lines.values())


def stiffness_text(track: TrackResult, table: Mapping[str, Any]) -> str:
    """Return moduli over depth, as in "elasticity 336.0 ± 2.1, 217.1 ± 1.4 kPa over 0.3-1, 1-2 mm"."""
    unit, factor = display_unit(track.parameters[table["parameter"]].unit)
    pairs = zip(table["values"], table["std"], strict=True)
    values = ", ".join(value_with_uncertainty(factor * value, factor * std) for value, std in pairs)
    length_unit, scale = ("mm", 1e3) if table["depth"][-1] >= _MIN_MILLIMETRES else ("um", 1e6)
    edges = [f"{scale * edge:.2g}" for edge in table["depth"]]
    stretches = ", ".join(f"{low}-{high}" for low, high in pairwise(edges))
    return f"{table['parameter']} {values} {unit} over {stretches} {length_unit}"
