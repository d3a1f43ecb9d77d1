"""The picture of a motion before it is made."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.figures import figure_of, legend_outside, style

_BINS = 400  # of time; a motion of minutes is drawn by its least and largest value in each
_CLOSE = 2.0  # [s] of the motion that are drawn as they are
_STILL = 1e-3  # [m]; less is not a way across
_MEASURED = "#0072B2"


@style()
def plan_picture(
    time: Floats,
    position: Floats,
    velocity: Floats,
    measuring: NDArray[np.bool_],
    name: str,
) -> Any:
    """A motion before it is made: seen from above where it goes anywhere, height and speed, as a whole and close by."""
    across = bool(np.ptp(position[:, :2], axis=0).max() > _STILL)
    figure, axes = figure_of(2, 3 if across else 2, width=175.0, height=48.0)
    height, speed = 1e3 * position[:, 2], 1e3 * np.linalg.norm(velocity, axis=1)
    close = _close_by(time, measuring)
    *above, whole, near = axes
    for (left, right), values, word in ((whole, height, "height [mm]"), (near, speed, "speed [mm/s]")):
        _envelope(left, time, values, measuring)
        left.set(xlabel="time [s]", ylabel=word)
        right.plot(time[close], values[close], color="0.7", linestyle="-")
        right.plot(time[close], np.where(measuring, values, np.nan)[close], color=_MEASURED, linestyle="-")
        right.set(xlabel="time [s]", ylabel=word)
    for axis in whole:
        axis.axhline(0.0, color="black", linewidth=0.5)
    whole[0].set_title(f"{name}, as a whole")
    whole[1].set_title("close by")
    for row in above:
        _from_above(row, position, measuring)
    legend_outside(above[0][0] if across else near[0])
    return figure


def _close_by(time: Floats, measuring: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The first seconds that are measured, or of the whole motion."""
    begin = float(time[measuring][0]) if measuring.any() else float(time[0])
    return np.asarray((time >= begin) & (time <= begin + _CLOSE))


def _envelope(axis: Any, time: Floats, values: Floats, measuring: NDArray[np.bool_]) -> None:
    """Least and largest value over time; what is measured is darker."""
    for rows, colour, label in ((~measuring, "0.7", "on the way"), (measuring, _MEASURED, "measured")):
        if not rows.any():
            continue
        edges = np.linspace(time[0], time[-1], _BINS + 1)
        slot = np.clip(np.searchsorted(edges, time[rows], side="right") - 1, 0, _BINS - 1)
        low, high = np.full(_BINS, np.inf), np.full(_BINS, -np.inf)
        np.minimum.at(low, slot, values[rows])
        np.maximum.at(high, slot, values[rows])
        known = high >= low
        middle = 0.5 * (edges[1:] + edges[:-1])
        axis.fill_between(middle, low, high, where=known, color=colour, linewidth=0.8, label=label)


def _from_above(row: Any, position: Floats, measuring: NDArray[np.bool_]) -> None:
    """The way from above, and its sections along the longer side."""
    above, along = row
    x, y, z = 1e3 * position.T
    above.plot(x, y, color="0.7", linewidth=0.6, linestyle="-", label="on the way")
    above.plot(x[measuring], y[measuring], ".", color=_MEASURED, markersize=1.5, label="measured")
    above.plot(x[0], y[0], "o", color="black", markersize=3, label="begins")
    above.set(xlabel="x [mm]", ylabel="y [mm]")
    above.set_aspect("equal", adjustable="datalim")
    way, word = (x, "x [mm]") if np.ptp(x) >= np.ptp(y) else (y, "y [mm]")
    along.plot(way, z, color="0.7", linewidth=0.4, linestyle="-")
    along.plot(way[measuring], z[measuring], ".", color=_MEASURED, markersize=1)
    along.axhline(0.0, color="black", linewidth=0.5)
    along.set(xlabel=word, ylabel="height [mm]")
