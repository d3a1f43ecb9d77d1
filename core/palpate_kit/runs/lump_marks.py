"""Marks of lumps in a picture: a cross, with the number of the lump in the table and its p."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate_kit.runs.lump_table import chance

CROSS = {"color": "red", "markersize": 7, "markeredgewidth": 1.5}
_OFFSET = 4  # [pt] of a label from its cross
_HALO = 2  # [pt] of white about a label


def mark_lumps(axis: Any, lumps: Sequence[tuple[float, float, float]]) -> None:
    """Draw a cross and a label at lumps, each x and y in the units of the axis and its p, in the order of the table."""
    for number, (x, y, p) in enumerate(lumps, 1):
        axis.plot(x, y, "+", **CROSS)
        label_lump(axis, number, (x, y), p)


def label_lump(axis: Any, number: int, place: tuple[float, float], p: float) -> None:
    """Write number and p at the place of a lump, towards the middle of the axis, so that they are not cut off."""
    from matplotlib.patheffects import withStroke

    side, way = ("right", -1) if place[0] > sum(axis.get_xlim()) / 2 else ("left", 1)
    text, offset = f"{number}: p {chance(p)}", (way * _OFFSET, _OFFSET)
    label = axis.annotate(text, place, offset, textcoords="offset points", ha=side, fontsize="x-small")
    label.set_path_effects([withStroke(linewidth=_HALO, foreground="white")])
