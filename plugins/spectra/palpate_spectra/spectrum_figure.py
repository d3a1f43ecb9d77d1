"""The picture of a spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.law_fits import LawFit, supported_laws

_CURVE_POINTS = 200  # of a law: a choice, smooth on paper
_CURVE_MARGIN = 1.2  # factor by which the laws are drawn beyond the measured frequencies: a choice
_INTERVAL_SIGMAS = 1.96  # of 95 % of a normal distribution
_LINE_STYLES = ("-", "--", ":")  # of the laws, the best first


@style()
def draw(lines: Sequence[ModulusLine], fits: Sequence[LawFit], path: Path) -> None:
    """Draw G' and G'' over frequency, and tan(delta), with 95 % intervals and the laws that the data support."""
    figure, panels = figure_of(2)
    moduli, ratio = panels.ravel()
    shear = np.array([line.shear for line in lines], np.complex128)
    _draw_lines(moduli, ratio, lines)
    _draw_laws(moduli, ratio, lines, supported_laws(fits))
    is_positive = bool((shear.imag > 0).all() and (shear.real > 0).all())
    modulus_scale = "log" if is_positive else "linear"
    moduli.set(xscale="log", yscale=modulus_scale, xlabel="frequency [Hz]", ylabel="modulus [kPa]")
    ratio.set(xscale="log", xlabel="frequency [Hz] (bars: 95 %; lines: with the delay)", ylabel="tan(delta)")
    for axis in (moduli.xaxis, moduli.yaxis, ratio.xaxis):
        format_log_axis(axis)
    legend_outside(moduli)
    save_figure(figure, path)


def _draw_lines(moduli: Any, ratio: Any, lines: Sequence[ModulusLine]) -> None:
    """Draw G' and G'' [kPa] of lines on the one panel, and tan(delta) on the other, with 95 % intervals."""
    frequencies = np.array([line.frequency for line in lines])
    shear = np.array([line.shear for line in lines]) / 1e3  # [kPa]
    tan = np.array([line.loss_tangent for line in lines])
    storage_bars, loss_bars = (1e-3 * _interval_half_widths(lines, part) for part in ("storage", "loss"))  # [kPa]
    moduli.errorbar(frequencies, shear.real, storage_bars, fmt="o", markersize=3, color="C0", label="G'")
    moduli.errorbar(frequencies, shear.imag, loss_bars, fmt="s", markersize=3, color="C1", label="G''")
    ratio.errorbar(frequencies, tan, _interval_half_widths(lines, "tan"), fmt="o", markersize=3, color="C2")


def _draw_laws(moduli: Any, ratio: Any, lines: Sequence[ModulusLine], fits: Sequence[LawFit]) -> None:
    """Draw G', G'' [kPa] and tan(delta) of the best laws with their delays, around the frequencies of the lines."""
    measured_frequencies = [line.frequency for line in lines]
    lowest, highest = min(measured_frequencies) / _CURVE_MARGIN, max(measured_frequencies) * _CURVE_MARGIN
    frequencies = np.geomspace(lowest, highest, _CURVE_POINTS)
    for fit, line_style in zip(fits, _LINE_STYLES):
        delay_factor = np.exp(-2j * np.pi * frequencies * fit.delay)
        law_shear = fit.law.shear_modulus(2 * np.pi * frequencies, fit.values, lines[0].poisson)
        curve = law_shear * delay_factor / 1e3  # [kPa]
        moduli.plot(frequencies, curve.real, line_style, color="C0", linewidth=0.8, label=fit.law.name)
        moduli.plot(frequencies, curve.imag, line_style, color="C1", linewidth=0.8)
        ratio.plot(frequencies, curve.imag / curve.real, line_style, color="C2", linewidth=0.8)


def _interval_half_widths(lines: Sequence[ModulusLine], part: str) -> Floats:
    """Return half the widths (n,) of the 95 % intervals of "storage" or "loss" [Pa], or of "tan"."""
    return np.asarray(_INTERVAL_SIGMAS * np.array([line.std_of(part) for line in lines]))


def format_log_axis(axis: object) -> None:
    """Write plain numbers at 1, 2 and 5 of each decade of an axis, if it is logarithmic."""
    from matplotlib.axis import Axis
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    assert isinstance(axis, Axis)
    if axis.get_scale() == "log":
        axis.set_major_locator(LogLocator(10, (1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
