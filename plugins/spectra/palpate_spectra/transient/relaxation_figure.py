"""The picture of a relaxation or a creep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_spectra.spectrum_figure import plain
from palpate_spectra.transient.relaxation_modulus import ModulusCurve
from palpate_spectra.transient.spectrum_of_times import density


@style()
def draw(curve: ModulusCurve, path: Path) -> None:
    """E(t) or J(t) with 95 % intervals and the spectrum's curve; the spectrum of times with its own."""
    figure, panels = figure_of(2)
    over_time, over_times = panels.ravel()
    factor, name, unit = (1e6, "J", "1/MPa") if curve.creeps else (1e-3, "E", "kPa")
    span = np.geomspace(curve.time[0], curve.time[-1], 200)
    values, _ = curve.fitted(span)
    bars = 1.96 * factor * curve.std
    over_time.errorbar(curve.time, factor * curve.value, bars, fmt="o", markersize=3, color="C0", label="record")
    over_time.plot(span, factor * values, color="C2", linewidth=0.8, label="by the spectrum")
    over_time.set(xscale="log", xlabel="time [s] (bars: 95 %)", ylabel=f"{name}(t) [{unit}]")
    times, height, std = density(curve)
    low, high = np.maximum(height - 1.96 * std, 0.0), height + 1.96 * std
    over_times.fill_between(times, factor * low, factor * high, color="C2", alpha=0.25, linewidth=0)
    over_times.plot(times, factor * height, "o-", markersize=2.5, linewidth=0.8, color="C2")
    word = "retardation" if curve.creeps else "relaxation"
    letter = "L" if curve.creeps else "H"
    over_times.set(
        xscale="log", xlabel=f"{word} time [s] (band: 95 %)", ylabel=f"{letter}(tau) [{unit}]", ylim=(0, None)
    )
    for axis in (over_time.xaxis, over_times.xaxis):
        plain(axis)
    legend_outside(over_time)
    save_figure(figure, path)
