"""Palpation against reference with Deming's line, and Bland and Altman's differences with their limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate_engine import display_unit
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_reference.agreement.bland_altman import DemingLine, LimitsOfAgreement
from palpate_reference.agreement.reference_source import QUANTITIES
from palpate_reference.agreement.value_pairs import ValuePair


def draw_agreement(
    pairs: Sequence[ValuePair], limits: LimitsOfAgreement | None, line: DemingLine | None, quantity: str, path: Path
) -> None:
    """Two panels, uncertainties with k = 2."""
    word, factor = display_unit(QUANTITIES[quantity])
    value, reference, std, reference_std = (
        factor * np.array([getattr(pair, name) for pair in pairs])
        for name in ("value", "reference", "std", "reference_std")
    )
    with style():
        figure, ((left, right),) = figure_of(columns=2, height=70.0)
        ends = np.array([min(value.min(), reference.min()), max(value.max(), reference.max())]) * [0.95, 1.05]
        left.errorbar(reference, value, 2 * std, 2 * reference_std, fmt="o", markersize=3, linewidth=0.6)
        left.plot(ends, ends, "k:", label="equal")
        if line is not None:
            left.plot(ends, factor * line.intercept.value + line.slope.value * ends, label="Deming")
        left.set(xlabel=f"reference [{word}]", ylabel=f"palpation [{word}]")
        legend_outside(left)
        difference = value - reference
        spread = 2 * np.hypot(std, reference_std)
        right.errorbar(0.5 * (value + reference), difference, spread, fmt="o", markersize=3, linewidth=0.6)
        right.axhline(0.0, color="k", linestyle=":")
        if limits is not None:
            _draw_limits(right, limits, factor)
        right.set(xlabel=f"mean [{word}]", ylabel=f"palpation - reference [{word}]")
        legend_outside(right)
        save_figure(figure, path)


def _draw_limits(axes: Any, limits: LimitsOfAgreement, factor: float) -> None:
    """Bias and limits, each with its interval of 95 % as a band."""
    for one, color, label in (
        (limits.bias, "C1", "bias"), (limits.lower, "C2", "limits of agreement"), (limits.upper, "C2", None)
    ):  # fmt: skip
        axes.axhline(factor * one.value, color=color, label=label)
        axes.axhspan(factor * one.low, factor * one.high, color=color, alpha=0.15, linewidth=0)
