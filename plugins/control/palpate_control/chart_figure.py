"""The picture of a control chart: the checks with their limits, and their moving average with its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.figures import figure_of, legend_outside, save_figure, style
from palpate_kit.numerics.normalised_error import COVERAGE

from palpate_control.chart_file import ControlChart

_WIDTH, _PANEL_HEIGHT = 120.0, 45.0  # [mm], choices
_MAX_LABELS = 12  # dates along the axis, a choice: they do not touch each other


@style()
def draw_chart(chart: ControlChart, path: Path) -> None:
    """Draw the value of each check with its expanded uncertainty, and the EWMA, with limits; raises OutputError."""
    symbol, factor = display_unit(chart.reference.unit)
    number = np.arange(1, len(chart.check) + 1)  # of each check
    value = factor * np.array([check.value for check in chart.check])
    std = factor * np.array([check.std for check in chart.check])
    centre = factor * np.array([state.centre for state in chart.states])
    ewma = factor * np.array([state.ewma for state in chart.states])
    figure, axes = figure_of(1, 2, width=_WIDTH, height=_PANEL_HEIGHT)
    upper, lower = axes[:, 0]
    # The reference, the checks, and the moving average; sizes of lines and dots are points, and choices.
    reference, band = factor * chart.reference.value, COVERAGE * factor * chart.reference.std
    upper.axhspan(reference - band, reference + band, color="C2", alpha=0.2, linewidth=0, label="reference ± U")
    upper.errorbar(number, value, COVERAGE * std, fmt="o", markersize=3, linewidth=0.6, color="C0", label="check ± U")
    lower.plot(number, ewma, "o-", markersize=2, color="C0", label="EWMA")
    # The limits of both panels.
    limit = factor * np.array([state.limit for state in chart.states])
    ewma_limit = factor * np.array([state.ewma_limit for state in chart.states])
    _draw_limits(upper, centre, limit, "3 sigma")
    _draw_limits(lower, centre, ewma_limit, "limits")
    for panel in (upper, lower):
        panel.set(xlim=(0.5, len(number) + 0.5), ylabel=f"{chart.quantity} [{symbol}]")
    # A circle around each check that is out of control.
    is_out = np.array([not state.in_control for state in chart.states])
    if is_out.any():
        circle: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": 7, "fillstyle": "none", "color": "C3"}
        upper.plot(number[is_out], value[is_out], label="out of control", **circle)
        lower.plot(number[is_out], ewma[is_out], **circle)
    # A date below every check, or below every few: the number of checks over that of labels, rounded up.
    ticks = number[:: -(-len(number) // _MAX_LABELS)]
    dates = [f"{chart.check[tick - 1].date:%Y-%m-%d}" for tick in ticks]
    upper.set_xticks(ticks, [])
    lower.set_xticks(ticks, dates, rotation=45, ha="right")
    legend_outside(upper, 4)  # columns
    legend_outside(lower, 4)
    save_figure(figure, path)


def _draw_limits(panel: Any, centre: Floats, limit: Floats, label: str) -> None:
    """Draw the centre line (n,) of a panel, and limits (n,) on both sides of it, as steps over the checks."""
    number = np.arange(1, len(centre) + 1)
    panel.step(number, centre + limit, where="mid", linestyle="--", color="0.4", label=label)
    panel.step(number, centre - limit, where="mid", linestyle="--", color="0.4")
    panel.step(number, centre, where="mid", linewidth=0.6, color="0.4")
