"""Rows of a table of fits in few numbers: how many there are, and quartiles of their values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Floats


def summary_of(rows: Iterable[Mapping[str, str]], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """By track of rows: curves, those that failed or are flagged, and median and quartiles of each named value."""
    found: dict[str, dict[str, Any]] = {}
    numbers: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        track = row.get("track", "")
        told = found.setdefault(track, {"curves": 0, "failed": 0, "flagged": 0})
        told["curves"] += 1
        told["failed"] += bool(row.get("error")) or not row.get("surface")
        told["flagged"] += row.get("verdict") in ("doubtful", "invalid")
        for name in names:
            if row.get(name):
                numbers.setdefault(track, {}).setdefault(name, []).append(float(row[name]))
    for track, columns in numbers.items():
        found[track]["quartiles"] = {name: _quartiles(np.array(values)) for name, values in columns.items()}
    return found


def _quartiles(values: Floats) -> list[float]:
    return [float(value) for value in np.quantile(values, [0.25, 0.5, 0.75])]
