"""Figures of a bench: estimates over time of all tracks of a scene, and error against cost; for a column and a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Estimates, Floats, Status
from palpate_engine import Pipeline, RecordOutcome, RecordTracks, display_unit
from palpate_kit.comparison.record_rows import Row, truth_along
from palpate_kit.figures import figure_of, save_figure, style
from palpate_kit.terminal.result_table import SYMBOLS, chief_names

WIDTHS = (85.0, 170.0)  # [mm] of a column and of a page
_FORMATS = ("pdf", "svg")
_MARKERS = "osv^D<>Phd"  # tracks have a marker and a line of their own, so that colours are not needed
_LINES = ("-", "--", "-.", ":")
_COLOURS = 7  # of the style
_INCH = 25.4  # [mm]
# Choices.
_MAX_POINTS = 400  # of a curve, about: more than a column of print resolves
_BAND_SIGMAS = 2.0  # standard deviations
_VALUE_QUANTILES = (0.02, 0.98)  # of settled values, which the axis shows
_VALUE_MARGIN = 0.15  # of their range, above and below
_TINY_MARGIN = 1e-9  # keeps the range above 0
_NARROW = 100.0  # [mm] of a figure, below which it is that of a column of print
_NARROW_COLUMNS, _WIDE_COLUMNS = 2, 4  # of panels, and of names in a legend
_ERROR_HEIGHT, _ESTIMATE_HEIGHT = 38.0, 60.0  # [mm] of a row of panels
_LEGEND_LINE = 4.5  # [mm]
_MAX_FINE_RATIO = 30.0  # of the highest to the lowest error, up to which the axis has ticks at 1, 2 and 5, else at 1


@style()
def draw_errors(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write error against cost of a sample, a marker for each track and a panel for each scene; return the files."""
    paths = []
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    tracks = list(dict.fromkeys(row["track"] for row in rows if row["track"]))
    for width in WIDTHS:
        columns = min(_NARROW_COLUMNS if width < _NARROW else _WIDE_COLUMNS, len(scenes))
        panel_rows = -(-len(scenes) // columns)  # rounded up
        figure, axes = figure_of(columns, panel_rows, width=width, height=_ERROR_HEIGHT)
        for axis, scene in zip(axes.ravel(), scenes, strict=False):
            _draw_scene(axis, scene, [row for row in rows if row["scene"] == scene], tracks)
        for axis in axes.ravel()[len(scenes) :]:
            axis.set_axis_off()
        axes.ravel()[len(scenes) - 1].set_xlabel("cost of a sample [us]")
        figure.supylabel("error [%]", fontsize="medium")
        _legend_below(figure, axes.ravel()[0])
        paths += _save(figure, folder / f"errors-{width:g}mm")
    return paths


def _draw_scene(axis: Any, scene: str, rows: Sequence[Row], tracks: Sequence[str]) -> None:
    """Draw error over cost of each track in one scene, whose rows are given: a point for a track.

    The error is that of the first value, or that of the predicted force if no value has one.
    """
    from matplotlib.ticker import LogLocator

    name = next((key for row in rows for key in row if key.endswith("_error")), "prediction")
    for index, track in enumerate(tracks):
        row = next((candidate for candidate in rows if candidate["track"] == track), {})
        error, cost = row.get(name), row.get("seconds_per_sample")
        x, y = np.nan, np.nan  # a track without a point is in the legend all the same
        if error and cost:
            x, y = 1e6 * cost, 100 * error  # [us], [%]
        marker, colour = _MARKERS[index % len(_MARKERS)], f"C{index % _COLOURS}"
        axis.loglog([x], [y], marker, color=colour, label=track, markersize=4)
    # Plain numbers at the ticks: mathematical text is off in the style.
    for scale in (axis.xaxis, axis.yaxis):
        scale.set_major_formatter(lambda number, _: f"{number:g}")
        scale.set_minor_formatter(lambda number, _: "")
    low, high = axis.get_ylim()
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _MAX_FINE_RATIO * low else (1.0,)))
    value = "force" if name == "prediction" else name.removesuffix("_error")
    axis.set_title(f"{scene}, {SYMBOLS.get(value, value)}", fontsize="medium")


