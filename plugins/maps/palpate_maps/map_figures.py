"""Pictures of sweeps, maps and plans, drawn without a screen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, legend_outside, style
from palpate_kit.runs.exclusion_figure import draw_exclusion
from palpate_kit.runs.lump_marks import CROSS, label_lump, mark_lumps

from palpate_maps.grid_cells import Cells, grid_steps
from palpate_maps.hidden_patches import EXPECTED, Hiding
from palpate_maps.lump_criteria import Findings, Lump
from palpate_maps.map_files import exclusion_table
from palpate_maps.map_grid import StiffnessMap
from palpate_maps.sites import Sites

_AREA_HEIGHT = 60.0  # [mm] of a panel seen from above, a choice
_CURVE_HEIGHT = 70.0  # [mm] of a panel with a legend or labels of two lines, a choice
_SCALE_SHARE = 0.8  # of a panel's height, a choice: the colour scale
_PLOT_HEIGHT = 0.8  # of a picture's height, between the title and the label of the x axis
_SCALE_WIDTH = 0.5  # of a picture's height: a scale with its label, and the label of the y axis
_CURVE_WIDTH = 0.8  # of a picture's height: the curve of what is excluded, with its labels
_SWEEP_RATIOS = (3, 1)  # of the widths of a sweep and of the curve of what it excludes
_LONE_CELL = 1.0  # [mm] of a map of one row or column: the default cell
_SQUARE_CENTIMETRE = 100  # [mm^2]
_MAX_DENSITY = 100.0  # [% per cm^2] of the colour scale: one patch; more would hide where a patch is likely
_HALF_CELL = 5e-4  # [m] of a map of one row or column: half of the default cell


@style()
def map_picture(
    field: StiffnessMap, label: str, unit: str, findings: Findings | None, outlines: Sequence[Floats]
) -> Any:
    """Draw value and relative standard deviation side by side, with sites, lumps, and outlines if they are known.

    `field` is the map on its grid, `label` and SI `unit` are the parameter's.
    Next to them are the lumps that the exam excludes.
    A red line surrounds what is significantly stiffer than the baseline.
    """
    excluded = exclusion_table(findings) if findings is not None else []
    figure, axes = figure_of(3 if excluded else 2, height=_AREA_HEIGHT)
    name, factor = display_unit(unit)  # the unit that is shown, and its number per SI unit
    extent = [1e3 * edge for edge in (*_edges(field.x), *_edges(field.y))]  # [mm]
    panels = [
        (field.value * factor, f"{label} [{name}]", "viridis"),
        (100 * field.std / field.value, "standard deviation [%]", "magma"),
    ]
    lumps = findings.lumps if findings is not None else ()
    # Both panels have the same places over their colours; lumps have their number in the first alone.
    for axis, (values, title, colours) in zip(axes[0], panels, strict=False):
        image = axis.imshow(values, origin="lower", extent=extent, cmap=colours, aspect="equal")
        figure.colorbar(image, ax=axis, shrink=_SCALE_SHARE)
        _draw_sites(axis, field)
        axis.set(title=title, xlabel="x [mm]", ylabel="y [mm]", xlim=extent[:2], ylim=extent[2:])
        for outline in outlines:
            axis.plot(*(1e3 * outline.T), "--", color="white", linewidth=0.8)
        for lump in lumps:
            axis.plot(1e3 * lump.place[0], 1e3 * lump.place[1], "+", **CROSS)
        axis.grid(False)
    mark_lumps(axes[0, 0], [(1e3 * lump.place[0], 1e3 * lump.place[1], lump.p) for lump in lumps])
    if excluded:
        draw_exclusion(axes[0, 2], excluded)
    return figure


def _draw_sites(axis: Any, field: StiffnessMap) -> None:
    """Draw the sites as dots, and a red line around what is significantly stiffer than the baseline."""
    axis.plot(*(1e3 * field.sites.T), ".", color="white", markersize=0.7, alpha=0.35)
    # A contour needs two rows and two columns at least; the level 0.5 is between False and True.
    if field.stiff.any() and min(field.stiff.shape) > 1:
        axis.contour(1e3 * field.x, 1e3 * field.y, field.stiff, [0.5], colors="red", linewidths=0.8)


@style()
def hiding_picture(
    hiding: Hiding, cells: Cells, lumps: Sequence[Lump], excluded: Sequence[Mapping[str, float | None]] = ()
) -> Any:
    """Draw the expected number of hidden patches per square centimetre, the known lumps, and the lumps excluded.

    `cells` has the column and row (m, 2) of each place at which a patch may hide.
    """
    figure, axes = figure_of(2 if excluded else 1, height=_CURVE_HEIGHT)
    axis = axes[0, 0]
    field, extent = _patch_density(hiding, cells)
    # The scale goes up to what was expected beforehand, at least: a cleared area is dark.
    area = np.isfinite(field).mean() * (extent[1] - extent[0]) * (extent[3] - extent[2]) / _SQUARE_CENTIMETRE
    prior = 100 * EXPECTED / area
    highest = max(min(prior, _MAX_DENSITY), float(np.nanmax(field)))
    image = axis.imshow(field, origin="lower", extent=extent, cmap="magma", aspect="equal", vmin=0.0, vmax=highest)

    # The figure is as wide as the area and its colour scale, and the curve of what is excluded.
    area_width = _PLOT_HEIGHT * (extent[1] - extent[0]) / (extent[3] - extent[2]) + _SCALE_WIDTH
    curve_width = _CURVE_WIDTH if excluded else 0.0
    figure.set_figwidth(min(figure.get_figwidth(), figure.get_figheight() * (area_width + curve_width)))
    if excluded:
        axis.get_gridspec().set_width_ratios((area_width, curve_width))
        draw_exclusion(axes[0, 1], excluded)

    is_tilted = hiding.middles.shape[1] > 2
    view = "seen from above; " if is_tilted else ""
    scale_label = f"patches expected [% per cm²]\n{view}{prior:.2g} beforehand"
    figure.colorbar(image, ax=axis, shrink=_SCALE_SHARE, label=scale_label)
    for lump in lumps:
        axis.plot(1e3 * lump.place[0], 1e3 * lump.place[1], "+", **CROSS)
    axis.set(title=f"a patch remains with {hiding.risk_text}", xlabel="x [mm]", ylabel="y [mm]")
    axis.grid(False)
    return figure


def _patch_density(hiding: Hiding, cells: Cells) -> tuple[Floats, list[float]]:
    """Return the expected patches (rows, columns) [% per cm^2], at most 100, and their extent in x and y [mm].

    `cells` has column and row (m, 2) of each place in the grid that it was chosen from. The cell of a place is as wide
    as the least distance between two columns that have places: n steps of the grid where every n-th one has. The pixels
    are the greatest common divisor of all distances, so that each cell lies about its place and is made of whole
    pixels; pixels outside all cells are NaN.
    """
    # Sizes of pixels and of cells in x and y, in steps of the grid.
    pixel_steps, cell_steps = np.ones(2, int), np.ones(2, int)
    for axis, indices in enumerate(cells.T):
        gaps = np.diff(np.unique(indices))
        if len(gaps):
            pixel_steps[axis] = np.gcd.reduce(gaps)
            cell_steps[axis] = gaps.min()
    # Patches per area of a cell.
    places = 1e3 * hiding.middles[:, :2]  # [mm]
    steps = grid_steps(places, cells)
    cell_size = np.where(np.isfinite(steps), steps * cell_steps, _LONE_CELL)
    cell_area = cell_size[0] * cell_size[1] / _SQUARE_CENTIMETRE
    density = np.minimum(100 * hiding.expected / cell_area, _MAX_DENSITY)
    # The pixels of each cell, from its first column and row on.
    columns, rows = ((cells - cells.min(axis=0)) // pixel_steps).T
    columns_in_cell, rows_in_cell = cell_steps // pixel_steps
    field = np.full((rows.max() + rows_in_cell, columns.max() + columns_in_cell), np.nan)
    for row, column in np.ndindex(rows_in_cell, columns_in_cell):
        field[rows + row, columns + column] = density
    x_low, y_low = places.min(axis=0) - cell_size / 2
    x_high, y_high = places.max(axis=0) + cell_size / 2
    return field, [x_low, x_high, y_low, y_high]


def _edges(axis: Floats) -> tuple[float, float]:
    """Return the outer edges [m] of cells at places (n,) [m] of an axis."""
    half = (axis[1] - axis[0]) / 2 if len(axis) > 1 else _HALF_CELL
    return float(axis[0] - half), float(axis[-1] + half)


@style()
def sweep_picture(
    series: Mapping[str, tuple[Floats, Sites]],
    label: str,
    unit: str,
    findings: Findings | None,
    points: tuple[Floats, Sites] | None = None,
) -> Any:
    """Draw estimates of tracks along a sweep, with two standard deviations, lumps, and point palpations.

    `series` has coordinate (n,) [m] and sites of each track, `points` those of the point palpations. Next to them are
    the lumps that the sweep excludes.
    """
    excluded = exclusion_table(findings) if findings is not None else []
    figure, axes = figure_of(2 if excluded else 1, height=_CURVE_HEIGHT)
    axis = axes[0, 0]
    # What is excluded has a narrower panel of its own.
    if excluded:
        axis.get_gridspec().set_width_ratios(_SWEEP_RATIOS)
        draw_exclusion(axes[0, 1], excluded)
    name, factor = display_unit(unit)
    for track, (along, sites) in series.items():
        _draw_curve(axis, track, along, sites, factor)
    if points is not None:
        along, palpations = points
        value = palpations.value * factor
        bars = 2 * value * palpations.std  # two standard deviations
        axis.errorbar(1e3 * along, value, bars, fmt="ko", markersize=4, capsize=2, label="points")
    axis.set(xlabel="along the sweep [mm]", ylabel=f"{label} [{name}]")
    axis.set_ylim(common_limits([sites.value * factor for _, sites in series.values()], 0.0))
    # A lump has a place along the sweep where it was sought along one.
    if findings is not None and findings.coordinate is not None and findings.curve is not None:
        for number, lump in enumerate(findings.lumps, 1):
            _mark_on_curve(axis, number, lump)
    legend_outside(axis)
    return figure


def _draw_curve(axis: Any, track: str, along: Floats, sites: Sites, factor: float) -> None:
    """Draw sites along (n,) [m] a sweep as a line, their values times a factor, with two standard deviations."""
    order = np.argsort(along)
    coordinate = 1e3 * along[order]
    value = sites.value[order] * factor
    (line,) = axis.plot(coordinate, value, label=track)
    band = 2 * value * sites.std[order]
    axis.fill_between(coordinate, value - band, value + band, color=line.get_color(), alpha=0.15, linewidth=0)


def _mark_on_curve(axis: Any, number: int, lump: Lump) -> None:
    """Shade the stretch of a lump along the sweep, with its number in the table of lumps and its p at the bottom."""
    coordinate, half = 1e3 * lump.along, 1e3 * lump.extent[0] / 2
    axis.axvspan(coordinate - half, coordinate + half, color="red", alpha=0.1, linewidth=0)
    axis.axvline(coordinate, color="red", linewidth=0.8)
    label_lump(axis, number, (coordinate, axis.get_ylim()[0]), lump.p)
