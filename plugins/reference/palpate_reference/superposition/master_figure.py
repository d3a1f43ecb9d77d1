"""A master curve in one panel, its shifts with their laws in another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_reference.material_table import frequency_or_time, letters
from palpate_reference.superposition.master_curve import MasterCurve
from palpate_reference.superposition.shift_laws import ShiftLaw

_HEIGHT = 70.0  # [mm] of the panels, a choice
_COLOURS = 10  # of the style's cycle


def draw_master_curve(curve: MasterCurve, laws: Sequence[ShiftLaw], path: Path) -> None:
    """Save a panel of the readings as at the reference temperature, and one of log10 a_T with k = 2 over temperature.

    Raises OutputError.
    """
    with style():
        figure, ((left_panel, right_panel),) = figure_of(columns=2, height=_HEIGHT)
        _draw_readings(left_panel, curve)
        _draw_shifts(right_panel, curve, laws)
        save_figure(figure, path)


def _draw_readings(panel: Any, curve: MasterCurve) -> None:
    """Draw the readings of every sweep in its own colour, storage moduli as circles and loss moduli as dots."""
    first = curve.sweeps[0].tables[0]
    factor, value_unit = (1e3, "1/kPa") if first.kind == "creep" else (1e-3, "kPa")
    table = curve.table()
    assert table.temperature is not None
    # The sweep of a reading is the one nearest in temperature.
    sweep_index = np.argmin(np.abs(table.temperature[:, None] - curve.temperatures), axis=1)
    for k, temperature in enumerate(curve.temperatures):
        rows = sweep_index == k
        for column, mark in enumerate("o."[: table.y.shape[1]]):
            panel.plot(
                table.x[rows],
                factor * table.y[rows, column],
                mark,
                color=f"C{k % _COLOURS}",
                markersize=3,
                markerfacecolor="none",
                label=f"{temperature:.1f} °C" if column == 0 else None,
            )
    axis = "f a_T" if first.kind == "oscillation" else "t/a_T"
    reference = f"{curve.temperatures[curve.reference]:.1f} °C"
    panel.set(
        xscale="log",
        yscale="log",
        xlabel=f"{axis} [{frequency_or_time(first.kind)}] at {reference}",
        ylabel=f"{', '.join(letters(first))} [{value_unit}]",
    )
    for panel_axis in (panel.xaxis, panel.yaxis):
        panel_axis.set_major_formatter("{x:g}")
        panel_axis.set_minor_formatter("")
    legend_outside(panel)


def _draw_shifts(panel: Any, curve: MasterCurve, laws: Sequence[ShiftLaw]) -> None:
    """Draw log10 a_T over temperature, with bars of two standard uncertainties, and the laws."""
    shifts, stds = curve.shifts[:, 0] / math.log(10), 2 * curve.stds[:, 0] / math.log(10)
    panel.errorbar(curve.temperatures, shifts, stds, fmt="o", markersize=3, linewidth=0.6)
    grid = np.linspace(curve.temperatures.min(), curve.temperatures.max(), 100)
    for law in laws:
        panel.plot(grid, law.predicted(grid) / math.log(10), label=law.name)
    panel.set(xlabel="T [°C]", ylabel="log10 a_T")
    legend_outside(panel)
