"""How far the model's force is from the measured one, over repeats of one palpation (paper, figure `forces`)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, LogError
from palpate_kit.runs.run_folder import RunFolder

_LEAST = 10  # rows of a run


def force_error(runs: Iterable[tuple[Path, str]]) -> dict[str, Any] | None:
    """Mean of the error and its standard deviation between runs (n,) [N] over the time tracked (n,) [s].

    The error is force less inertia of the tip less the model's force. Runs are folders, each with its track; None for
    fewer than two whose tables of estimates have what it takes.
    """
    curves = [curve for folder, track in runs if (curve := _error(folder, track)) is not None]
    if len(curves) < 2:
        return None
    interval = float(np.median(np.diff(curves[0][0])))
    rows = [np.rint(time / interval).astype(int) for time, _ in curves]
    table = np.full((len(curves), 1 + min(int(places[-1]) for places in rows)), np.nan)
    for line, places, (_, error) in zip(table, rows, curves, strict=True):
        inside = places < len(line)
        line[places[inside]] = error[inside]
    whole = np.isfinite(table).sum(axis=0) > 1
    table = table[:, whole]
    return {
        "count": len(curves),
        "time": (np.flatnonzero(whole) * interval).tolist(),
        "mean": np.nanmean(table, axis=0).tolist(),
        "std": np.nanstd(table, axis=0, ddof=1).tolist(),
        "rms": float(np.sqrt(np.nanmean(table**2))),
    }


def _error(folder: Path, track: str) -> tuple[Floats, Floats] | None:
    """Time tracked (n,) [s] and error of the force (n,) [N] of a run; None where its tables do not tell."""
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
    return (time[known] - time[known][0], error[known]) if known.sum() >= _LEAST else None
