"""The picture of a spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.law_fits import LawFit, supported_laws


@style()
def draw(lines: Sequence[ModulusLine], fits: Sequence[LawFit], path: Path) -> None:
    """G' and G'' over frequency, and tan(delta), with 95 % intervals and the laws that the data support."""
    figure, panels = figure_of(2)
    moduli, ratio = panels.ravel()
    f = np.array([line.frequency for line in lines])
    shear = np.array([line.shear for line in lines]) / 1e3
    bars = {part: 1.96e-3 * np.array([line.std(of=part) for line in lines]) for part in ("storage", "loss")}
    moduli.errorbar(f, shear.real, bars["storage"], fmt="o", markersize=3, color="C0", label="G'")
    moduli.errorbar(f, shear.imag, bars["loss"], fmt="s", markersize=3, color="C1", label="G''")
    tan = np.array([line.loss_tangent for line in lines])
    ratio.errorbar(f, tan, 1.96 * np.array([line.std(of="tan") for line in lines]), fmt="o", markersize=3, color="C2")
    span = np.geomspace(f.min() / 1.2, f.max() * 1.2, 200)
    for fit, dashes in zip(supported_laws(fits), ("-", "--", ":")):
        late = np.exp(-2j * np.pi * span * fit.delay)
        model = fit.law.shear_modulus(2 * np.pi * span, fit.values, lines[0].poisson) * late / 1e3
        moduli.plot(span, model.real, dashes, color="C0", linewidth=0.8, label=fit.law.name)
        moduli.plot(span, model.imag, dashes, color="C1", linewidth=0.8)
        ratio.plot(span, model.imag / model.real, dashes, color="C2", linewidth=0.8)
    positive = bool((shear.imag > 0).all() and (shear.real > 0).all())
    moduli.set(xscale="log", yscale="log" if positive else "linear", xlabel="frequency [Hz]", ylabel="modulus [kPa]")
    ratio.set(xscale="log", xlabel="frequency [Hz] (bars: 95 %; lines: with the delay)", ylabel="tan(delta)")
    for axis in (moduli.xaxis, moduli.yaxis, ratio.xaxis):
        plain(axis)
    legend_outside(moduli)
    save_figure(figure, path)


def plain(axis: object) -> None:
    """Plain numbers at 1, 2 and 5 of each decade of a logarithmic axis."""
    from matplotlib.axis import Axis
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    assert isinstance(axis, Axis)
    if axis.get_scale() == "log":
        axis.set_major_locator(LogLocator(10, (1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
