"""The pictures of a comparison: the values of all runs by group, and their places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate_engine import display_unit
from palpate_kit.figures import WIDTHS, figure_of, legend_outside, style

from palpate_report.group_numbers import MIN_SITE_DISTANCE, GroupRun, number_of, numbers_of
from palpate_report.run_verdict import LEVELS

_MARKS = "osD^vPX"
_MAX_VECTOR_POINTS = 2000  # of a vector figure, a choice: more of them are drawn as pixels


def caption_of(parameter: str, noun: str = "run") -> str:
    """Return the caption of the picture of one parameter."""
    return f"{parameter.replace('_', ' ')} of each {noun}; bars are two combined uncertainties, hollow: to be looked at"


@style()
def values_by_run(runs: Sequence[GroupRun], track: str, parameter: str, unit: str) -> Any:
    """Return a parameter of each run in its group's colour, with bars of two combined uncertainties."""
    symbol, factor = display_unit(unit)
    figure, axes = figure_of(width=WIDTHS["double"], height=50.0)
    axis = axes[0, 0]
    groups = list(dict.fromkeys(run.group for run in runs))
    for i, group in enumerate(groups):
        look: dict[str, Any] = {"color": f"C{i % 7}", "linestyle": "none", "linewidth": 0.8}
        for level in LEVELS[:2]:
            chosen = [
                (k, number_of(run, track, parameter))
                for k, run in enumerate(runs, 1)
                if run.group == group and _level(run, track) == level
            ]
            points = [(k, found["value"], found.get("combined") or 0.0) for k, found in chosen if found]
            if not points:
                continue
            number, value, combined = np.array(points).T
            fill = {} if level == LEVELS[0] else {"markerfacecolor": "white"}
            label = group if level == LEVELS[0] else f"{group}: doubtful"
            axis.errorbar(
                number,
                factor * value,
                2 * factor * combined,
                marker=_MARKS[i % len(_MARKS)],
                label=label,
                rasterized=len(points) > _MAX_VECTOR_POINTS,
                **look,
                **fill,
            )
        values, _ = numbers_of(runs, group, track, parameter)
        if len(values) > 1:
            numbers = [k for k, run in enumerate(runs, 1) if run.group == group]
            axis.hlines(
                factor * values.mean(), min(numbers) - 0.3, max(numbers) + 0.3, color=look["color"], linewidth=0.6
            )
    truths = {run.truth.get(parameter) for run in runs}
    truth = truths.pop() if len(truths) == 1 else None
    if truth is not None:
        axis.axhline(factor * truth, color="black", linestyle=":", linewidth=0.6, label="truth")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.set(xlabel="run", ylabel=f"{parameter.replace('_', ' ')} [{symbol}]", xlim=(0.4, len(runs) + 0.6))
    legend_outside(axis, 4)
    return figure


def _level(run: GroupRun, track: str) -> str | None:
    return next((verdict.level for verdict in run.verdict.tracks if verdict.track == track), None)


@style()
def sites_of(runs: Sequence[GroupRun], track: str, parameter: str, unit: str) -> Any:
    """Return the places of the runs, coloured by value; None where they are one place."""
    sites = [(run.place, table["value"]) for run in runs if run.place and (table := number_of(run, track, parameter))]
    if len(sites) < 2 or np.ptp(np.array([place for place, _ in sites]), axis=0).max() < MIN_SITE_DISTANCE:
        return None
    symbol, factor = display_unit(unit)
    figure, axes = figure_of(width=WIDTHS["middle"], height=70.0)
    x, y = 1e3 * np.array([place for place, _ in sites]).T
    shown = axes[0, 0].scatter(x, y, c=[factor * value for _, value in sites], s=40, edgecolors="black", linewidths=0.4)
    shown.set_rasterized(len(sites) > _MAX_VECTOR_POINTS)
    figure.colorbar(shown, ax=axes[0, 0], shrink=0.8, label=f"{parameter.replace('_', ' ')} [{symbol}]")
    axes[0, 0].set(xlabel="x [mm]", ylabel="y [mm]")
    axes[0, 0].set_aspect("equal", adjustable="datalim")
    return figure
