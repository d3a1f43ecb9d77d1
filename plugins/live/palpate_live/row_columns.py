"""Rows of the page, one for each instant: the columns of the samples and those of every track."""

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
RATE = 100.0  # [Hz] of the rows: a choice, more than a screen has points
UNUSABLE = int(Status.IDLE | Status.WAITING | Status.DIVERGED)

Table = NDArray[np.float32]


@dataclass(frozen=True)
class RowColumns:
    """The order of a row's columns: those of the samples (`COMMON`), then those of each track.

    A track has the values of its k parameters, their k standard uncertainties, and `PER_TRACK`.
    """

    tracks: Mapping[str, tuple[Parameter, ...]]

    @property
    def first_columns(self) -> dict[str, int]:
        """Index of the first column of each track."""
        first_columns, column = {}, len(COMMON)
        for track, parameters in self.tracks.items():
            first_columns[track] = column
            column += self.width(len(parameters))
        return first_columns

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(COMMON) + sum(self.width(len(parameters)) for parameters in self.tracks.values())

    @staticmethod
    def width(parameter_count: int) -> int:
        """Return the number of columns of a track."""
        return 2 * parameter_count + len(PER_TRACK)

    def sample_rows(self, samples: Samples, rows: NDArray[np.intp]) -> Table:
        """Return the rows (n, columns) of chosen samples (n,); the columns of estimates are NaN."""
        table = np.full((len(rows), self.count), np.nan, np.float32)
        table[:, 0] = samples.force[rows]
        table[:, 1] = samples.position[rows]
        table[:, 2:4] = samples.lateral[rows]
        table[:, 4] = samples.contact[rows]
        return table

    @staticmethod
    def track_rows(estimates: Estimates, rows: NDArray[np.intp], unmodelled: Floats) -> Table:
        """Return a track's columns (n, columns of the track) of chosen estimates (n,); NaN where they are not usable.

        Values (k), combined standard uncertainties (k), and `PER_TRACK` follow each other. `unmodelled` (k,) are the
        standard uncertainties of the parameters that the estimator does not know.
        """
        count = estimates.values.shape[1]
        table = np.empty((len(rows), RowColumns.width(count)), np.float32)
        with np.errstate(over="ignore", invalid="ignore"):  # estimates that diverge may be too large for a float32
            table[:, :count] = estimates.values[rows]
            table[:, count : 2 * count] = np.hypot(estimates.std[rows], unmodelled)
            for column, name in enumerate(PER_TRACK, 2 * count):
                table[:, column] = getattr(estimates, name)[rows]
        table[(estimates.status[rows] & UNUSABLE) != 0] = np.nan
        return table


def choose_rows(time: Floats, last_bin: float) -> tuple[NDArray[np.intp], float]:
    """Return the samples that become rows, the first of each hundredth of a second, and the hundredth of the last one.

    `time` (n,) [s] is that of the samples, `last_bin` the hundredth of the sample before.
    """
    bins = np.floor(time * RATE)
    previous_bins = np.empty(len(bins))
    previous_bins[0], previous_bins[1:] = last_bin, bins[:-1]
    return np.flatnonzero(bins > previous_bins), float(bins[-1])


def describe_run(run: Run, recorded: bool) -> dict[str, Any]:
    """Return the first message of a run: its name, its tracks with their columns, and the skin below it.

    A track's "begin" is the index of its first column. The skin is a grid over the `extent` of the run, where both a
    surface and the extent are known; lumps are those of the maps of a recorded run.
    """
    columns = RowColumns(run.tracks)
    first_columns = columns.first_columns
    tracks = []
    for track, parameters in run.tracks.items():
        described = [_describe_parameter(parameter) for parameter in parameters]
        tracks.append({"name": track, "begin": first_columns[track], "parameters": described})
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
        "tracks": tracks,
    }


def _describe_parameter(parameter: Parameter) -> dict[str, Any]:
    """Return name, display unit and its factor from SI."""
    unit, factor = display_unit(parameter.unit)
    return {"name": parameter.name, "unit": unit, "factor": factor}


def unmodelled_std(parameter: Mapping[str, Any]) -> float:
    """Return the standard uncertainty [SI] of a result's parameter that its estimator does not know; NaN if unknown."""
    if parameter["combined"] is None and parameter["std"] is not None:
        return math.nan
    return math.hypot(parameter["settling"] or 0.0, parameter.get("systematic") or 0.0)
