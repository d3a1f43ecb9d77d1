"""The picture of repeatability: histogram, autocorrelation and moving average."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from palpate import UserError
from palpate.host import people


def draw_repeatability(document: Mapping[str, Any], path: Path) -> None:
    """Histogram, autocorrelation and moving average of every group, in one picture; raises UserError."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise UserError("--picture needs matplotlib: pip install matplotlib") from error
    word, factor = people(document["unit"])
    figure = Figure(figsize=(15, 4.5), layout="constrained")
    axes: Any = figure.subplots(1, 3)
    windows = set()
    for i, (name, found) in enumerate(document["groups"].items()):
        colour = f"C{i}"
        values, edges = factor * np.array(found["values"]), factor * np.array(found["histogram"]["edges"])
        axes[0].hist(values, bins=edges if len(edges) else "auto", alpha=0.6, label=name, color=colour)
        axes[1].plot(found["autocorrelation"], "o-", markersize=3, label=name, color=colour)
        for side in (-1, 1):
            limit = side * found["autocorrelation_95"]
            axes[1].axhline(limit, linewidth=0.8, linestyle=":", color=colour)
        window = found["moving_average_window"]
        windows.add(window)
        average = factor * np.array(found["moving_average"])
        axes[2].plot(np.arange(1, len(values) + 1), values, ".", markersize=3, alpha=0.4, color=colour)
        axes[2].plot(np.arange(len(average)) + (window + 1) / 2, average, label=name, color=colour)
    axes[0].set(xlabel=f"{document['parameter']} [{word}]", ylabel="count", title="histogram")
    axes[1].set(xlabel="lag", ylabel="autocorrelation", title="autocorrelation; dotted: 95 % of none lie between")
    over = ", ".join(map(str, sorted(windows)))
    axes[2].set(xlabel="run", ylabel=f"{document['parameter']} [{word}]", title=f"moving average over {over}")
    for axis in axes:
        axis.legend(fontsize=8)
    try:
        figure.savefig(path, dpi=120, metadata={"Software": "palpate"})
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot draw there: {error}") from error
