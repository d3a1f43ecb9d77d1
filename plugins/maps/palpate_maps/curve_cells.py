"""A map of curves on a grid: each cell is one curve, with its value as it was fitted and nothing between."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError
from palpate_engine import display_unit
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.figures import figure_of, style

from palpate_maps.map_grid import MERGE_DISTANCE

_PANEL_HEIGHT = 60.0  # [mm], a choice
_SCALE_SHARE = 0.8  # of a panel's height, a choice: the colour scale
_OFF_GRID = 0.25  # of a step by which a place may be off its cell: a stage's error, and not half a cell
_SAME_STEP = 1e-3  # of the extent: places that are nearer along an axis are in one line
_MAX_CELLS_PER_CURVE = 4  # cells for each curve: a place far from all others would make a map of nothing
_HALF_MILLIMETRE = 5e-4  # [m] of extent from which on axes are in mm


@dataclass(frozen=True)
class CurveCells:
    """Curves at the cells of a grid; rows go with y, columns with x; NaN where no curve has a value."""

    rows: Sequence[CurveRow]  # of the curves with a place
    cells: NDArray[np.intp]  # (n, 2) column and row of each
    x: Floats  # (nx,) [m]
    y: Floats  # (ny,) [m]
    parameter: str

    @property
    def extent(self) -> tuple[float, float]:
        """From the first to the last place along x and along y [m]."""
        return float(np.ptp(self.x)), float(np.ptp(self.y))

    @property
    def usable(self) -> list[bool]:
        """True for each curve that has a value."""
        return [not lack_of(row, self.parameter) for row in self.rows]

    def field(self, suffix: str = "") -> Floats:
        """Return (ny, nx) [SI] of the parameter, or of its uncertainty "_std" or "_combined"."""
        field = np.full((len(self.y), len(self.x)), np.nan)
        for row, (column, line), is_usable in zip(self.rows, self.cells, self.usable, strict=True):
            if is_usable:
                field[line, column] = row.number(f"{self.parameter}{suffix}") or np.nan
        return field

    @property
    def failures(self) -> dict[str, str]:
        """The reason for which a curve has no value, by its name."""
        lacks = ((row.curve, lack_of(row, self.parameter)) for row in self.rows)
        return {curve: lack for curve, lack in lacks if lack}


def lack_of(row: CurveRow, parameter: str) -> str:
    """Return why a curve has no value of a parameter; "" where it has one."""
    if row.rejected is not None:
        return f"rejected: {row.rejected}"
    verdict = row.verdict_of(parameter) or row.verdict
    if row.number(parameter) is not None and row.usable and verdict not in ("invalid", "not determined"):
        return ""
    return row.error or row.cells.get("findings", "") or verdict or "not fitted"


def read_curve_cells(
    path: Path, track: str | None = None, parameter: str | None = None, where: str | None = None
) -> CurveCells | None:
    """Return the curves of a folder of fits at their cells; None for places from 1 mm apart, which are interpolated.

    `where` is a filter of the curves by their columns. Raises LogError for nearer places that are not on a grid,
    ConfigurationError for filter words that do not parse.
    """
    folder = FitFolder(path)
    if not folder.tracks:
        raise LogError(f"{path}: no curve of it was fitted")
    chosen_track = track or folder.tracks[0]
    chosen_parameter = parameter or folder.values[0]
    rows, places = _placed_rows(folder, chosen_track, where)
    steps = [axis_step(places[:, 0]), axis_step(places[:, 1])]  # [m] of the grid in x and y; 0 along a single line
    widest = max(steps)
    if len(places) < 2 or widest == 0 or widest >= MERGE_DISTANCE:
        return None
    # A single line has cells as high as wide.
    cell_size = np.array([step or widest for step in steps])
    lowest = places.min(axis=0)
    cells = _grid_cells(places, lowest, cell_size)
    if cells is None:
        raise LogError(f"{path}: its curves are less than 1 mm apart and not on a grid, of which no map is made")
    column_count, line_count = cells.max(axis=0) + 1
    return CurveCells(
        rows=rows,
        cells=cells,
        x=lowest[0] + cell_size[0] * np.arange(column_count),
        y=lowest[1] + cell_size[1] * np.arange(line_count),
        parameter=chosen_parameter,
    )


def _placed_rows(folder: FitFolder, track: str, where: str | None) -> tuple[list[CurveRow], Floats]:
    """Return the curves of a track, and those that were not fitted, that have a place, and the places (n, 2) [m]."""
    rows, places = [], []
    for row in curve_filter(where, folder).choose(folder.rows):
        if row.track in (track, "") and row.place is not None:
            rows.append(row)
            places.append(row.place)
    return rows, np.array(places).reshape(-1, 2)


def _grid_cells(places: Floats, lowest: Floats, cell_size: Floats) -> NDArray[np.intp] | None:
    """Return column and line (n, 2) of places (n, 2) [m] in a grid from its lowest place on; None if they have no grid.

    They have none where a place is off its cell, where two have one cell, or where most cells would be empty.
    """
    cells = np.rint((places - lowest) / cell_size).astype(np.intp)
    # A place is off its cell by a share of the cell's size.
    offset = np.abs(lowest + cells * cell_size - places) / cell_size
    cell_count = (cells.max(axis=0) + 1).prod()
    is_off_grid = offset.max() > _OFF_GRID
    has_shared_cell = len({*map(tuple, cells)}) < len(cells)
    is_sparse = cell_count > _MAX_CELLS_PER_CURVE * len(cells)
    return None if is_off_grid or has_shared_cell or is_sparse else cells


def axis_step(values: Floats) -> float:
    """Return the usual step [m] from one line of places (n,) [m] to the next; 0 for a single line."""
    ordered = np.sort(values)
    gaps = np.diff(ordered)
    extent = ordered[-1] - ordered[0] if len(ordered) else 0.0
    lines = gaps[gaps > _SAME_STEP * extent] if extent > 0 else gaps[:0]
    return float(np.median(lines)) if len(lines) else 0.0


def cells_csv(cells: CurveCells) -> str:
    """Return a row for each curve: place, value with its uncertainties, and why it has none."""
    name = cells.parameter
    lines = [f"x_m,y_m,{name},{name}_std,{name}_combined,curve,without"]
    for row, (column, line), is_usable in zip(cells.rows, cells.cells, cells.usable, strict=True):
        numbers = [row.number(f"{name}{suffix}") if is_usable else None for suffix in ("", "_std", "_combined")]
        texts = ["" if number is None else f"{number:.6g}" for number in numbers]
        labels = [_quoted(row.curve), _quoted(lack_of(row, name))]
        lines.append(",".join([f"{cells.x[column]:.9g}", f"{cells.y[line]:.9g}", *texts, *labels]))
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return f'"{text.replace(chr(34), chr(34) * 2)}"' if {*text} & {*',"\n'} else text


def cells_npz(cells: CurveCells) -> bytes:
    """Return the arrays x, y, value, std, combined, and the parameter's name."""
    file = io.BytesIO()
    suffixes = {"value": "", "std": "_std", "combined": "_combined"}
    fields = {key: cells.field(suffix) for key, suffix in suffixes.items()}
    np.savez_compressed(file, x=cells.x, y=cells.y, **fields, parameter=np.array(cells.parameter))  # type: ignore[arg-type]
    return file.getvalue()


