"""The run folder: made once, never written over."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from palpate.contact import Parameter
from palpate.errors import OutputError
from palpate.estimation import Estimates, Samples


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


def write_new(path: Path, text: str) -> None:
    """Write a file that must not exist yet; raises OutputError."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {error.strerror}") from error


class EstimatesFile:
    """``estimates.csv``: time, place, every parameter and its standard deviation of every track, decimated."""

    def __init__(self, file: IO[str], tracks: Mapping[str, Sequence[Parameter]], interval: float) -> None:
        self._rows = csv.writer(file, lineterminator="\n")
        self._interval = interval
        self._next = -np.inf
        header = ["time_s", "x_m", "y_m"]
        for track, parameters in tracks.items():
            header += [f"{track}:{p.name}{suffix}" for p in parameters for suffix in ("", "_std")]
            header += [f"{track}:{name}" for name in ("surface", "surface_std", "force", "nis", "status")]
        self._rows.writerow(header)

    def write(self, samples: Samples, estimates: Mapping[str, Estimates]) -> None:
        """One row for each interval of time: the tip's place and the estimates of all tracks on a block of samples."""
        blocks = list(estimates.values())
        rows = self._due(samples.time)
        columns: list[Any] = [samples.time[rows], samples.lateral[rows, 0], samples.lateral[rows, 1]]
        for block in blocks:
            for k in range(block.values.shape[1]):
                columns += [block.values[rows, k], block.std[rows, k]]
            columns += [block.surface[rows], block.surface_std[rows], block.force[rows], block.nis[rows]]
            columns.append(block.status[rows])
        for row in zip(*(column.tolist() for column in columns), strict=True):
            self._rows.writerow(["" if value != value else value for value in row])

    def _due(self, time: NDArray[np.float64]) -> list[int]:
        if self._interval <= 0:
            return list(range(len(time)))
        rows = []
        for i, now in enumerate(time.tolist()):
            if now >= self._next - 1e-9:
                rows.append(i)
                self._next = (np.floor(now / self._interval + 1e-6) + 1) * self._interval
        return rows
