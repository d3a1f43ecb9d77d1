"""The map of a run on a grid: as `palpate map` has made it, or the estimates at their places."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from palpate import Floats
from palpate_kit.runs.surface_map_file import SurfaceMap, read_surface_map

from palpate_report.figure_data import Curves
from palpate_report.run_contents import RunContents

_MAX_CELLS = 60  # of the longer side of a map: a choice
_HALF_CELL = 5e-4  # [m] of a map with a single row or column: a choice


@dataclass(frozen=True)
class Grid:
    """Values (rows, columns) by y and x [SI], NaN where nothing is known."""

    x: Floats  # [m]
    y: Floats  # [m]
    value: Floats
    caption: str

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Edges [m]: left, right, bottom, top."""
        half = [0.5 * (axis[1] - axis[0]) if len(axis) > 1 else _HALF_CELL for axis in (self.x, self.y)]
        return (
            float(self.x[0] - half[0]),
            float(self.x[-1] + half[0]),
            float(self.y[0] - half[1]),
            float(self.y[-1] + half[1]),
        )


def surface_map_of(record: RunContents, parameter: str) -> SurfaceMap | None:
    """Return the newest map of `palpate map` where that is on a surface, and of a parameter; else None."""
    for path in _newest_first(record.folder.maps)[:1]:
        if path.with_suffix(".ply").is_file():
            surface_map = read_surface_map(path.with_suffix(".ply"))
            return surface_map if surface_map.parameter == parameter else None
    return None


def grid_of(record: RunContents, curves: Curves, parameter: str) -> Grid:
    """Return the newest map of `palpate map`, else the latest estimate in each cell that the tip came through."""
    maps = (_interpolated(path, parameter) for path in _newest_first(record.folder.maps))
    return next((grid for grid in maps if grid is not None), None) or _visited(curves, parameter)


def _newest_first(folder: Path) -> list[Path]:
    """Return the tables of maps, map-10 before map-2 before map."""
    named = {path: re.fullmatch(r"map(?:-(\d+))?", path.stem) for path in folder.glob("map*.csv")}
    numbers = {path: int(match[1] or 1) for path, match in named.items() if match}
    return sorted(numbers, key=numbers.__getitem__, reverse=True)


def _interpolated(path: Path, parameter: str) -> Grid | None:
    """Return the grid in a table of `palpate map`, a row for each place; None if it is not one of the parameter."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        column = next(name for name in rows[0] if name.startswith(parameter))
        table = np.array([[float(row[key] or "nan") for key in ("x_m", "y_m", column)] for row in rows])
    except (OSError, ValueError, KeyError, IndexError, StopIteration):
        return None
    x, y = np.unique(table[:, 0]), np.unique(table[:, 1])
    value = np.full((len(y), len(x)), np.nan)
    value[np.searchsorted(y, table[:, 1]), np.searchsorted(x, table[:, 0])] = table[:, 2]
    return Grid(
        x, y, value, f"{path.name} of palpate map, interpolated between the places; a cross marks the middle of a lump"
    )


def _visited(curves: Curves, parameter: str) -> Grid:
    """Return the latest estimate of a parameter in each cell of a grid of at most 60 cells a side."""
    rows = np.flatnonzero(curves.settled & np.isfinite(curves.place).all(axis=1))
    place, values = curves.place[rows], curves.values[parameter][rows]
    low, high = place.min(axis=0), place.max(axis=0)
    cell = float((high - low).max()) / _MAX_CELLS
    # The nearest grid point of each place.
    columns, lines = (np.floor((place - low) / cell + 0.5).astype(int)).T
    value = np.full((lines.max() + 1, columns.max() + 1), np.nan)
    value[lines, columns] = values  # in the order of time: the latest stays
    x, y = low[0] + cell * np.arange(value.shape[1]), low[1] + cell * np.arange(value.shape[0])
    return Grid(
        x, y, value, "The latest estimate at each place; palpate map interpolates, palpate map lumps looks for lumps"
    )
