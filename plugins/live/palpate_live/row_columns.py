"""What the page gets for each instant: one row, with the columns of the samples and those of every track."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Estimates, Floats, Parameter, Run, Samples, Status
from palpate_engine import display_unit
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.skin_grid import lump_shapes, read_lumps, skin_over

COMMON = ("force", "position", "x", "y", "contact")
PER_TRACK = ("surface", "force", "nis", "innovation")  # after value and uncertainty of each parameter
RATE = 100.0  # [Hz] of the rows
UNUSABLE = int(Status.IDLE | Status.WAITING | Status.DIVERGED)

Table = NDArray[np.float32]


@dataclass(frozen=True)
class RowColumns:
    """Where each column is."""

    tracks: Mapping[str, tuple[Parameter, ...]]

    @property
    def begins(self) -> dict[str, int]:
        """Column at which those of each track begin."""
        found, at = {}, len(COMMON)
        for track, parameters in self.tracks.items():
            found[track] = at
            at += self.width(len(parameters))
        return found

    @property
    def count(self) -> int:
        """How many there are."""
        return len(COMMON) + sum(self.width(len(parameters)) for parameters in self.tracks.values())

    @staticmethod
    def width(parameters: int) -> int:
        """Columns of a track with so many parameters."""
        return 2 * parameters + len(PER_TRACK)

    def of_samples(self, samples: Samples, rows: NDArray[np.intp]) -> Table:
        """Rows (n, columns) of chosen samples; estimates are not known yet."""
        table = np.full((len(rows), self.count), np.nan, np.float32)
        table[:, 0] = samples.force[rows]
        table[:, 1] = samples.position[rows]
        table[:, 2:4] = samples.lateral[rows]
        table[:, 4] = samples.contact[rows]
        return table

    @staticmethod
    def of_track(estimates: Estimates, rows: NDArray[np.intp], beyond: Floats) -> Table:
        """Rows (n, columns of the track): values, uncertainties with what is known `beyond` the estimator's (k,)."""
        count = estimates.values.shape[1]
        table = np.empty((len(rows), RowColumns.width(count)), np.float32)
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges may be too large for a picture
            table[:, :count] = estimates.values[rows]
            table[:, count : 2 * count] = np.hypot(estimates.std[rows], beyond)
            table[:, 2 * count] = estimates.surface[rows]
            table[:, 2 * count + 1] = estimates.force[rows]
            table[:, 2 * count + 2] = estimates.nis[rows]
            table[:, 2 * count + 3] = estimates.innovation[rows]
        table[(estimates.status[rows] & UNUSABLE) != 0] = np.nan
        return table


def rows_of(time: Floats, before: float) -> tuple[NDArray[np.intp], float]:
    """Which samples become rows, the first of each hundredth of a second, and the hundredth of the last sample."""
    bins = np.floor(time * RATE)
    known = np.empty(len(bins))
    known[0], known[1:] = before, bins[:-1]
    return np.flatnonzero(bins > known), float(bins[-1])


def describe_run(run: Run, recorded: bool) -> dict[str, Any]:
    """What the page has to know of a run before it gets anything else."""
    columns = RowColumns(run.tracks)
    begins = columns.begins
    return {
        "kind": "run",
        "name": run.name,
        "duration": run.duration,
        "extent": run.extent,
        "recorded": recorded,
        "folder": str(run.folder),
        "columns": columns.count,
        "skin": None if run.surface is None or run.extent is None else skin_over(run.surface, run.extent),
        "lumps": lump_shapes(read_lumps(RunFolder(run.folder).maps)) if recorded else [],
        "tracks": [
            {"name": track, "begin": begins[track], "parameters": [_shown(parameter) for parameter in parameters]}
            for track, parameters in run.tracks.items()
        ],
    }


def _shown(parameter: Parameter) -> dict[str, Any]:
    unit, factor = display_unit(parameter.unit)
    return {"name": parameter.name, "unit": unit, "factor": factor}


def beyond(part: Mapping[str, Any]) -> float:
    """Return the part of a combined standard uncertainty [SI] that the estimator does not know; NaN where it is
    unknown."""
    if part["combined"] is None and part["std"] is not None:
        return math.nan
    return math.hypot(part["settling"] or 0.0, part.get("systematic") or 0.0)
