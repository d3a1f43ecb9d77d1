"""Picture of the agreement of maps: lines with their differences, or E_n over an area."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, legend_outside, style

from palpate_maps.map_agreement import MapAgreement
from palpate_maps.sites import Sites, line_coordinate

_MARGIN = 2.0  # [mm] about the sites
_SHOWN = 2.0  # E_n at the ends of the scale of colours: twice the limit


@style()
def agreement_picture(series: Mapping[str, Sites], pairs: Mapping[str, MapAgreement], label: str, unit: str) -> Any:
    """Return the curves of lines with E_n below, or the value at the sites of each raster and E_n of each pair."""
    along = {name: line_coordinate(sites) for name, sites in series.items()}
    if any(coordinate is None for coordinate in along.values()):
        return _areas(series, pairs, label, unit)
    figure, axes = figure_of(rows=2, height=60.0)
    curves, scores = axes[:, 0]
    name, factor = display_unit(unit)
    axis_of_line = int(np.argmax(np.ptp(next(iter(series.values())).place, axis=0)))
    for run, sites in series.items():
        order = np.argsort(sites.place[:, axis_of_line])
        position, value = 1e3 * sites.place[order, axis_of_line], factor * sites.value[order]
        (line,) = curves.plot(position, value, label=run)
        band = 2 * value * sites.std[order]
        curves.fill_between(position, value - band, value + band, color=line.get_color(), alpha=0.15, linewidth=0)
    curves.set(ylabel=f"{label} [{name}]")
    curves.set_ylim(common_limits([factor * sites.value for sites in series.values()], 0.0))
    for pair, agreement in pairs.items():
        order = np.argsort(agreement.place[:, axis_of_line])
        scores.plot(
            1e3 * agreement.place[order, axis_of_line], agreement.e_n[order], ".-", label=f"{pair}: p {agreement.p:.2g}"
        )
    for limit in (-1.0, 1.0):
        scores.axhline(limit, color="k", linestyle=":", linewidth=0.8)
    scores.set(xlabel="along the line [mm]", ylabel="E_n", xlim=curves.get_xlim())
    for axis in (curves, scores):
        legend_outside(axis)
    return figure


def _areas(series: Mapping[str, Sites], pairs: Mapping[str, MapAgreement], label: str, unit: str) -> Any:
    """Return a panel for each raster, with one scale of colours, and one for each pair, seen from above."""
    figure, axes = figure_of(columns=2, rows=(len(series) + len(pairs) + 1) // 2, height=60.0)
    name, factor = display_unit(unit)
    values = np.concatenate([factor * sites.value for sites in series.values()])
    panels = [
        (run, sites.place, factor * sites.value, f"{label} [{name}]", "viridis", (values.min(), values.max()))
        for run, sites in series.items()
    ]
    panels += [
        (f"{pair}: p {agreement.p:.2g}", agreement.place, agreement.e_n, "E_n", "RdBu_r", (-_SHOWN, _SHOWN))
        for pair, agreement in pairs.items()
    ]
    places = 1e3 * np.concatenate([sites.place[:, :2] for sites in series.values()])
    limits = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    for axis, (title, place, shades, quantity, colours, (low, high)) in zip(axes.ravel(), panels, strict=False):
        size = 30.0 if quantity == "E_n" else 6.0
        points = axis.scatter(*(1e3 * place[:, :2].T), c=shades, cmap=colours, vmin=low, vmax=high, s=size)
        figure.colorbar(points, ax=axis, shrink=0.8, label=quantity)
        axis.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        axis.set(xlim=(limits[0][0], limits[1][0]), ylim=(limits[0][1], limits[1][1]))
        axis.grid(False)
    for axis in axes.ravel()[len(panels) :]:
        axis.set_axis_off()
    return figure
