"""The tables of estimates in the run folder, written while a run goes on."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, Floats, OutputError, Parameter, Samples

from palpate_basics.text import csv_rows

ONLINE, OFFLINE = "estimates.csv", "estimates-offline.csv"
_FLUSH = 0.5  # [s]; what is killed keeps its rows up to then


@contextmanager
def estimates_file(
    folder: Path, tracks: Mapping[str, Sequence[Parameter]], interval: float, offline: bool
) -> Iterator[EstimatesFile]:
    """A new table in the run folder, of tracks by their names; raises OutputError where it cannot be made."""
    path = folder / (OFFLINE if offline else ONLINE)
    try:
        file = path.open("x", newline="", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {error.strerror}") from error
    with file:
        yield EstimatesFile(file, tracks, interval)


class EstimatesFile:
    """``estimates.csv``: time, place, what was measured, every parameter of every track with its std; decimated.

    Numbers have ten digits, far more than any of them deserves.
    """

    def __init__(self, file: IO[str], tracks: Mapping[str, Sequence[Parameter]], interval: float) -> None:
        self._file = file
        self._interval = interval
        self._slot = -np.inf  # of time, in which the latest row lies
        self._flushed = monotonic()
        header = ["time_s", "x_m", "y_m", "force_N", "position_m", "velocity_m_s"]
        for track, parameters in tracks.items():
            header += [f"{track}:{p.name}{suffix}" for p in parameters for suffix in ("", "_std")]
            header += [f"{track}:{name}" for name in ("surface", "surface_std", "force", "nis", "status", "innovation")]
        csv.writer(file, lineterminator="\n").writerow(header)

    def write(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """One row for each interval of time: the tip's place, what was measured, and every track's estimates."""
        rows = self._due(samples.time)
        columns: list[NDArray[Any]] = [samples.time[rows, None], samples.lateral[rows]]
        columns += [column[rows, None] for column in (samples.force, samples.position, samples.velocity)]
        for block in estimates.values():
            pairs = np.stack([block.values[rows], block.std[rows]], axis=2)
            columns.append(pairs.reshape(len(rows), 2 * block.values.shape[1]))
            others = (block.surface, block.surface_std, block.force, block.nis, block.status, block.innovation)
            columns += [column[rows, None] for column in others]
        table = np.concatenate(columns, axis=1)
        self._file.write(csv_rows(table))
        if (now := monotonic()) - self._flushed > _FLUSH:
            self._file.flush()
            self._flushed = now

    def _due(self, time: Floats) -> NDArray[np.int64]:
        """The first sample of every interval."""
        if self._interval <= 0 or not len(time):
            return np.arange(len(time))
        slots = np.floor(time / self._interval + 1e-6)
        before = np.maximum.accumulate(np.concatenate([[self._slot], slots]))
        self._slot = float(before[-1])
        return np.flatnonzero(slots > before[:-1])
