"""Picture of the agreement of maps: lines with their differences, or E_n over an area."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, legend_outside, style

from palpate_maps.map_agreement import MapAgreement
from palpate_maps.sites import Sites, line_coordinate

_PANEL_HEIGHT = 60.0  # [mm], a choice
_SCALE_SHARE = 0.8  # of a panel's height, a choice: the colour scale
_MARGIN = 2.0  # [mm] about the sites
_MAX_SHOWN_SCORE = 2.0  # E_n at the ends of the scale of colours: twice the limit
# Choices [pt^2]: a raster has many sites, of which few are compared.
_SITE_DOT, _SCORE_DOT = 6.0, 30.0


@style()
def agreement_picture(series: Mapping[str, Sites], pairs: Mapping[str, MapAgreement], label: str, unit: str) -> Any:
    """Return the curves of lines with E_n below, or the value at the sites of each raster and E_n of each pair."""
    are_lines = all(line_coordinate(sites) is not None for sites in series.values())
    return _lines_picture(series, pairs, label, unit) if are_lines else _areas_picture(series, pairs, label, unit)


def _lines_picture(series: Mapping[str, Sites], pairs: Mapping[str, MapAgreement], label: str, unit: str) -> Any:
    """Return the curves of runs along a line with two standard deviations, and below E_n of each pair with its limits.

    `series` has the sites of each run, whose deviations are relative; `pairs` the agreement of each two runs. The line
    is drawn over x or y, whichever the first run goes farther along.
    """
    figure, axes = figure_of(rows=2, height=_PANEL_HEIGHT)
    curves, scores = axes[:, 0]
    name, factor = display_unit(unit)
    first_sites = next(iter(series.values()))
    direction = int(np.argmax(np.ptp(first_sites.place, axis=0)))  # 0 for x, 1 for y
    # Above: the values of each run, in a pale band. Widths of lines are points, and choices.
    for run, sites in series.items():
        order = np.argsort(sites.place[:, direction])
        position = 1e3 * sites.place[order, direction]
        value = factor * sites.value[order]
        (line,) = curves.plot(position, value, label=run)
        band = 2 * value * sites.std[order]
        curves.fill_between(position, value - band, value + band, color=line.get_color(), alpha=0.15, linewidth=0)
    curves.set(ylabel=f"{label} [{name}]")
    curves.set_ylim(common_limits([factor * sites.value for sites in series.values()], 0.0))
    # Below: E_n of each pair, which disagrees beyond 1.
    for pair, agreement in pairs.items():
        order = np.argsort(agreement.place[:, direction])
        position = 1e3 * agreement.place[order, direction]
        scores.plot(position, agreement.e_n[order], ".-", label=f"{pair}: p {agreement.p:.2g}")
    for limit in (-1.0, 1.0):
        scores.axhline(limit, color="k", linestyle=":", linewidth=0.8)
    scores.set(xlabel="along the line [mm]", ylabel="E_n", xlim=curves.get_xlim())
    legend_outside(curves)
    legend_outside(scores)
    return figure


@dataclass(frozen=True)
class _SitePanel:
    """A quantity at places, seen from above."""

    title: str
    place: Floats  # (n, k) [m]
    values: Floats  # (n,)
    quantity: str  # with its unit
    colours: str  # name of matplotlib's colour map
    limits: tuple[float, float]  # of its scale
    dot_size: float  # [pt^2]


def _areas_picture(series: Mapping[str, Sites], pairs: Mapping[str, MapAgreement], label: str, unit: str) -> Any:
    """Return a panel for each raster, with one scale of colours, and one for each pair, seen from above.

    `series` has the sites of each run, `pairs` the agreement of each two; `label` and SI `unit` are the parameter's.
    """
    figure, axes = figure_of(columns=2, rows=(len(series) + len(pairs) + 1) // 2, height=_PANEL_HEIGHT)
    panels = [*_value_panels(series, label, unit), *_score_panels(pairs)]
    # All panels show the same area.
    places = 1e3 * np.concatenate([sites.place[:, :2] for sites in series.values()])
    x_low, y_low = places.min(axis=0) - _MARGIN
    x_high, y_high = places.max(axis=0) + _MARGIN
    for axis, panel in zip(axes.ravel(), panels, strict=False):
        low, high = panel.limits
        x, y = 1e3 * panel.place[:, :2].T
        dots = axis.scatter(x, y, c=panel.values, cmap=panel.colours, vmin=low, vmax=high, s=panel.dot_size)
        figure.colorbar(dots, ax=axis, shrink=_SCALE_SHARE, label=panel.quantity)
        axis.set(title=panel.title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        axis.set(xlim=(x_low, x_high), ylim=(y_low, y_high))
        axis.grid(False)
    for axis in axes.ravel()[len(panels) :]:
        axis.set_axis_off()
    return figure


def _value_panels(series: Mapping[str, Sites], label: str, unit: str) -> list[_SitePanel]:
    """Return a panel of the values [display unit] of each raster; their scales end at the extremes of all rasters."""
    name, factor = display_unit(unit)
    values = np.concatenate([factor * sites.value for sites in series.values()])
    limits = values.min(), values.max()
    panels = []
    for run, sites in series.items():
        panels.append(
            _SitePanel(run, sites.place, factor * sites.value, f"{label} [{name}]", "viridis", limits, _SITE_DOT)
        )
    return panels


def _score_panels(pairs: Mapping[str, MapAgreement]) -> list[_SitePanel]:
    """Return a panel of E_n of each pair of rasters."""
    limits = -_MAX_SHOWN_SCORE, _MAX_SHOWN_SCORE
    panels = []
    for pair, agreement in pairs.items():
        title = f"{pair}: p {agreement.p:.2g}"
        panels.append(_SitePanel(title, agreement.place, agreement.e_n, "E_n", "RdBu_r", limits, _SCORE_DOT))
    return panels
