"""Estimates along the way of the tip, read back from a run folder."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import LogError
from palpate.estimation import Status
from palpate.pipeline import parts_of

Floats = NDArray[np.float64]

TABLES = ("estimates-offline.csv", "estimates.csv")  # those made afterwards know more
_UNUSABLE = Status.IDLE | Status.WAITING | Status.DIVERGED


@dataclass(frozen=True)
class Path2D:
    """The estimates of one parameter by one track, with the places of the tip; only those that can be used."""

    track: str
    parameter: str
    time: Floats  # (n,) [s]
    place: Floats  # (n, 2) [m] x and y
    value: Floats  # (n,) [SI]
    std: Floats  # (n,) [SI] as the estimator believes it
    nis: float  # mean normalised innovation squared; 1 where model and noise are right


@dataclass(frozen=True)
class _Table:
    names: list[str]
    numbers: Floats  # (n, columns)

    def column(self, name: str) -> Floats:
        return np.asarray(self.numbers[:, self.names.index(name)])


def read_path(folder: Path, track: str | None = None, parameter: str | None = None) -> Path2D:
    """The estimates of a run and of its continuations; by default of its best track's first parameter.

    The best is an offline track where there is one, else the first in the table; each part has its own, since one that
    was killed has no offline estimates. Raises LogError for what is missing.
    """
    known = {name for part in parts_of(folder) for name in tracks_of(part)}
    if not known:
        raise LogError(f"{folder}: is no run folder: it has no table of estimates")
    if track is not None and track not in known:
        raise LogError(f"{folder}: there is no track {track!r} (there are: {', '.join(sorted(known))})")
    paths = [found for part in parts_of(folder) if (found := _read_part(part, track, parameter)) is not None]
    if not paths:
        raise LogError(
            f"{folder}: holds no estimates in contact with a place: set lateral_x or lateral_y in [alignment]"
        )
    shift = np.cumsum([0.0, *(path.time[-1] + 1.0 for path in paths[:-1])])
    return Path2D(
        paths[0].track,
        paths[0].parameter,
        np.concatenate([path.time + late for path, late in zip(paths, shift, strict=True)]),
        np.concatenate([path.place for path in paths]),
        np.concatenate([path.value for path in paths]),
        np.concatenate([path.std for path in paths]),
        float(np.mean([path.nis for path in paths])),
    )


def tracks_of(folder: Path) -> list[str]:
    """The names of the tracks that one folder has estimates of, the best first."""
    names: list[str] = []
    for table in TABLES:
        if (folder / table).is_file():
            names += [n.partition(":")[0] for n in _read(folder / table, head=True).names if n.endswith(":status")]
    return names


def _read_part(folder: Path, track: str | None, parameter: str | None) -> Path2D | None:
    tracks = tracks_of(folder)
    track = track or next(iter(tracks), None)
    if track not in tracks or track is None:
        return None
    for name in TABLES:
        if not (folder / name).is_file():
            continue
        table = _read(folder / name)
        if f"{track}:status" in table.names:
            return _path(folder, table, track, parameter)
    return None


def _path(folder: Path, table: _Table, track: str, parameter: str | None) -> Path2D | None:
    own = [n.partition(":")[2] for n in table.names if n.startswith(f"{track}:") and n.endswith("_std")]
    parameters = [name.removesuffix("_std") for name in own if name != "surface_std"]
    parameter = parameter or parameters[0]
    if parameter not in parameters:
        raise LogError(f"{folder}: {track} has no {parameter!r} (there are: {', '.join(parameters)})")
    place = np.column_stack([table.column("x_m"), table.column("y_m")])
    place = np.where(np.isfinite(place).any(axis=0), place, 0.0)  # a sweep may know one coordinate only
    value, std = table.column(f"{track}:{parameter}"), table.column(f"{track}:{parameter}_std")
    status = np.nan_to_num(table.column(f"{track}:status"), nan=float(Status.IDLE)).astype(int)
    usable = ((status & int(_UNUSABLE)) == 0) & np.isfinite(value) & (value > 0) & np.isfinite(std)
    known = np.isfinite(table.column("x_m")) | np.isfinite(table.column("y_m"))
    rows = usable & known & np.isfinite(place).all(axis=1)
    if not rows.any():
        return None
    nis = table.column(f"{track}:nis")[rows]
    mean = float(np.nanmean(nis)) if np.isfinite(nis).any() else 1.0
    return Path2D(track, parameter, table.column("time_s")[rows], place[rows], value[rows], std[rows], mean)


def _read(path: Path, head: bool = False) -> _Table:
    """A table of numbers; a last line that a crash has cut short is left out."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = csv.reader(file)
            names = next(rows, [])
            lines = [] if head else [row for row in rows if len(row) == len(names)]
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        numbers = np.array([[float(cell) if cell else np.nan for cell in row] for row in lines])
    except ValueError as error:
        raise LogError(f"{path}: is not a table of numbers: {error}") from error
    return _Table(names, numbers.reshape(len(lines), len(names)))
