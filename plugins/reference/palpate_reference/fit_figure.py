"""Tables of one material and the laws fitted to them, in words of Young's modulus."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style
from palpate_kit.numerics.material_laws import LinearLaw

from palpate_reference.hyperelastic.curve_fit import StressCurve
from palpate_reference.hyperelastic.strain_energies import HyperelasticLaw
from palpate_reference.law_fit import TableFit
from palpate_reference.material_table import Kind, MaterialTable, frequency_or_time

_LABELS: dict[Kind, str] = {"oscillation": "E', E'' [kPa]", "relaxation": "E(t) [kPa]", "creep": "D(t) [1/kPa]"}
_MOST = 3  # laws


def draw_fits(fits: Sequence[TableFit[LinearLaw]], tables: Sequence[MaterialTable], poisson: float, path: Path) -> None:
    """One panel for each kind of table."""
    of_tables: list[Kind] = [table.kind for table in tables]
    kinds = list(dict.fromkeys(of_tables))
    with style():
        figure, axes = figure_of(columns=len(kinds), height=70.0)
        for panel, kind in zip(axes[0], kinds, strict=True):
            _draw_kind(panel, kind, fits, [table for table in tables if table.kind == kind], poisson)
        save_figure(figure, path)


def draw_curves(fits: Sequence[TableFit[HyperelasticLaw]], curves: Sequence[StressCurve], path: Path) -> None:
    """Nominal stress over strain, one panel for uniaxial curves and one for shear."""
    groups = [[one for one in curves if (one.loading == "shear") is shear] for shear in (False, True)]
    groups = [group for group in groups if group]
    with style():
        figure, axes = figure_of(columns=len(groups), height=70.0)
        for panel, group in zip(axes[0], groups, strict=True):
            zero = 0.0 if group[0].loading == "shear" else 1.0
            for curve in group:
                panel.plot(100 * (curve.x - zero), curve.stress / 1e3, ".", markersize=2, label=curve.name[:40])
            x = np.concatenate([curve.x for curve in group])
            grid = np.linspace(x.min(), x.max(), 200)
            for fit in fits[:_MOST]:
                at = StressCurve("", group[0].loading, grid, grid)
                panel.plot(100 * (grid - zero), at.predicted(fit.law, fit.values.tolist()) / 1e3, label=fit.law.name)
            panel.set(xlabel="shear [%]" if zero == 0.0 else "nominal strain [%]", ylabel="stress [kPa]")
            legend_outside(panel)
        save_figure(figure, path)


def _draw_kind(
    axes: Any, kind: Kind, fits: Sequence[TableFit[LinearLaw]], tables: Sequence[MaterialTable], poisson: float
) -> None:
    factor = 1e3 if kind == "creep" else 1e-3
    per = {table.name: _young(table, poisson) for table in tables}
    for table in tables:
        for k in range(table.y.shape[1]):
            label = table.name[:40] if k == 0 else None
            axes.plot(table.x, factor * per[table.name] * table.y[:, k], ".o"[k] if k < 2 else ".", label=label,
                      markerfacecolor="none", markersize=3)  # fmt: skip
    x = np.concatenate([table.x for table in tables])
    grid = np.geomspace(x.min() / 1.2, x.max() * 1.2, 200)
    for fit in fits[:_MOST]:
        values = fit.values.tolist()
        if kind == "oscillation":
            moduli = fit.law.complex_modulus(grid, values, poisson)
            (line,) = axes.plot(grid, factor * moduli.real, label=fit.law.name)
            axes.plot(grid, factor * moduli.imag, "--", color=line.get_color())
        else:
            answer = fit.law.creep if kind == "creep" else fit.law.relaxation
            axes.plot(grid, factor * answer(grid, values, poisson), label=fit.law.name)
    axes.set(xscale="log", yscale="log", ylabel=_LABELS[kind])
    axes.set_xlabel("f [Hz]" if kind == "oscillation" else f"t [{frequency_or_time(kind)}]")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    legend_outside(axes)


def _young(table: MaterialTable, poisson: float) -> float:
    """By what values of a table are multiplied to be those of Young's modulus."""
    ratio = 2.0 * (1.0 + poisson) if table.shear else 1.0
    return 1.0 / ratio if table.kind == "creep" else ratio
