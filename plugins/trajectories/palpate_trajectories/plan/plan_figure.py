"""The figure of a planned motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.figures import figure_of, legend_outside, style

_MM = 1e3  # per metre
_ROW_HEIGHT = 48.0  # [mm], a choice
_GREY = "0.7"  # of the way, a choice: behind what is measured
_BINS = 400  # of time, a choice: a motion of minutes is drawn by its least and largest value in each
_DETAIL = 2.0  # [s], a choice: stretch that is drawn sample by sample
_MIN_TRAVEL = 1e-3  # [m], a choice: a motion with less is not drawn from above
_MEASURED = "#0072B2"  # blue of the Okabe-Ito palette


@style()
def plan_picture(
    time: Floats,
    position: Floats,
    velocity: Floats,
    measuring: NDArray[np.bool_],
    name: str,
) -> Any:
    """Return the figure of a planned motion: from above if it travels, height and speed, as a whole and in detail.

    At times (n,) [s]: position and velocity (n, 3) [m, m/s], and True where the samples are to be estimated from.
    """
    travels = bool(np.ptp(position[:, :2], axis=0).max() > _MIN_TRAVEL)
    figure, axes = figure_of(2, 3 if travels else 2, height=_ROW_HEIGHT)
    # A row of two axes each: from above where it travels, then height and speed, as a whole and in detail.
    *path_rows, height_row, speed_row = axes
    for row in path_rows:
        _from_above(row, position, measuring)
    detail = _detail_rows(time, measuring)
    _over_time(height_row, time, values=_MM * position[:, 2], measuring=measuring, detail=detail, label="height [mm]")
    _over_time(
        speed_row,
        time,
        values=_MM * np.linalg.norm(velocity, axis=1),
        measuring=measuring,
        detail=detail,
        label="speed [mm/s]",
    )
    # The nominal surface, a thin line.
    for axis in height_row:
        axis.axhline(0.0, color="black", linewidth=0.5)
    height_row[0].set_title(f"{name}, as a whole")
    height_row[1].set_title("close by")
    legend_outside(axes[0][0] if travels else speed_row[0])
    return figure


def _over_time(
    row: Any, time: Floats, values: Floats, measuring: NDArray[np.bool_], detail: NDArray[np.bool_], label: str
) -> None:
    """Draw a quantity (n,) over the whole time (n,) [s], and its rows of the detail sample by sample."""
    whole, close = row
    _envelope(whole, time, values, measuring)
    close.plot(time[detail], values[detail], color=_GREY, linestyle="-")
    close.plot(time[detail], np.where(measuring, values, np.nan)[detail], color=_MEASURED, linestyle="-")
    for axis in row:
        axis.set(xlabel="time [s]", ylabel=label)


def _detail_rows(time: Floats, measuring: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the rows of the first seconds that are measured, or of the whole motion."""
    begin = float(time[measuring][0]) if measuring.any() else float(time[0])
    return np.asarray((time >= begin) & (time <= begin + _DETAIL))


def _envelope(axis: Any, time: Floats, values: Floats, measuring: NDArray[np.bool_]) -> None:
    """Draw least and largest value over time; the measured part is darker."""
    for rows, colour, label in ((~measuring, _GREY, "on the way"), (measuring, _MEASURED, "measured")):
        if not rows.any():
            continue
        # The slot of time of each row, and the extremes of each slot.
        edges = np.linspace(time[0], time[-1], _BINS + 1)
        slot = np.clip(np.searchsorted(edges, time[rows], side="right") - 1, 0, _BINS - 1)
        low, high = np.full(_BINS, np.inf), np.full(_BINS, -np.inf)
        np.minimum.at(low, slot, values[rows])
        np.maximum.at(high, slot, values[rows])
        has_values = high >= low
        middle = 0.5 * (edges[1:] + edges[:-1])
        axis.fill_between(middle, low, high, where=has_values, color=colour, linewidth=0.8, label=label)


def _from_above(row: Any, position: Floats, measuring: NDArray[np.bool_]) -> None:
    """Draw the path from above, and its height along the longer side; sizes of lines and dots are points, choices."""
    above, along = row
    x, y, z = _MM * position.T
    above.plot(x, y, color=_GREY, linewidth=0.6, linestyle="-", label="on the way")
    above.plot(x[measuring], y[measuring], ".", color=_MEASURED, markersize=1.5, label="measured")
    above.plot(x[0], y[0], "o", color="black", markersize=3, label="begins")
    above.set(xlabel="x [mm]", ylabel="y [mm]")
    above.set_aspect("equal", adjustable="datalim")
    if np.ptp(x) >= np.ptp(y):
        coordinate, label = x, "x [mm]"
    else:
        coordinate, label = y, "y [mm]"
    along.plot(coordinate, z, color=_GREY, linewidth=0.4, linestyle="-")
    along.plot(coordinate[measuring], z[measuring], ".", color=_MEASURED, markersize=1)
    along.axhline(0.0, color="black", linewidth=0.5)
    along.set(xlabel=label, ylabel="height [mm]")
