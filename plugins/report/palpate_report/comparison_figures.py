"""The pictures of a comparison: the values of all runs by group, and their places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.figures import WIDTHS, figure_of, legend_outside, style

from palpate_report.group_numbers import MIN_SITE_DISTANCE, GroupRun, number_of, numbers_of
from palpate_report.run_verdict import LEVELS

_COLOURS = 7  # of the style, C0 to C6; further groups repeat them
_MARKS = "osD^vPX"  # one for each colour, so that groups differ in grey, too
_MEAN_OVERHANG = 0.3  # of the line of a mean beyond the first and the last run, whose distance is 1: a choice
_MAX_VECTOR_POINTS = 2000  # of a vector figure, a choice: more of them are drawn as pixels
_RUNS_HEIGHT, _SITES_HEIGHT = 50.0, 70.0  # [mm] of the figures: choices
_MARGIN = 0.6  # of the axis beyond the first and the last run, whose distance is 1: a choice


def caption_of(parameter: str, noun: str = "run") -> str:
    """Return the caption of the picture of one parameter."""
    return f"{parameter.replace('_', ' ')} of each {noun}; bars are two combined uncertainties, hollow: to be looked at"


@style()
def values_by_run(runs: Sequence[GroupRun], track: str, parameter: str, unit: str) -> Any:
    """Return a figure of a parameter of each run in its group's colour, with bars of two combined uncertainties.

    `unit` is the SI unit of the parameter. Widths of lines are in points.
    """
    symbol, factor = display_unit(unit)
    figure, axes = figure_of(width=WIDTHS["double"], height=_RUNS_HEIGHT)
    axis = axes[0, 0]
    for i, group in enumerate(dict.fromkeys(run.group for run in runs)):
        # The numbers of the group's runs on the x axis, from 1 on.
        numbers = [number for number, run in enumerate(runs, 1) if run.group == group]
        look = {"color": f"C{i % _COLOURS}", "marker": _MARKS[i % len(_MARKS)]}
        # Good runs are filled marks, doubtful ones hollow; invalid runs are not drawn.
        for level in LEVELS[:2]:
            _draw_runs(axis, _numbered_values(runs, numbers, level, track, parameter), factor, group, level, look)
        # A line at the mean, from the first run of the group to the last.
        values, _ = numbers_of(runs, group, track, parameter)
        if len(values) > 1:
            left, right = min(numbers) - _MEAN_OVERHANG, max(numbers) + _MEAN_OVERHANG
            axis.hlines(factor * values.mean(), left, right, color=look["color"], linewidth=0.6)
    # The truth of simulated runs, if they have one in common.
    truths = {run.truth.get(parameter) for run in runs}
    truth = truths.pop() if len(truths) == 1 else None
    if truth is not None:
        axis.axhline(factor * truth, color="black", linestyle=":", linewidth=0.6, label="truth")
    axis.xaxis.get_major_locator().set_params(integer=True)
    limits = (1 - _MARGIN, len(runs) + _MARGIN)
    axis.set(xlabel="run", ylabel=f"{parameter.replace('_', ' ')} [{symbol}]", xlim=limits)
    legend_outside(axis, columns=4)
    return figure


def _numbered_values(
    runs: Sequence[GroupRun], numbers: Sequence[int], level: str, track: str, parameter: str
) -> Floats:
    """Return number, value and combined uncertainty [SI] (0 if unknown) of the runs of one level (n, 3).

    `numbers` are those of the group's runs, counted from 1; runs without a value are left out.
    """
    rows = []
    for number in numbers:
        run = runs[number - 1]
        table = number_of(run, track, parameter) if _level(run, track) == level else None
        if table:
            rows.append((number, table["value"], table.get("combined") or 0.0))
    return np.array(rows, np.float64).reshape(-1, 3)


def _draw_runs(axis: Any, rows: Floats, factor: float, group: str, level: str, look: Mapping[str, Any]) -> None:
    """Draw values of the runs of one level with bars of two uncertainties; doubtful ones are hollow marks.

    `rows` (n, 3) are number of the run, value and combined uncertainty [SI]; `look` has colour and mark of the group.
    """
    if not len(rows):
        return
    numbers, values, uncertainties = rows.T
    is_good = level == LEVELS[0]
    axis.errorbar(
        numbers,
        factor * values,
        2 * factor * uncertainties,
        label=group if is_good else f"{group}: doubtful",
        rasterized=len(rows) > _MAX_VECTOR_POINTS,
        linestyle="none",
        linewidth=0.8,
        **look,
        **({} if is_good else {"markerfacecolor": "white"}),
    )


def _level(run: GroupRun, track: str) -> str | None:
    """Return the level of a track of a run; None if the run does not have the track."""
    return next((verdict.level for verdict in run.verdict.tracks if verdict.track == track), None)


@style()
def sites_of(runs: Sequence[GroupRun], track: str, parameter: str, unit: str) -> Any:
    """Return a figure of the places x, y of the runs, coloured by value; None where they are one place."""
    places, values = [], []
    for run in runs:
        table = number_of(run, track, parameter) if run.place else None
        if table:
            places.append(run.place)
            values.append(table["value"])
    if len(places) < 2 or np.ptp(np.array(places), axis=0).max() < MIN_SITE_DISTANCE:
        return None
    symbol, factor = display_unit(unit)
    figure, axes = figure_of(width=WIDTHS["middle"], height=_SITES_HEIGHT)
    axis = axes[0, 0]
    x, y = 1e3 * np.array(places).T  # [mm]
    dots = axis.scatter(x, y, c=[factor * value for value in values], s=40, edgecolors="black", linewidths=0.4)
    dots.set_rasterized(len(places) > _MAX_VECTOR_POINTS)
    figure.colorbar(dots, ax=axis, shrink=0.8, label=f"{parameter.replace('_', ' ')} [{symbol}]")
    axis.set(xlabel="x [mm]", ylabel="y [mm]")
    axis.set_aspect("equal", adjustable="datalim")
    return figure
