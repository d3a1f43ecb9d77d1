"""Contents of the tables of estimates, in any format: names of their columns, rows that are due, their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, Floats, Parameter, Samples

_PLACE = ("time_s", "x_m", "y_m")
_MEASURED = (*_PLACE, "force_N", "position_m", "velocity_m_s")
_ALWAYS = ("surface", "surface_std", "force", "nis", "status")
_OTHERS = (*_ALWAYS, "innovation")
_ROUNDING = 1e-6  # of an interval: a sample at its beginning is in it, whatever rounding says


def columns_of(tracks: Mapping[str, Sequence[Parameter]]) -> list[str]:
    """Return the names of the columns: time, place, what was measured, and for each track its parameters, their std,
    the rest."""
    names = [*_MEASURED]
    for track, parameters in tracks.items():
        names += [f"{track}:{p.name}{suffix}" for p in parameters for suffix in ("", "_std")]
        names += [f"{track}:{name}" for name in _OTHERS]
    return names


def missing_columns(names: Sequence[str], tracks: Sequence[str]) -> list[str]:
    """Return the columns that a table of tracks lacks, or has twice; tables of older versions lack some that
    are new."""
    deviations = [name for name in names if name.endswith("_std")]
    required = [*_PLACE, *(f"{track}:{name}" for track in tracks for name in _ALWAYS), *deviations]
    required += [name.removesuffix("_std") for name in deviations]
    return [name for name in required if names.count(name) != 1] if tracks else []


def numbers_of(samples: Samples, estimates: Mapping[str, Estimates], rows: NDArray[np.int64]) -> Floats:
    """Return the numbers (n, columns) of some rows of a block."""
    columns: list[NDArray[Any]] = [samples.time, *samples.lateral.T, samples.force, samples.position, samples.velocity]
    for block in estimates.values():
        columns += [column for pair in zip(block.values.T, block.std.T, strict=True) for column in pair]
        columns += [getattr(block, name) for name in _OTHERS]
    table = np.empty((len(columns), len(rows)))  # column by column, as they are read
    for place, column in zip(table, columns, strict=True):
        place[:] = column[rows]
    return table.T


class DueRows:
    """Choice of the samples that get a row: the first of every interval of time [s]; all of them where it is 0."""

    def __init__(self, interval: float) -> None:
        self._interval = interval
        self._slot = -np.inf  # of time, in which the latest row lies

    def of(self, time: Floats) -> NDArray[np.int64]:
        """Return the rows of a block at times (n,) [s]."""
        if self._interval <= 0 or not len(time):
            return np.arange(len(time))
        # A row is due where a sample lies in a later slot of time than all before it.
        slots = np.floor(time / self._interval + _ROUNDING)
        latest_slots = np.maximum.accumulate(np.concatenate([[self._slot], slots]))
        self._slot = float(latest_slots[-1])
        return np.flatnonzero(slots > latest_slots[:-1])
