"""Figures of a bench: estimates over time of all tracks of a scene, and error against cost; for a column and a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, Status
from palpate_engine import Pipeline, RecordOutcome, RecordTracks, display_unit
from palpate_kit.comparison.record_rows import Row, truth_along
from palpate_kit.figures import figure_of, save_figure, style
from palpate_kit.terminal.result_table import SYMBOLS, chief_names

WIDTHS = (85.0, 170.0)  # [mm] of a column and of a page
_FORMATS = ("pdf", "svg")
_MARKERS = "osv^D<>Phd"  # tracks have a marker and a line of their own, so that colours are not needed
_LINES = ("-", "--", "-.", ":")
_MAX_POINTS = 400  # of a curve
_BAND_SIGMAS = 2.0
_INCH = 25.4  # [mm]
_NARROW = 100.0  # [mm] of a figure whose panels stand one above the other
_LEGEND_LINE = 4.5  # [mm]
_WIDE = 30.0  # from the lowest to the highest error: a narrower axis has ticks at 1, 2 and 5, a wider one at 1


@style()
def draw_errors(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write error against cost of a sample, a marker for each track and a panel for each scene; return the files."""
    paths = []
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    tracks = list(dict.fromkeys(row["track"] for row in rows if row["track"]))
    for width in WIDTHS:
        columns = min(2 if width < _NARROW else 4, len(scenes))
        figure, axes = figure_of(columns, -(-len(scenes) // columns), width=width, height=38.0)
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
    """Draw the error of the first value, or that of the predicted force where no value has one."""
    from matplotlib.ticker import LogLocator

    name = next((key for row in rows for key in row if key.endswith("_error")), "prediction")
    for place, track in enumerate(tracks):
        row = next((candidate for candidate in rows if candidate["track"] == track), {})
        error, cost = row.get(name), row.get("seconds_per_sample")
        point = (1e6 * cost, 100 * error) if error and cost else (np.nan, np.nan)
        marker, colour = _MARKERS[place % len(_MARKERS)], f"C{place % 7}"
        axis.loglog([point[0]], [point[1]], marker, color=colour, label=track, markersize=4)
    for scale in (axis.xaxis, axis.yaxis):  # mathematical text is off in the style
        scale.set_major_formatter(lambda number, _: f"{number:g}")
        scale.set_minor_formatter(lambda number, _: "")
    low, high = axis.get_ylim()
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _WIDE * low else (1.0,)))
    value = "force" if name == "prediction" else name.removesuffix("_error")
    axis.set_title(f"{scene}, {SYMBOLS.get(value, value)}", fontsize="medium")


@style()
def draw_estimates(pipeline: Pipeline, folder: Path) -> list[Path]:
    """Write the estimates over time of all tracks of a record, with bands of 2 std and the truth; return the files."""
    bare = replace(pipeline, registry=replace(pipeline.registry, diagnoses={}, summaries={}))
    outcome = RecordTracks(bare, compares=True).estimate()
    paths = []
    for width in WIDTHS:
        names = chief_names(parameter.name for track in pipeline.tracks for parameter in track.model.parameters)
        columns = 1 if width < _NARROW else len(names)
        figure, axes = figure_of(columns, -(-len(names) // columns), width=width, height=60.0)
        for axis, name in zip(axes.ravel(), names, strict=True):
            _draw_value(axis, outcome, name)
        _legend_below(figure, axes.ravel()[0])
        paths += _save(figure, folder / f"estimates-{pipeline.run.name}-{width:g}mm")
    return paths


def _draw_value(axis: Any, outcome: RecordOutcome, name: str) -> None:
    """Draw one value of every track that has it."""
    unit, settled = "1", list[Floats]()
    lines = cycle(_LINES)
    for track in outcome.pipeline.tracks:
        names = [parameter.name for parameter in track.model.parameters]
        if name not in names:
            continue
        place = names.index(name)
        unit = track.model.parameters[place].unit
        factor = display_unit(unit)[1]
        blocks = outcome.estimates[track.name]
        time, values, stds, status = (
            np.concatenate(columns)
            for columns in zip(*((b.time, b.values[:, place], b.std[:, place], b.status) for b in blocks), strict=True)
        )
        rows = np.flatnonzero(((status & Status.IDLE) == 0) & np.isfinite(values))
        rows = rows[:: max(1, len(rows) // _MAX_POINTS)]
        (line,) = axis.plot(time[rows], factor * values[rows], next(lines), label=track.name)
        low, high = (factor * (values[rows] + side * _BAND_SIGMAS * stds[rows]) for side in (-1, 1))
        axis.fill_between(time[rows], low, high, color=line.get_color(), alpha=0.12, linewidth=0)
        settled.append(factor * values[rows[len(rows) // 4 :]])
    symbol, factor = display_unit(unit)
    _draw_truth(axis, outcome, name, factor)
    axis.set(xlabel="time [s]", ylabel=f"{name.replace('_', ' ')} [{symbol}]")
    every_value = np.concatenate(settled) if settled else np.zeros(0)
    if len(every_value):
        low, high = np.quantile(every_value, [0.02, 0.98])
        margin = 0.15 * (high - low) + 1e-9
        axis.set_ylim(low - margin, high + margin)


def _draw_truth(axis: Any, outcome: RecordOutcome, name: str, factor: float) -> None:
    """Draw the true value as a line, along a sweep that of each place."""
    samples, truth = outcome.samples, outcome.result.truth.get(name)
    along = truth_along(outcome.pipeline, samples)
    look = {"color": "black", "linewidth": 0.8, "linestyle": (0, (1, 1)), "label": "truth"}
    if along is not None and name in along:
        rows = np.flatnonzero(samples.active)
        axis.plot(samples.time[rows], factor * along[name][rows], **look)
    elif truth is not None:
        axis.axhline(factor * truth, **look)


def _legend_below(figure: Any, axis: Any) -> None:
    """Put one legend of all tracks below the panels, in a strip of its own height."""
    handles, labels = axis.get_legend_handles_labels()
    columns = 2 if figure.get_figwidth() * _INCH < _NARROW else 4
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _LEGEND_LINE / _INCH * (-(-len(labels) // columns) + 1))
    figure.legend(handles, labels, ncols=columns, loc="outside lower center")


def _save(figure: Any, path: Path) -> list[Path]:
    paths = [path.with_name(f"{path.name}.{ending}") for ending in _FORMATS]
    for file in paths:
        save_figure(figure, file)
    return paths
