"""Agreement as tables for a terminal, and as plain data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from palpate import printable
from palpate_engine import display_unit
from palpate_kit.numerics.normalised_error import normalised_error
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_reference.agreement.agreement import Agreement
from palpate_reference.agreement.bland_altman import Interval
from palpate_reference.agreement.value_pairs import ValuePair

_TREND = 0.05  # p-value below which differences are said to grow with the mean


def show_agreement(agreement: Agreement) -> None:
    """Print pairs, what they say together, and what is to be doubted."""
    screen = console()
    screen.print(pair_table(agreement).view(), highlight=False)
    rows = list(_statistics(agreement))
    if rows:
        table = Table.of("together", ("statistic", "value", "95 % interval"), rows, ("statistic",))
        screen.print(table.view(), highlight=False)
    for remark in dict.fromkeys(remark for pair in agreement.pairs for remark in pair.remarks):
        screen.print(printable(f"not the same: {remark}"), style="yellow", highlight=False)
    if agreement.limits is not None and agreement.limits.trend_p < _TREND:
        text = "differences change with the mean: limits of agreement hold for the middle of the range alone"
        screen.print(text, style="yellow", highlight=False)
    if agreement.limits is None:
        screen.print("limits of agreement and Deming's line need three specimens", highlight=False)


def pair_table(agreement: Agreement) -> Table:
    """One row for each pair."""
    word, factor = display_unit(agreement.unit)
    rows = []
    for pair in agreement.pairs:
        score = normalised_error(pair.value, pair.std, pair.reference, pair.reference_std)
        both = [(pair.value, pair.std), (pair.reference, pair.reference_std), (pair.difference, pair.difference_std)]
        cells = [value_with_uncertainty(factor * value, factor * std) for value, std in both]
        of = ", ".join(pair.factors.values())
        name = pair.specimen if pair.specimen == pair.label else f"{pair.specimen}, {of or pair.label}"
        rows.append((printable(name), *cells, f"{100 * pair.difference / pair.reference:+.1f}", f"{score:+.2f}"))
    headings = ("specimen", f"{agreement.quantity}\n{word}", f"reference\n{word}", f"difference\n{word}", "%", "E_n")
    return Table.of("palpation and reference", headings, rows, ("specimen",))


def _statistics(agreement: Agreement) -> Iterator[tuple[str, str, str]]:
    """Rows of what pairs say together."""
    word, factor = display_unit(agreement.unit)
    limits, line = agreement.limits, agreement.line

    def row(name: str, one: Interval, scale: float, unit: str) -> tuple[str, str, str]:
        return (name, f"{scale * one.value:.4g}{unit}", f"{scale * one.low:.4g} to {scale * one.high:.4g}{unit}")

    if limits is not None:
        yield row("bias", limits.bias, factor, f" {word}")
        yield row("lower limit of agreement", limits.lower, factor, f" {word}")
        yield row("upper limit of agreement", limits.upper, factor, f" {word}")
    if line is not None:
        yield row("Deming slope", line.slope, 1.0, "")
        yield row("Deming intercept", line.intercept, factor, f" {word}")
    if np.isfinite(agreement.correlation):
        yield ("ICC(2,1) of palpation and reference", f"{agreement.correlation:.4f}", "")
    if (repeats := agreement.repeats) is not None:
        yield (
            "ICC(1,1) of palpation over specimens",
            f"{repeats.value:.4f}",
            f"{repeats.low:.4f} to {repeats.high:.4f}",
        )
    for name, one in agreement.precision.items():
        if name:
            yield (f"reproducibility over {name} s_R", f"{factor * one.reproducibility:.4g} {word}", "")
        else:
            yield ("repeatability s_r", f"{factor * one.repeatability:.4g} {word}", "")
        yield ("smallest detectable change", f"{factor * one.detectable:.4g} {word}", "")


def pair_document(pair: ValuePair) -> dict[str, Any]:
    """Return a pair as plain data [SI]."""
    return {
        "label": pair.label, "specimen": pair.specimen, "value": pair.value, "std": pair.std,
        "reference": pair.reference, "reference_std": pair.reference_std, "difference": pair.difference,
        "difference_std": pair.difference_std, "factors": pair.factors, "remarks": pair.remarks,
        "e_n": normalised_error(pair.value, pair.std, pair.reference, pair.reference_std),
    }  # fmt: skip


def document(agreement: Agreement) -> dict[str, Any]:
    """Everything as plain data [SI]."""
    spreads = {name or "repeats": one for name, one in agreement.precision.items()}
    return {
        "quantity": agreement.quantity, "unit": agreement.unit,
        "pairs": [pair_document(pair) for pair in agreement.pairs], "limits_of_agreement": agreement.limits,
        "deming": agreement.line, "icc_2_1": agreement.correlation, "icc_1_1": agreement.repeats, "precision": spreads,
    }  # fmt: skip
