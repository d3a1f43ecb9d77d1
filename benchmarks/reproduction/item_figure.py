"""The picture of an item: palpate over paper, row by row, with the tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate_kit.figures import figure_of, save_figure, style

from reproduction.item import Item
from reproduction.item_rows import Row

_COLOURS = {
    "reproduced": "tab:green",
    "arithmetic": "tab:olive",
    "simulated": "tab:blue",
    "fitted": "tab:purple",
    "outside": "tab:red",
}


@style()
def draw(item: Item, rows: Sequence[Row], path: Path) -> None:
    """Ratios with two standard deviations over the band of what is allowed; raises OutputError."""
    known = [row for row in rows if row.ratio is not None]
    figure, axes = figure_of(1, 1, width=180.0, height=30.0 + 9.0 * len(known))  # [mm]
    (axis,) = axes.ravel()
    for place, row in enumerate(known):
        published = row.published
        if row.tolerance:
            share = row.tolerance / abs(published.number)
            axis.barh(place, 2 * share, left=1 - share, height=0.8, color="0.9", zorder=0)
        filled = published.source in ("recording", "arithmetic")
        colour = _COLOURS.get(row.status, "0.5")
        axis.errorbar(
            row.ratio, place, xerr=2 * (row.ratio_std or 0.0), fmt="o", color=colour, capsize=3,
            markerfacecolor=colour if filled else "none",
        )  # fmt: skip
    axis.axvline(1.0, color="black", linewidth=0.8)
    axis.set_yticks(range(len(known)), [f"{row.published.row}, {row.published.quantity}" for row in known], fontsize=8)
    axis.invert_yaxis()
    axis.set(xlabel="palpate / paper (bars: 2 std; grey: allowed; open: simulated)")
    axis.set_title(item.title, fontsize=9)
    save_figure(figure, path)
