"""The picture of repeatability: histogram, autocorrelation and moving average."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from palpate_engine import display_unit
from palpate_kit.figures import figure_of, label_forces, legend_outside, save_figure, style

_VALUE_TICKS = 5  # at most, a choice: labels of values are long


@style()
def draw_repeatability(document: Mapping[str, Any], path: Path) -> None:
    """Draw histogram, autocorrelation, moving average and force error of every group; raises UserError."""
    symbol, factor = display_unit(document["unit"])
    label = f"{document['parameter']} [{symbol}]"
    groups = document["groups"]
    has_force_error = any(statistics.get("force_error") for statistics in groups.values())
    figure, panels = figure_of(2, 2) if has_force_error else figure_of(3)
    axes = panels.ravel()
    for index, (name, statistics) in enumerate(groups.items()):
        colour = f"C{index}"
        _draw_histogram(axes[0], statistics, factor, name=name, colour=colour)
        _draw_autocorrelation(axes[1], statistics, name=name, colour=colour)
        _draw_moving_average(axes[2], statistics, factor, name=name, colour=colour)
        if statistics.get("force_error"):
            _draw_force_error(axes[3], statistics["force_error"], colour=colour)
    axes[0].locator_params(axis="x", nbins=_VALUE_TICKS)
    axes[0].set(xlabel=label, ylabel="count")
    axes[1].set(xlabel="lag (dotted: 95 % of none between)", ylabel="autocorrelation")
    windows = sorted({statistics["moving_average_window"] for statistics in groups.values()})
    axes[2].set(xlabel=f"run (line: mean over {', '.join(map(str, windows))})", ylabel=label)
    legend_outside(axes[0])
    save_figure(figure, path)


def _draw_histogram(axis: Any, statistics: Mapping[str, Any], factor: float, *, name: str, colour: str) -> None:
    """Draw the counts of the values, times the factor of their unit."""
    values = factor * np.array(statistics["values"])
    edges = factor * np.array(statistics["histogram"]["edges"])
    axis.hist(values, bins=edges if len(edges) else "auto", alpha=0.6, label=name, color=colour)


def _draw_autocorrelation(axis: Any, statistics: Mapping[str, Any], *, name: str, colour: str) -> None:
    """Draw the correlation over the lag, between the limits of 95 % for values without a correlation."""
    axis.plot(statistics["autocorrelation"], "o-", markersize=2, label=name, color=colour)
    limit = statistics["autocorrelation_95"]
    for level in (-limit, limit):
        axis.axhline(level, linewidth=0.6, linestyle=":", color=colour)


def _draw_moving_average(axis: Any, statistics: Mapping[str, Any], factor: float, *, name: str, colour: str) -> None:
    """Draw values over the numbers of their runs from 1, and their average over a window at its middle."""
    values = factor * np.array(statistics["values"])
    average = factor * np.array(statistics["moving_average"])
    middle = (statistics["moving_average_window"] + 1) / 2  # of the first window
    axis.plot(np.arange(1, len(values) + 1), values, ".", markersize=3, alpha=0.4, color=colour)
    axis.plot(np.arange(len(average)) + middle, average, label=name, color=colour)


def _draw_force_error(axis: Any, force_error: Mapping[str, Any], *, colour: str) -> None:
    """Draw the mean force error [N] over the time tracked [s], in a band of one standard deviation between runs."""
    time = force_error["time"]
    mean, std = np.array(force_error["mean"]), np.array(force_error["std"])
    axis.plot(time, mean, linewidth=0.8, color=colour)
    axis.fill_between(time, mean - std, mean + std, color=colour, alpha=0.2, linewidth=0)
    axis.set(xlabel="time tracked [s] (band: std between runs)")
    label_forces(axis, "force less model")
