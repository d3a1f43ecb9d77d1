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

_COVERAGE = 2  # standard uncertainties of a bar
_BARS = {"fmt": "o", "markersize": 3, "linewidth": 0.6}
_HEIGHT = 70.0  # [mm] of the panels, a choice
_MARGINS = (0.95, 1.05)  # of the line of equality, beyond the values


def draw_agreement(
    pairs: Sequence[ValuePair], limits: LimitsOfAgreement | None, line: DemingLine | None, quantity: str, path: Path
) -> None:
    """Save values over references, and differences over means, with bars of k = 2; raises OutputError."""
    unit, factor = display_unit(QUANTITIES[quantity])
    value, reference, std, reference_std = (
        factor * np.array([getattr(pair, name) for pair in pairs])
        for name in ("value", "reference", "std", "reference_std")
    )
    with style():
        figure, ((left_panel, right_panel),) = figure_of(columns=2, height=_HEIGHT)
        # Palpation over reference, with the line of equality and Deming's.
        ends = np.array([min(value.min(), reference.min()), max(value.max(), reference.max())]) * _MARGINS
        left_panel.errorbar(reference, value, _COVERAGE * std, _COVERAGE * reference_std, **_BARS)
        left_panel.plot(ends, ends, "k:", label="equal")
        if line is not None:
            left_panel.plot(ends, factor * line.intercept.value + line.slope.value * ends, label="Deming")
        left_panel.set(xlabel=f"reference [{unit}]", ylabel=f"palpation [{unit}]")
        legend_outside(left_panel)

        # Differences with their limits (Bland and Altman 1986).
        difference_std = np.hypot(std, reference_std)
        right_panel.errorbar(0.5 * (value + reference), value - reference, _COVERAGE * difference_std, **_BARS)
        right_panel.axhline(0.0, color="k", linestyle=":")
        if limits is not None:
            _draw_limits(right_panel, limits, factor)
        right_panel.set(xlabel=f"mean [{unit}]", ylabel=f"palpation - reference [{unit}]")
        legend_outside(right_panel)
        save_figure(figure, path)


def _draw_limits(panel: Any, limits: LimitsOfAgreement, factor: float) -> None:
    """Draw bias and limits, each with its interval of 95 % as a band."""
    lines = ((limits.bias, "C1", "bias"), (limits.lower, "C2", "limits of agreement"), (limits.upper, "C2", None))
    for interval, color, label in lines:
        panel.axhline(factor * interval.value, color=color, label=label)
        panel.axhspan(factor * interval.low, factor * interval.high, color=color, alpha=0.15, linewidth=0)
