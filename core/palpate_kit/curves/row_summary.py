"""Summary of the rows of a table of fits: counts of curves, and quartiles of their values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Floats

_QUARTILES = (0.25, 0.5, 0.75)


def summary_of(rows: Iterable[Mapping[str, str]], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return by track the number of curves, of failed and of flagged ones, and quartiles [SI] of each named value.

    Failed are those with an error or without a surface, flagged those whose verdict is doubtful or invalid.
    """
    summaries: dict[str, dict[str, Any]] = {}
    numbers: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        track = row.get("track", "")
        counts = summaries.setdefault(track, {"curves": 0, "failed": 0, "flagged": 0})
        counts["curves"] += 1
        counts["failed"] += bool(row.get("error")) or not row.get("surface")
        counts["flagged"] += row.get("verdict") in ("doubtful", "invalid")
        for name in names:
            if row.get(name):
                numbers.setdefault(track, {}).setdefault(name, []).append(float(row[name]))
    for track, columns in numbers.items():
        summaries[track]["quartiles"] = {name: _quartiles(np.array(values)) for name, values in columns.items()}
    return summaries


def _quartiles(values: Floats) -> list[float]:
    return [float(value) for value in np.quantile(values, _QUARTILES)]
