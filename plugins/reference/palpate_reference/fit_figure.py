"""Figures of tables of one material and the laws fitted to them, as Young's moduli."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style
from palpate_kit.numerics.material_laws import LinearLaw

from palpate_reference.fit_problem import shear_factor
from palpate_reference.hyperelastic.curve_fit import StressCurve
from palpate_reference.hyperelastic.strain_energies import HyperelasticLaw
from palpate_reference.law_fit import TableFit
from palpate_reference.material_table import Kind, MaterialTable, frequency_or_time

_LABELS: dict[Kind, str] = {"oscillation": "E', E'' [kPa]", "relaxation": "E(t) [kPa]", "creep": "D(t) [1/kPa]"}
# Choices.
_MAX_LAWS = 3  # in a panel
_MAX_NAME_LENGTH = 40  # letters of a table in a legend
_GRID_POINTS = 200  # of the line of a law
_MARGIN = 1.2  # factor by which that line extends beyond the readings
_HEIGHT = 70.0  # [mm] of the panels


def draw_fits(fits: Sequence[TableFit[LinearLaw]], tables: Sequence[MaterialTable], poisson: float, path: Path) -> None:
    """Save one panel for each kind of table, with the laws; raises OutputError."""
    kinds: list[Kind] = list(dict.fromkeys(table.kind for table in tables))
    with style():
        figure, axes = figure_of(columns=len(kinds), height=_HEIGHT)
        for panel, table_kind in zip(axes[0], kinds, strict=True):
            _draw_kind(panel, table_kind, fits, [table for table in tables if table.kind == table_kind], poisson)
        save_figure(figure, path)


def draw_curves(fits: Sequence[TableFit[HyperelasticLaw]], curves: Sequence[StressCurve], path: Path) -> None:
    """Save nominal stress over strain, one panel for uniaxial curves and one for shear; raises OutputError."""
    uniaxial_curves = [curve for curve in curves if curve.loading != "shear"]
    shear_curves = [curve for curve in curves if curve.loading == "shear"]
    groups = [group for group in (uniaxial_curves, shear_curves) if group]
    with style():
        figure, axes = figure_of(columns=len(groups), height=_HEIGHT)
        for panel, group in zip(axes[0], groups, strict=True):
            _draw_group(panel, fits, group)
        save_figure(figure, path)


def _draw_group(panel: Any, fits: Sequence[TableFit[HyperelasticLaw]], curves: Sequence[StressCurve]) -> None:
    """Draw curves of shear, or uniaxial ones, with the laws."""
    loading = curves[0].loading
    unstrained = 0.0 if loading == "shear" else 1.0  # shear or stretch
    for curve in curves:
        name = curve.name[:_MAX_NAME_LENGTH]
        panel.plot(100 * (curve.x - unstrained), curve.stress / 1e3, ".", markersize=2, label=name)
    x = np.concatenate([curve.x for curve in curves])
    grid = np.linspace(x.min(), x.max(), _GRID_POINTS)
    for fit in fits[:_MAX_LAWS]:
        stress = StressCurve("", loading, grid, grid).predicted(fit.law, fit.values.tolist())
        panel.plot(100 * (grid - unstrained), stress / 1e3, label=fit.law.name)
    panel.set(xlabel="shear [%]" if loading == "shear" else "nominal strain [%]", ylabel="stress [kPa]")
    legend_outside(panel)


def _draw_kind(
    panel: Any, table_kind: Kind, fits: Sequence[TableFit[LinearLaw]], tables: Sequence[MaterialTable], poisson: float
) -> None:
    """Draw tables of one kind as Young's moduli [kPa] or compliances [1/kPa], with the laws."""
    factor = 1e3 if table_kind == "creep" else 1e-3
    for table in tables:
        per_young = factor * _young_factor(table, poisson)
        for k in range(table.y.shape[1]):
            # Storage moduli are dots, loss moduli circles; the table is named once.
            panel.plot(
                table.x,
                per_young * table.y[:, k],
                ".o"[k] if k < 2 else ".",
                label=table.name[:_MAX_NAME_LENGTH] if k == 0 else None,
                markerfacecolor="none",
                markersize=3,
            )
    x = np.concatenate([table.x for table in tables])
    grid = np.geomspace(x.min() / _MARGIN, x.max() * _MARGIN, _GRID_POINTS)
    for fit in fits[:_MAX_LAWS]:
        values = fit.values.tolist()
        if table_kind == "oscillation":
            moduli = fit.law.complex_modulus(grid, values, poisson)
            (line,) = panel.plot(grid, factor * moduli.real, label=fit.law.name)
            panel.plot(grid, factor * moduli.imag, "--", color=line.get_color())
        else:
            response = fit.law.creep if table_kind == "creep" else fit.law.relaxation
            panel.plot(grid, factor * response(grid, values, poisson), label=fit.law.name)
    panel.set(xscale="log", yscale="log", ylabel=_LABELS[table_kind])
    panel.set_xlabel("f [Hz]" if table_kind == "oscillation" else f"t [{frequency_or_time(table_kind)}]")
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    legend_outside(panel)


def _young_factor(table: MaterialTable, poisson: float) -> float:
    """Return the factor from the values of a table to Young's modulus, or to the compliance D = J/(2 (1 + nu))."""
    factor = shear_factor(table, poisson)
    return 1.0 / factor if table.kind == "creep" else factor
