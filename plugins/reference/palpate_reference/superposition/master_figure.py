"""A master curve in one panel, its shifts with their laws in another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_reference.material_table import frequency_or_time, letters
from palpate_reference.superposition.master_curve import MasterCurve
from palpate_reference.superposition.shift_laws import ShiftLaw


def draw_master_curve(curve: MasterCurve, laws: Sequence[ShiftLaw], path: Path) -> None:
    """Readings as at the reference temperature; log10 a_T with k = 2 over temperature."""
    first = curve.sweeps[0].tables[0]
    names, factor = letters(first), 1e3 if first.kind == "creep" else 1e-3
    unit = frequency_or_time(first.kind)
    with style():
        figure, ((left, right),) = figure_of(columns=2, height=70.0)
        table = curve.table()
        assert table.temperature is not None
        of = np.argmin(np.abs(table.temperature[:, None] - curve.temperatures), axis=1)
        for k, temperature in enumerate(curve.temperatures):
            for column, mark in enumerate("o."[: table.y.shape[1]]):
                left.plot(table.x[of == k], factor * table.y[of == k, column], mark, color=f"C{k % 10}", markersize=3,
                          markerfacecolor="none", label=f"{temperature:.1f} °C" if column == 0 else None)  # fmt: skip
        axis = f"f a_T [{unit}]" if first.kind == "oscillation" else f"t/a_T [{unit}]"
        per = "1/kPa" if first.kind == "creep" else "kPa"
        axis += f" at {curve.temperatures[curve.reference]:.1f} °C"
        left.set(xscale="log", yscale="log", xlabel=axis, ylabel=f"{', '.join(names)} [{per}]")
        for one in (left.xaxis, left.yaxis):
            one.set_major_formatter("{x:g}")
            one.set_minor_formatter("")
        legend_outside(left)
        right.errorbar(curve.temperatures, curve.shifts[:, 0] / math.log(10), 2 * curve.stds[:, 0] / math.log(10),
                       fmt="o", markersize=3, linewidth=0.6)  # fmt: skip
        grid = np.linspace(curve.temperatures.min(), curve.temperatures.max(), 100)
        for law in laws:
            right.plot(grid, law.predicted(grid) / math.log(10), label=law.name)
        right.set(xlabel="T [°C]", ylabel="log10 a_T")
        legend_outside(right)
        save_figure(figure, path)
