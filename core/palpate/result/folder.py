"""The run folder: made once, never written over."""

from __future__ import annotations

import csv
import re
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from time import monotonic
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from palpate.contact import Parameter
from palpate.errors import OutputError
from palpate.estimation import Estimates, Samples
from palpate.result.text import csv_rows
from palpate.vectors import Floats

PIPELINE, GIVEN, RESULT = "pipeline.toml", "given.toml", "result.json"
ONLINE, OFFLINE = "estimates.csv", "estimates-offline.csv"
# Of result.json: 1 had flags as texts, no verdict and no number of its own; to 2 a sweep's values were its last ones;
# to 3 the standstill of a live run was `rest`.
SCHEMA = 4

_FLUSH = 0.5  # [s]; what is killed keeps its rows up to then


def make_folder(name: str, wanted: Path | None, now: datetime) -> Path:
    """A new, empty folder: the one that is wanted, or ``runs/<date>_<time>_<name>``.

    Raises OutputError where it cannot be made, or where the wanted one already holds something.
    """
    try:
        if wanted is not None:
            wanted.mkdir(parents=True, exist_ok=True)
            if any(wanted.iterdir()):
                raise OutputError(f"{wanted}: the output folder is not empty, and nothing is ever overwritten")
            return wanted
        slug = re.sub(r"[^A-Za-z0-9.-]+", "-", name).strip("-") or "run"
        stem = Path("runs") / f"{now:%Y-%m-%d_%H-%M-%S}_{slug}"
        for count in range(1, 1000):
            folder = stem if count == 1 else stem.with_name(f"{stem.name}_{count}")
            try:
                folder.mkdir(parents=True)
                return folder
            except FileExistsError:
                continue
    except OSError as error:
        raise OutputError(f"{error.filename or wanted}: cannot make the output folder: {error.strerror}") from error
    raise OutputError(f"{stem}: there are too many runs of this name and second")


def withdraw_folder(folder: Path) -> None:
    """Remove the folder of a run that was refused before it recorded anything, and ``runs`` where that was all."""
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):  # it holds other runs
        if folder.parent.name == "runs":
            folder.parent.rmdir()


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
