"""How far the model's force is from the measured one, over repeats of one palpation (paper, figure `forces`)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, LogError
from palpate_kit.runs.run_folder import RunFolder

_LEAST = 10  # rows of a run
_SPARSEST = 1000  # intervals between two rows, on average


def force_error(runs: Iterable[tuple[Path, str]]) -> dict[str, Any] | None:
    """Mean (n,) [N] and standard deviation between runs (n,) [N] of the force error over the time tracked (n,) [s].

    The error is f - m d'' - F(d, d'): measured force less the tip's inertia and the model's force. `runs` are pairs of
    folder and track, read one by one; None if fewer than two of them have the columns in their tables of estimates.
    """
    curves = (curve for folder, track in runs if (curve := _error(folder, track)) is not None)
    interval, used = math.nan, 0
    count, mean, scatter = np.zeros((3, 0))  # by time: runs, mean of their error, sum of its squares about that
    for time, error in curves:
        if not used:
            interval = float(np.median(np.diff(time)))
            count, mean, scatter = np.zeros((3, _length(time, interval)))
        places = np.rint(time / interval).astype(int)
        count, mean, scatter = (sums[: _length(time, interval)] for sums in (count, mean, scatter))
        row = np.full(len(count), np.nan)
        inside = places < len(row)
        row[places[inside]] = error[inside]
        known, used = np.isfinite(row), used + 1
        step = row[known] - mean[known]
        count[known] += 1
        mean[known] += step / count[known]
        scatter[known] += step * (row[known] - mean[known])
    whole = count > 1
    if used < 2 or not whole.any():
        return None
    place, count, mean, scatter = np.flatnonzero(whole), count[whole], mean[whole], scatter[whole]
    return {
        "count": used,
        "time": (place * interval).tolist(),
        "mean": mean.tolist(),
        "std": np.sqrt(scatter / (count - 1)).tolist(),
        "rms": float(np.sqrt((scatter + count * mean**2).sum() / count.sum())),
    }


def _length(time: Floats, interval: float) -> int:
    """Rows from a run's begin to its end, within what damaged times can ask for."""
    return 1 + int(min(np.rint(time[-1] / interval), _SPARSEST * len(time)))


def _error(folder: Path, track: str) -> tuple[Floats, Floats] | None:
    """Time tracked (n,) [s] and error of the force (n,) [N] of a run; None where its tables do not show it."""
    run = RunFolder(folder)
    try:
        table = next((table for table in run.tables if track in table.tracks), None)
        settings = run.settings
    except LogError:
        return None
    if table is None:
        return None
    found, measured = table.track(track), table.measured
    time = measured["time"]
    if "force" not in found.others or len(time) < _LEAST:
        return None
    # Height and depth count in opposite directions: u = F + m d'' = F - m z''.
    inertia = settings.get("alignment", {}).get("tip_mass", 0.0) * np.gradient(measured["velocity"], time)
    error = measured["force"] + inertia - found.others["force"]
    known = found.usable & np.isfinite(error)
    if known.sum() < _LEAST or (np.diff(time[known]) <= 0).any():
        return None
    return time[known] - time[known][0], error[known]
