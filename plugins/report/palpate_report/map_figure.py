"""The map of a run that moves over the material: along a line or over an area, with the lumps that were found."""

from __future__ import annotations

import numpy as np
from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.figures import WIDTHS, common_limits, figure_of, legend_outside
from palpate_kit.runs.lump_marks import mark_lumps
from palpate_kit.runs.skin_grid import read_lumps
from palpate_kit.runs.surface_map_figure import surface_map_figure
from palpate_kit.runs.surface_map_file import SurfaceMap

from palpate_report.figure_data import Curves, along, moving_samples, swept, thin_rows
from palpate_report.figure_subject import BAND_OPACITY, MAX_POINTS, MAX_TRACKS, ReportFigure, Subject
from palpate_report.run_map import grid_of, surface_map_of

_LINE_HEIGHT, _AREA_HEIGHT = 60.0, 75.0  # [mm] of the figures: choices
_COLOUR_QUANTILES = [0.01, 0.99]  # of the values, between which the colours run: a choice, for single outliers


def draw_map(subject: Subject) -> ReportFigure | None:
    """Return the map of the main track: along a line, or over an area; lumps where `palpate map lumps` has found some.

    `subject` is a run with its tracks. None where the tip stayed at one place.
    """
    if subject.main is None or not swept(subject.curves(subject.main).place):
        return None
    main = subject.curves(subject.main)
    parameter = next(iter(main.values))
    symbol, factor = display_unit(subject.record.unit(subject.main, parameter))
    label = f"{parameter.replace('_', ' ')} [{symbol}]"
    if along(main.place) is not None:
        return _line(subject, parameter, label, factor)
    on_surface = surface_map_of(subject.record, parameter)
    if on_surface is not None:
        return _from_three_sides(subject, on_surface)
    return _area(subject, main, parameter, label, factor)


def _line(subject: Subject, parameter: str, label: str, factor: float) -> ReportFigure:
    """Return the figure of a parameter along the line of a sweep, of all tracks that have it, where the tip moves.

    `factor` is how many of the label's unit one SI unit is.
    """
    figure, axes = figure_of(width=subject.width, height=_LINE_HEIGHT)
    axis, settled, data = axes[0, 0], [], dict[str, Floats]()
    # A track is its table, and its columns.
    names = [name for name in subject.tracks if parameter in subject.record.tracks[name][1].values]
    for name in names[:MAX_TRACKS]:
        curves = subject.curves(name)
        coordinate = along(curves.place)
        if coordinate is None:
            continue
        rows = np.flatnonzero(curves.settled & np.isfinite(coordinate))
        rows = rows[moving_samples(curves.time[rows], coordinate[rows])]
        rows = rows[thin_rows(len(rows), MAX_POINTS // 2)]
        position, value, std = (
            1e3 * coordinate[rows],
            factor * curves.values[parameter][rows],
            factor * curves.std[parameter][rows],
        )
        (line,) = axis.plot(position, value, label=name)
        axis.fill_between(
            position, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=BAND_OPACITY, linewidth=0
        )
        settled.append(value)
        data |= {
            f"{name}:along_m": position / 1e3,
            f"{name}:{parameter}": value / factor,
            f"{name}:{parameter}_std": std / factor,
        }
    axis.set(xlabel="along the path [mm]", ylabel=label)
    axis.set_ylim(common_limits(settled, settled_from=0.0))
    legend_outside(axis, columns=4)
    return ReportFigure(
        figure, "Estimates along the path, with bands of two standard deviations by the estimator", data
    )


def _from_three_sides(subject: Subject, on_surface: SurfaceMap) -> ReportFigure:
    lumps = [
        (lump["x"], lump["y"], lump["z"], lump["p"]) for lump in read_lumps(subject.record.folder.maps) if "z" in lump
    ]
    names = ("x_m", "y_m", "z_m", on_surface.parameter, f"{on_surface.parameter}_std", "p")
    columns = (*on_surface.vertices.T, on_surface.value, on_surface.std, on_surface.p)
    caption = "The map of palpate map on the surface, interpolated between the places; a cross is the middle of a lump"
    figure = surface_map_figure(on_surface, lumps=lumps, width=subject.width)
    return ReportFigure(figure, caption, dict(zip(names, columns, strict=True)))


def _area(subject: Subject, main: Curves, parameter: str, label: str, factor: float) -> ReportFigure:
    """Return the figure of a parameter of the main track over the area of a run, with the lumps that were found."""
    grid = grid_of(subject.record, main, parameter)
    figure, axes = figure_of(width=min(subject.width, WIDTHS["middle"]), height=_AREA_HEIGHT)
    axis = axes[0, 0]
    low, high = np.nanquantile(grid.value, _COLOUR_QUANTILES) * factor
    extent = [1e3 * edge for edge in grid.extent]  # [mm] left, right, bottom, top
    shown = axis.imshow(
        factor * grid.value, origin="lower", extent=extent, vmin=low, vmax=high, interpolation="nearest"
    )
    figure.colorbar(shown, ax=axis, shrink=0.8, label=label)
    axis.grid(False)
    lumps = read_lumps(subject.record.folder.maps)
    mark_lumps(axis, [(1e3 * lump["x"], 1e3 * lump["y"], lump["p"]) for lump in lumps])
    axis.set(xlabel="x [mm]", ylabel="y [mm]")
    x, y = np.meshgrid(grid.x, grid.y)
    return ReportFigure(figure, grid.caption, {"x_m": x.ravel(), "y_m": y.ravel(), parameter: grid.value.ravel()})
