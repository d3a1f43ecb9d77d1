"""The estimates of a run over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, legend_outside

from palpate_report.figure_data import swept, thin_rows
from palpate_report.figure_subject import MAX_POINTS, MAX_TRACKS, ReportFigure, Subject, beside

_MAX_PANELS = 8  # of a figure: a choice, they fit a page


def estimates(subject: Subject) -> ReportFigure | None:
    """Return every parameter over time with bands of two standard deviations, by model; the truth where it is known."""
    panels = [(names, parameter) for names, parameter in _panels(subject) if names][:_MAX_PANELS]
    if not panels:
        return None
    columns = beside(subject, len(panels))
    figure, axes = figure_of(columns, -(-len(panels) // columns), width=subject.width, height=48.0)
    data: dict[str, Floats] = {}
    for axis, (names, parameter) in zip(axes.ravel(), panels, strict=False):
        _draw_estimates(axis, subject, names, parameter, data)
    for axis in axes.ravel()[len(panels) :]:
        axis.set_axis_off()
    _shared_legends(axes.ravel()[: len(panels)])
    caption = "Estimates over time with bands of two of the estimator's standard deviations; bars: two combined u"
    return ReportFigure(figure, caption, data)


def _panels(subject: Subject) -> list[tuple[list[str], str]]:
    by_model: dict[tuple[str, str], list[str]] = {}
    for name in subject.tracks:
        for parameter in subject.curves(name).values if subject.curves(name).used.any() else ():
            by_model.setdefault((name.partition("/")[0], parameter), []).append(name)
    return [(names[:MAX_TRACKS], parameter) for (_, parameter), names in by_model.items()]


def _draw_estimates(axis: Any, subject: Subject, names: Sequence[str], parameter: str, data: dict[str, Floats]) -> None:
    estimates = [
        subject.record.document.get("tracks", {}).get(name, {}).get("parameters", {}).get(parameter) for name in names
    ]
    symbol, factor = display_unit(subject.record.unit(names[0], parameter))
    settled = list[Floats]()
    bars = list[tuple[float, float]]()
    for name, table in zip(names, estimates, strict=True):
        curves = subject.curves(name)
        used = np.flatnonzero(curves.used)
        rows = used[thin_rows(len(used), MAX_POINTS // 2)]
        if not len(rows):
            continue
        time, value, std = (
            curves.time[rows],
            factor * curves.values[parameter][rows],
            factor * curves.std[parameter][rows],
        )
        (line,) = axis.plot(time, value, label=name)
        axis.fill_between(time, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=0.15, linewidth=0)
        settled.append(factor * curves.values[parameter][curves.settled])
        if table and table["value"] is not None and table.get("combined"):
            bar_time, bar = time[-1] + (0.02 + 0.015 * len(bars)) * np.ptp(time), 2 * factor * table["combined"]
            axis.errorbar(
                bar_time, factor * table["value"], bar, fmt=".", color=line.get_color(), capsize=1.5, linewidth=0.8
            )
            bars.append((factor * table["value"], bar))
        data |= {f"{name}:time_s": time, f"{name}:{parameter}": value / factor, f"{name}:{parameter}_std": std / factor}
    truth = subject.record.document.get("truth", {}).get(parameter)
    if truth is not None:
        axis.axhline(factor * truth, color="black", linewidth=0.6, linestyle=":", label="truth")
    axis.set(xlabel="time [s]", ylabel=f"{parameter.replace('_', ' ')} [{symbol}]")
    limits = common_limits(settled, 0.1 if swept(subject.curves(names[0]).place) else 0.5)
    if limits is not None:
        bounds = [
            value + side * 1.1 * bar for value, bar in bars if limits[0] <= value <= limits[1] for side in (-1, 1)
        ]
        axis.set_ylim(min(limits[0], *bounds, limits[0]), max(limits[1], *bounds, limits[1]))


def _shared_legends(axes: Sequence[Any]) -> None:
    """Draw a legend if the curves are others than in the panel before."""
    before: list[str] = []
    for axis in axes:
        labels = axis.get_legend_handles_labels()[1]
        if labels != before:
            legend_outside(axis, 2)
        before = labels
