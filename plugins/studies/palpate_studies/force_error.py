"""The difference of the model's force from the measured one, over repeats of one palpation (paper, figure `forces`)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, LogError
from palpate_kit.runs.run_folder import RunFolder

_MIN_ROWS = 10  # of a run, a choice: the derivative of the velocity needs some
_MAX_MEAN_STEP = 1000  # intervals between two rows, on average; a choice: damaged times would ask for any memory


@dataclass
class _ErrorByTime:
    """The force error at each time tracked, run by run (Welford 1962, Technometrics 4): times k intervals."""

    interval: float  # [s]
    counts: Floats  # (n,) runs
    means: Floats  # (n,) [N] over these runs
    square_sums: Floats  # (n,) [N^2] of the deviations from the mean

    @classmethod
    def along(cls, time: Floats) -> _ErrorByTime:
        """Return the errors of no run yet, at the median interval of times (k,) [s] of a run, up to its end."""
        interval = float(np.median(np.diff(time)))
        counts, means, square_sums = np.zeros((3, _row_count(time, interval)))
        return cls(interval, counts, means, square_sums)

    def add(self, time: Floats, error: Floats) -> None:
        """Add the error (k,) [N] of a run at times (k,) [s]; no time after the end of any run is kept."""
        row_count = _row_count(time, self.interval)
        self.counts = self.counts[:row_count]
        self.means = self.means[:row_count]
        self.square_sums = self.square_sums[:row_count]
        # The errors at the nearest of the common times.
        rows = np.rint(time / self.interval).astype(int)
        is_inside = rows < len(self.counts)
        row_errors = np.full(len(self.counts), np.nan)
        row_errors[rows[is_inside]] = error[is_inside]
        # n += 1, mean += (e - mean)/n, S += (e - mean before)(e - mean after)
        has_error = np.isfinite(row_errors)
        deviation = row_errors[has_error] - self.means[has_error]
        self.counts[has_error] += 1
        self.means[has_error] += deviation / self.counts[has_error]
        self.square_sums[has_error] += deviation * (row_errors[has_error] - self.means[has_error])


def force_error(runs: Iterable[tuple[Path, str]]) -> dict[str, Any] | None:
    """Return the force error over the time tracked, for several runs together, as plain data.

    The error is f - m d'' - F(d, d'): measured force less the tip's inertia and the model's force. `runs` are pairs of
    folder and track, read one by one; None if fewer than two of them have the columns in their tables of estimates.
    Keys: `count` of runs, `time` (n,) [s], `mean` (n,) [N], `std` (n,) [N] between runs, and `rms` [N] over all times.
    """
    run_count = 0
    errors: _ErrorByTime | None = None
    for folder, track in runs:
        run_error = _run_error(folder, track)
        if run_error is None:
            continue
        time, error = run_error
        if errors is None:
            errors = _ErrorByTime.along(time)
        errors.add(time, error)
        run_count += 1
    if errors is None or run_count < 2:
        return None
    # A scatter needs two runs at the same time.
    rows = np.flatnonzero(errors.counts > 1)
    if not len(rows):
        return None
    count, mean, square_sum = errors.counts[rows], errors.means[rows], errors.square_sums[rows]
    return {
        "count": run_count,
        "time": (rows * errors.interval).tolist(),
        "mean": mean.tolist(),
        "std": np.sqrt(square_sum / (count - 1)).tolist(),
        "rms": float(np.sqrt((square_sum + count * mean**2).sum() / count.sum())),
    }


def _row_count(time: Floats, interval: float) -> int:
    """Return the number of intervals [s] from 0 to the end of times (k,) [s], plus 1; bounded for damaged times."""
    return 1 + int(min(np.rint(time[-1] / interval), _MAX_MEAN_STEP * len(time)))


def _run_error(folder: Path, track: str) -> tuple[Floats, Floats] | None:
    """Return time tracked (k,) [s] and force error (k,) [N] of a run; None if its tables do not show it."""
    run = RunFolder(folder)
    try:
        table = next((table for table in run.tables if track in table.tracks), None)
        settings = run.settings
    except LogError:
        return None
    if table is None:
        return None
    estimates, measured = table.track(track), table.measured
    time = measured["time"]
    if "force" not in estimates.others or len(time) < _MIN_ROWS:
        return None
    # Height and depth count in opposite directions: u = F + m d'' = F - m z''.
    inertia = settings.get("alignment", {}).get("tip_mass", 0.0) * np.gradient(measured["velocity"], time)
    error = measured["force"] + inertia - estimates.others["force"]
    is_usable = estimates.usable & np.isfinite(error)
    if is_usable.sum() < _MIN_ROWS or (np.diff(time[is_usable]) <= 0).any():
        return None
    return time[is_usable] - time[is_usable][0], error[is_usable]