@style()
def draw_estimates(pipeline: Pipeline, folder: Path) -> list[Path]:
    """Write the estimates over time of all tracks of a record, with bands of 2 std and the truth; return the files."""
    # Diagnoses and summaries, which a picture does not show, take most of the time.
    without_diagnoses = replace(pipeline, registry=replace(pipeline.registry, diagnoses={}, summaries={}))
    outcome = RecordTracks(without_diagnoses, compares=True).estimate()
    paths = []
    for width in WIDTHS:
        names = chief_names(parameter.name for track in pipeline.tracks for parameter in track.model.parameters)
        columns = 1 if width < _NARROW else len(names)
        panel_rows = -(-len(names) // columns)  # rounded up
        figure, axes = figure_of(columns, panel_rows, width=width, height=_ESTIMATE_HEIGHT)
        for axis, name in zip(axes.ravel(), names, strict=True):
            _draw_value(axis, outcome, name)
        _legend_below(figure, axes.ravel()[0])
        paths += _save(figure, folder / f"estimates-{pipeline.run.name}-{width:g}mm")
    return paths


def _draw_value(axis: Any, outcome: RecordOutcome, name: str) -> None:
    """Draw one value of every track that has it over time, on an axis that the settled values fill."""
    unit = "1"
    settled_values: list[Floats] = []  # of each track, in the unit that is shown
    lines = cycle(_LINES)
    for track in outcome.pipeline.tracks:
        parameters = {parameter.name: parameter for parameter in track.model.parameters}
        if name not in parameters:
            continue
        unit = parameters[name].unit
        factor = display_unit(unit)[1]
        time, values, stds = _value_over_time(outcome.estimates[track.name], list(parameters).index(name))
        (line,) = axis.plot(time, factor * values, next(lines), label=track.name)
        low, high = (factor * (values + side * _BAND_SIGMAS * stds) for side in (-1, 1))
        axis.fill_between(time, low, high, color=line.get_color(), alpha=0.12, linewidth=0)
        settled_values.append(factor * values[len(values) // 4 :])  # without the first quarter
    symbol, factor = display_unit(unit)
    _draw_truth(axis, outcome, name, factor)
    axis.set(xlabel="time [s]", ylabel=f"{name.replace('_', ' ')} [{symbol}]")
    shown_values = np.concatenate(settled_values) if settled_values else np.zeros(0)
    if len(shown_values):
        low, high = np.quantile(shown_values, _VALUE_QUANTILES)
        margin = _VALUE_MARGIN * (high - low) + _TINY_MARGIN
        axis.set_ylim(low - margin, high + margin)


def _value_over_time(blocks: Sequence[Estimates], column: int) -> tuple[Floats, Floats, Floats]:
    """Return time [s], value and standard deviation (n,) of one column of estimates, where the track is active."""
    time = np.concatenate([block.time for block in blocks])
    values = np.concatenate([block.values[:, column] for block in blocks])
    stds = np.concatenate([block.std[:, column] for block in blocks])
    status = np.concatenate([block.status for block in blocks])
    rows = np.flatnonzero(((status & Status.IDLE) == 0) & np.isfinite(values))
    rows = rows[:: max(1, len(rows) // _MAX_POINTS)]
    return time[rows], values[rows], stds[rows]


def _draw_truth(axis: Any, outcome: RecordOutcome, name: str, factor: float) -> None:
    """Draw the true value times the factor of its unit as a line, along a sweep that of each place."""
    samples, truth = outcome.samples, outcome.result.truth.get(name)
    truth_by_sample = truth_along(outcome.pipeline, samples)
    style_of_line = {"color": "black", "linewidth": 0.8, "linestyle": (0, (1, 1)), "label": "truth"}
    if truth_by_sample is not None and name in truth_by_sample:
        rows = np.flatnonzero(samples.active)
        axis.plot(samples.time[rows], factor * truth_by_sample[name][rows], **style_of_line)
    elif truth is not None:
        axis.axhline(factor * truth, **style_of_line)


def _legend_below(figure: Any, axis: Any) -> None:
    """Put one legend of all tracks below the panels, in a strip of its own height."""
    handles, labels = axis.get_legend_handles_labels()
    columns = _NARROW_COLUMNS if figure.get_figwidth() * _INCH < _NARROW else _WIDE_COLUMNS
    rows = -(-len(labels) // columns)  # rounded up
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _LEGEND_LINE / _INCH * (rows + 1))
    figure.legend(handles, labels, ncols=columns, loc="outside lower center")


def _save(figure: Any, path: Path) -> list[Path]:
    """Write a figure in each format, and return the files; `path` is without a suffix."""
    paths = [path.with_name(f"{path.name}.{ending}") for ending in _FORMATS]
    for file in paths:
        save_figure(figure, file)
    return paths
