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
    for name, found in document["groups"].items():
        axes[0].hist(factor * np.array(found["values"]), bins="auto", alpha=0.6, label=name)
        axes[1].plot(found["autocorrelation"], "o-", markersize=3, label=name)
        axes[1].axhline(found["autocorrelation_95"], linewidth=0.5, color="0.5")
        axes[2].plot(factor * np.array(found["moving_average"]), label=name)
    axes[0].set(xlabel=f"{document['parameter']} [{word}]", ylabel="count", title="histogram")
    axes[1].set(xlabel="lag", ylabel="autocorrelation", title="autocorrelation; line: 95 % of none")
    axes[2].set(xlabel="run", ylabel=f"{document['parameter']} [{word}]", title="moving average over 30")
    for axis in axes:
        axis.legend(fontsize=8)
    try:
        figure.savefig(path, dpi=120, metadata={"Software": "palpate"})
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot draw there: {error}") from error
