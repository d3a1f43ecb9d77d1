"""The picture of repeatability: histogram, autocorrelation and moving average."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from palpate_engine import display_unit
from palpate_kit.figures import figure_of, label_forces, legend_outside, save_figure, style


@style()
def draw_repeatability(document: Mapping[str, Any], path: Path) -> None:
    """Histogram, autocorrelation, moving average and force error of every group, in one picture; raises UserError."""
    word, factor = display_unit(document["unit"])
    bands = {name: band for name, found in document["groups"].items() if (band := found.get("force_error"))}
    figure, panels = figure_of(2, 2) if bands else figure_of(3)
    axes = panels.ravel()
    windows = set()
    for i, (name, found) in enumerate(document["groups"].items()):
        colour = f"C{i}"
        values, edges = factor * np.array(found["values"]), factor * np.array(found["histogram"]["edges"])
        axes[0].hist(values, bins=edges if len(edges) else "auto", alpha=0.6, label=name, color=colour)
        axes[1].plot(found["autocorrelation"], "o-", markersize=2, label=name, color=colour)
        for side in (-1, 1):
            limit = side * found["autocorrelation_95"]
            axes[1].axhline(limit, linewidth=0.6, linestyle=":", color=colour)
        window = found["moving_average_window"]
        windows.add(window)
        average = factor * np.array(found["moving_average"])
        axes[2].plot(np.arange(1, len(values) + 1), values, ".", markersize=3, alpha=0.4, color=colour)
        axes[2].plot(np.arange(len(average)) + (window + 1) / 2, average, label=name, color=colour)
    axes[0].locator_params(axis="x", nbins=5)
    axes[0].set(xlabel=f"{document['parameter']} [{word}]", ylabel="count")
    axes[1].set(xlabel="lag (dotted: 95 % of none between)", ylabel="autocorrelation")
    for i, name in enumerate(document["groups"]):
        if (band := bands.get(name)) is not None:
            mean, std = np.array(band["mean"]), np.array(band["std"])
            axes[3].plot(band["time"], mean, linewidth=0.8, color=f"C{i}")
            axes[3].fill_between(band["time"], mean - std, mean + std, color=f"C{i}", alpha=0.2, linewidth=0)
            axes[3].set(xlabel="time tracked [s] (band: std between runs)")
            label_forces(axes[3], "force less model")
    over = ", ".join(map(str, sorted(windows)))
    axes[2].set(xlabel=f"run (line: mean over {over})", ylabel=f"{document['parameter']} [{word}]")
    legend_outside(axes[0])
    save_figure(figure, path)
