"""Figure of the lumps that an exam excludes: contrast over width."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def draw_exclusion(axis: Any, excluded: Sequence[Mapping[str, float | None]]) -> None:
    """Draw the least contrasts that are excluded over their widths; hatched above them, "nothing" without any.

    Each entry has `width` [m], `contrast`, None where no lump as wide is excluded, and `probability`.
    """
    width = np.array([1e3 * (entry["width"] or 0.0) for entry in excluded])
    contrast = np.array([np.nan if entry["contrast"] is None else 100 * entry["contrast"] for entry in excluded])
    is_excluded = np.isfinite(contrast)
    axis.set(xlabel="width of a lump [mm]", ylabel="contrast [%]")
    if not is_excluded.any():
        axis.set(title="excludes nothing", xticks=[], yticks=[])
        return
    top = 2 * float(contrast[is_excluded].max())  # a choice: the highest point has room above it
    axis.plot(width[is_excluded], contrast[is_excluded], "o-", color="black", markersize=2.5, linewidth=1.0)
    axis.fill_between(width[is_excluded], contrast[is_excluded], top, color="tab:green", alpha=0.25, linewidth=0)
    axis.set(title=f"excluded with {excluded[0]['probability']:g}", yscale="log", ylim=(None, top))
    axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    # Of the minor ticks between the decades only those at 2 and 5 have a label.
    axis.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:.1e}"[0] in "25" else "")