def length_unit(extent: float) -> tuple[str, float]:
    """Return the unit of a map's axes, and how many of it one metre is."""
    return ("mm", 1e3) if extent > _HALF_MILLIMETRE else ("um", 1e6)


@style()
def cells_picture(cells: CurveCells, unit: str) -> Any:
    """Draw value and relative uncertainty side by side, a cell for each curve; a cross is one without a value.

    `unit` is the SI unit of the value.
    """
    figure, axes = figure_of(2, height=_PANEL_HEIGHT)
    length, per_metre = length_unit(max(cells.extent))
    edges = _outer_edges(cells, per_metre)
    # Value [display unit] and uncertainty [%], each with its colours.
    name, factor = display_unit(unit)
    value = cells.field()
    relative_std = 100 * cells.field("_combined") / np.abs(value)
    panels = [
        (value * factor, f"{cells.parameter} [{name}]", "viridis"),
        (relative_std, "uncertainty [%]", "magma"),
    ]
    for axis, (field, title, colours) in zip(axes[0], panels, strict=True):
        image = axis.imshow(field, origin="lower", extent=edges, cmap=colours, aspect="equal", interpolation="nearest")
        figure.colorbar(image, ax=axis, shrink=_SCALE_SHARE)
        _mark_empty_cells(axis, cells, per_metre)
        axis.set(title=title, xlabel=f"x [{length}]", ylabel=f"y [{length}]")
        axis.grid(False)
    return figure


def _outer_edges(cells: CurveCells, per_metre: float) -> list[float]:
    """Return left, right, bottom and top of the cells [unit of the axes]; a single line is as high as wide."""
    steps = [np.diff(places)[0] if len(places) > 1 else 0.0 for places in (cells.x, cells.y)]
    edges = []
    for places, step in zip((cells.x, cells.y), steps, strict=True):
        half_cell = per_metre * (step or max(steps)) / 2
        edges += [per_metre * places[0] - half_cell, per_metre * places[-1] + half_cell]
    return edges


def _mark_empty_cells(axis: Any, cells: CurveCells, per_metre: float) -> None:
    """Draw a cross at each curve without a value."""
    for (column, line), is_usable in zip(cells.cells, cells.usable, strict=True):
        if not is_usable:
            axis.plot(per_metre * cells.x[column], per_metre * cells.y[line], "x", color="0.5", markersize=4)
