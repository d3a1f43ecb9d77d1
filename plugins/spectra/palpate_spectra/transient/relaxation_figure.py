"""The picture of a relaxation or a creep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_spectra.spectrum_figure import format_log_axis
from palpate_spectra.transient.relaxation_modulus import ModulusCurve
from palpate_spectra.transient.spectrum_of_times import density

_CURVE_POINTS = 200  # of the fitted curve: a choice, smooth on paper
_INTERVAL_SIGMAS = 1.96  # of 95 % of a normal distribution


@style()
def draw(curve: ModulusCurve, path: Path) -> None:
    """Draw E(t) or J(t) with 95 % intervals and the spectrum's curve; the spectrum of times with its own."""
    figure, panels = figure_of(2)
    curve_panel, spectrum_panel = panels.ravel()
    factor, name, unit = (1e6, "J", "1/MPa") if curve.creeps else (1e-3, "E", "kPa")
    _draw_curve(curve_panel, curve, factor)
    curve_panel.set(xscale="log", xlabel="time [s] (bars: 95 %)", ylabel=f"{name}(t) [{unit}]")
    _draw_spectrum(spectrum_panel, curve, factor)
    process, letter = ("retardation", "L") if curve.creeps else ("relaxation", "H")
    spectrum_panel.set(
        xscale="log", xlabel=f"{process} time [s] (band: 95 %)", ylabel=f"{letter}(tau) [{unit}]", ylim=(0, None)
    )
    for axis in (curve_panel.xaxis, spectrum_panel.xaxis):
        format_log_axis(axis)
    legend_outside(curve_panel)
    save_figure(figure, path)


def _draw_curve(panel: Any, curve: ModulusCurve, factor: float) -> None:
    """Draw the points of a curve with 95 % intervals, and the fitted curve, times a factor of the unit."""
    half_width = _INTERVAL_SIGMAS * factor * curve.std
    panel.errorbar(curve.time, factor * curve.value, half_width, fmt="o", markersize=3, color="C0", label="record")
    times = np.geomspace(curve.time[0], curve.time[-1], _CURVE_POINTS)
    fitted_values, _ = curve.fitted(times)
    panel.plot(times, factor * fitted_values, color="C2", linewidth=0.8, label="by the spectrum")


def _draw_spectrum(panel: Any, curve: ModulusCurve, factor: float) -> None:
    """Draw the density of the times with a band of 95 %, times a factor of the unit."""
    times, height, std = density(curve)
    low, high = np.maximum(height - _INTERVAL_SIGMAS * std, 0.0), height + _INTERVAL_SIGMAS * std
    panel.fill_between(times, factor * low, factor * high, color="C2", alpha=0.25, linewidth=0)
    panel.plot(times, factor * height, "o-", markersize=2.5, linewidth=0.8, color="C2")
