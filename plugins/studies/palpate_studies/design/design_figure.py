"""The picture of a design: bounds over frequency, one line for each amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate_kit.figures import figure_of, save_figure, style

from palpate_studies.design.palpation import Case

if TYPE_CHECKING:
    from palpate_studies.design.pipeline_design import Design

_STYLES: dict[Case, str] = {"known": "-", "unknown skew": "--", "unknown bias": ":"}


@style()
def draw(designs: Sequence[Design], path: Path) -> None:
    """One row of axes for each model, one column for each parameter; the recommended setting is ringed."""
    widest = max(len(design.theta) for design in designs)
    figure, axes = figure_of(widest, len(designs), height=70.0)
    for row, design in zip(axes, designs, strict=True):
        for axis, name in zip(row, design.theta, strict=False):
            _draw_parameter(axis, design, name)
    first = axes[0, 0]
    for case, look in _STYLES.items():
        first.plot([], [], look, color="black", label=case)
    figure.legend(*first.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    save_figure(figure, path)


def _draw_parameter(axis: object, design: Design, name: str) -> None:
    from typing import Any, cast

    plot = cast(Any, axis)
    single = [item for item in design.palpations if len(item.frequencies) == 1]
    for shade, amplitude in enumerate(sorted({item.amplitude for item in single})):
        items = sorted((i for i in single if i.amplitude == amplitude), key=lambda item: item.frequencies)
        frequencies = [item.frequencies[0] for item in items]
        for case, look in _STYLES.items():
            shares = [100 * item.relative(case, design.theta)[name] for item in items]
            label = f"{amplitude * 1e3:.3g} mm" if case == "known" else None
            plot.plot(frequencies, shares, look, color=f"C{shade}", label=label, marker=".", markersize=2)
    chosen = design.recommended
    if chosen is not None and len(chosen.frequencies) == 1:
        best = 100 * chosen.relative("known", design.theta)[name]
        plot.plot(chosen.frequencies[0], best, "o", markersize=8, fillstyle="none", color="k", label="recommended")
    plot.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=f"{design.name}: bound of {name} [%]")
    ticks = sorted({item.frequencies[0] for item in single})
    plot.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
    plot.set_xticks([], minor=True)
    plot.yaxis.set_major_formatter("{x:g}")
