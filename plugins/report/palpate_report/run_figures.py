"""Every picture of a run, in one style, each with the numbers that it is drawn from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.figures import figure_of, label_forces, legend_outside, quartiles, style

from palpate_report.estimates_figure import estimates
from palpate_report.exclusion import exclusion
from palpate_report.figure_data import Curves, swept, thin_rows
from palpate_report.figure_subject import MAX_POINTS, QUARTILE_OPACITY, ReportFigure, Subject, pair
from palpate_report.innovations_figure import innovations
from palpate_report.map_figure import draw_map

_CLOSE_UP = 4.0  # [s] of a long record whose force over time is drawn: a choice
_MAX_DRAWN = 3  # tracks of one panel: a choice, more bands hide each other
_MIN_LONG = 10.0  # close-ups in a record, from which on only one is drawn: a choice
_DEPTH_HEIGHT, _TIME_HEIGHT = 65.0, 50.0  # [mm] of the figures: choices
_TIME_BINS, _DEPTH_BINS = 40, 20  # of medians and quartiles: choices
_MARGIN, _FLAT_MARGIN = 0.08, 0.1  # of the range of the forces, and [N] where they have none: choices
_GREY = "0.6"


def force_depth(subject: Subject) -> ReportFigure | None:
    """Return a figure of the contact force over depth, measured and by the model of the main track.

    `subject` is a run with its tracks, one of which is the main one. Of a sweep, whose material changes, the last
    seconds. None without a track, or with too few samples.
    """
    if subject.main is None:
        return None
    curves = subject.curves(subject.main)
    rows = np.flatnonzero(curves.settled & np.isfinite(curves.force) & np.isfinite(curves.depth))
    if len(rows) < 2:
        return None
    rows = rows[curves.time[rows] >= curves.time[rows][-1] - _long(curves)]
    rows = rows[thin_rows(len(rows), MAX_POINTS)]
    depth, force, model = 1e3 * curves.depth[rows], curves.force[rows], curves.model[rows]
    figure, axes = figure_of(width=subject.width, height=_DEPTH_HEIGHT)
    axis = axes[0, 0]
    # The colours begin behind the grey points; sizes and widths of lines are in points.
    axis.plot(depth, force, ".", markersize=1.5, color=_GREY, label="measured")
    axis.set_prop_cycle(None)
    axis.plot(depth, model, linewidth=0.7, label=subject.main)
    axis.set(xlabel="depth [mm]", ylabel="contact force [N]")
    axis.set_ylim(_around(force))
    legend_outside(axis)
    caption = f"Contact force over depth: measured less the inertia of the tip, and the model of {subject.main}"
    return ReportFigure(figure, caption, {"depth_m": depth / 1e3, "force_N": force, f"{subject.main}:force_N": model})


def _long(curves: Curves) -> float:
    """Return how much of the end is drawn [s]: everything of a point, the last seconds of a sweep, whose material
    changes."""
    return _CLOSE_UP if swept(curves.place) else np.inf


def over_time(subject: Subject) -> ReportFigure | None:
    """Return a figure of the contact force over time, measured and by the models; of a long record the end of contact.

    `subject` is a run with its tracks, one of which is the main one. None without a track, or with fewer than two
    samples.
    """
    if subject.main is None:
        return None
    main = subject.curves(subject.main)
    rows = np.flatnonzero(np.isfinite(main.force))
    if len(rows) < 2:
        return None
    is_long = float(np.ptp(main.time[rows])) > _MIN_LONG * _CLOSE_UP
    if is_long:
        end = float(main.time[np.flatnonzero(main.used)[-1]]) if main.used.any() else float(main.time[rows][-1])
        rows = rows[(main.time[rows] <= end) & (main.time[rows] >= end - _CLOSE_UP)]
    rows = rows[thin_rows(len(rows), MAX_POINTS)]
    figure, axes = figure_of(width=subject.width, height=_TIME_HEIGHT)
    axis = axes[0, 0]
    axis.plot(main.time[rows], main.force[rows], ".", markersize=1.5, color=_GREY, label="measured")
    axis.set_prop_cycle(None)
    data = {"time_s": main.time[rows], "force_N": main.force[rows]}
    for name in subject.tracks[:_MAX_DRAWN]:
        curves = subject.curves(name)
        if not curves.used.any():
            continue
        model = np.where(curves.used, curves.model, np.nan)
        model_force = np.interp(main.time[rows], curves.time, model)
        axis.plot(main.time[rows], model_force, linewidth=0.8, label=name)
        data[f"{name}:force_N"] = model_force
    axis.set(xlabel="time [s]", ylabel="contact force [N]")
    axis.set_ylim(_around(main.force[rows]))
    legend_outside(axis, columns=4)
    caption = f"Contact force over time{f', the last {_CLOSE_UP:g} s of contact' if is_long else ''}"
    return ReportFigure(figure, caption, data)


def residuals(subject: Subject) -> ReportFigure | None:
    """Return a figure of the residual, measured less model, over time and over depth, by medians and quartiles.

    `subject` is a run with its tracks; curves are one track over time.
    """
    tracks = [subject.curves(name) for name in subject.tracks]
    tracks = [curves for curves in tracks if np.isfinite(curves.residual[curves.settled]).any()][:_MAX_DRAWN]
    if not tracks:
        return None
    figure, (time_axis, depth_axis) = pair(subject, 2)
    data: dict[str, Floats] = {}
    for curves in tracks:
        data |= _draw_quartiles(time_axis, curves, curves.time, 1.0, "time_s", _TIME_BINS)
        data |= _draw_quartiles(depth_axis, curves, curves.depth, 1e3, "depth_m", _DEPTH_BINS)
    for axis, label in ((time_axis, "time [s]"), (depth_axis, "depth [mm]")):
        axis.axhline(0.0, color="black", linewidth=0.5, linestyle="-")
        axis.set(xlabel=label)
        label_forces(axis, "measured less model")
    legend_outside(time_axis)
    caption = "Residual of the force: medians, and the band that contains the middle half"
    return ReportFigure(figure, caption, data)


def _draw_quartiles(
    axis: Any, curves: Curves, abscissa: Floats, scale: float, column: str, bins: int
) -> dict[str, Floats]:
    """Draw medians and quartiles of a track's residual over an abscissa (n,) [SI], and return them by column [SI].

    `scale` is how many of the axis' unit one of SI is; the columns are called after `column`, that of the abscissa, by
    its first letter: "residual_t_N" over time.
    """
    rows = curves.settled
    x, (low, median, high) = quartiles(abscissa[rows], curves.residual[rows], bins)
    (line,) = axis.plot(scale * x, median, label=curves.name)
    axis.fill_between(scale * x, low, high, color=line.get_color(), alpha=QUARTILE_OPACITY, linewidth=0)
    prefix, suffix = f"{curves.name}:", f"_{column[0]}_N"
    return {
        f"{prefix}{column}": x,
        f"{prefix}residual{suffix}": median,
        f"{prefix}low{suffix}": low,
        f"{prefix}high{suffix}": high,
    }


def _around(values: Floats) -> tuple[float, float]:
    low, high = np.nanmin(values), np.nanmax(values)
    margin = _MARGIN * (high - low) or _FLAT_MARGIN
    return float(low - margin), float(high + margin)


PICTURES: dict[str, Callable[[Subject], ReportFigure | None]] = {
    "force-depth": force_depth,
    "time": over_time,
    "residuals": residuals,
    "estimates": estimates,
    "innovations": innovations,
    "map": draw_map,
    "exclusion": exclusion,
}


@style()
def draw(name: str, subject: Subject) -> ReportFigure | None:
    """Return a picture by its name, in palpate's style; None where the run has nothing to show for it."""
    return PICTURES[name](subject)
