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

_MAX_TREND_P = 0.05  # p-value, the usual one, below which differences change with the mean


def show_agreement(agreement: Agreement) -> None:
    """Print pairs, their statistics, and what is doubtful."""
    screen = console()
    screen.print(pair_table(agreement).view(), highlight=False)
    rows = list(_statistics(agreement))
    if rows:
        table = Table.of("together", ("statistic", "value", "95 % interval"), rows, ("statistic",))
        screen.print(table.view(), highlight=False)
    for remark in dict.fromkeys(remark for pair in agreement.pairs for remark in pair.remarks):
        screen.print(printable(f"not the same: {remark}"), style="yellow", highlight=False)
    if agreement.limits is not None and agreement.limits.trend_p < _MAX_TREND_P:
        warning = "differences change with the mean: limits of agreement hold for the middle of the range alone"
        screen.print(warning, style="yellow", highlight=False)
    if agreement.limits is None:
        screen.print("limits of agreement and Deming's line need three specimens", highlight=False)


def pair_table(agreement: Agreement) -> Table:
    """Return one row for each pair."""
    unit, factor = display_unit(agreement.unit)
    rows = []
    for pair in agreement.pairs:
        score = normalised_error(pair.value, pair.std, pair.reference, pair.reference_std)
        name = pair.specimen
        if pair.specimen != pair.label:
            name = f"{pair.specimen}, {', '.join(pair.factors.values()) or pair.label}"
        rows.append(
            (
                printable(name),
                value_with_uncertainty(factor * pair.value, factor * pair.std),
                value_with_uncertainty(factor * pair.reference, factor * pair.reference_std),
                value_with_uncertainty(factor * pair.difference, factor * pair.difference_std),
                f"{100 * pair.difference / pair.reference:+.1f}",
                f"{score:+.2f}",
            )
        )
    headings = ("specimen", f"{agreement.quantity}\n{unit}", f"reference\n{unit}", f"difference\n{unit}", "%", "E_n")
    return Table.of("palpation and reference", headings, rows, ("specimen",))


def _statistics(agreement: Agreement) -> Iterator[tuple[str, str, str]]:
    """Yield name, value and interval of every statistic of the pairs."""
    unit, factor = display_unit(agreement.unit)
    limits, line = agreement.limits, agreement.line
    if limits is not None:
        yield _interval_row("bias", limits.bias, factor, unit)
        yield _interval_row("lower limit of agreement", limits.lower, factor, unit)
        yield _interval_row("upper limit of agreement", limits.upper, factor, unit)
    if line is not None:
        yield _interval_row("Deming slope", line.slope)
        yield _interval_row("Deming intercept", line.intercept, factor, unit)
    if np.isfinite(agreement.correlation):
        yield ("ICC(2,1) of palpation and reference", f"{agreement.correlation:.4f}", "")
    repeats = agreement.repeats
    if repeats is not None:
        yield (
            "ICC(1,1) of palpation over specimens",
            f"{repeats.value:.4f}",
            f"{repeats.low:.4f} to {repeats.high:.4f}",
        )
    for factor_name, precision in agreement.precision.items():
        if factor_name:
            yield (f"reproducibility over {factor_name} s_R", f"{factor * precision.reproducibility:.4g} {unit}", "")
        else:
            yield ("repeatability s_r", f"{factor * precision.repeatability:.4g} {unit}", "")
        yield ("smallest detectable change", f"{factor * precision.detectable:.4g} {unit}", "")


def _interval_row(name: str, interval: Interval, factor: float = 1.0, unit: str = "") -> tuple[str, str, str]:
    """Return name, value and interval in a display unit; `factor` is that from SI."""
    suffix = f" {unit}" if unit else ""
    low, high = factor * interval.low, factor * interval.high
    return name, f"{factor * interval.value:.4g}{suffix}", f"{low:.4g} to {high:.4g}{suffix}"


def pair_document(pair: ValuePair) -> dict[str, Any]:
    """Return a pair as plain data [SI]."""
    return {
        "label": pair.label,
        "specimen": pair.specimen,
        "value": pair.value,
        "std": pair.std,
        "reference": pair.reference,
        "reference_std": pair.reference_std,
        "difference": pair.difference,
        "difference_std": pair.difference_std,
        "factors": pair.factors,
        "remarks": pair.remarks,
        "e_n": normalised_error(pair.value, pair.std, pair.reference, pair.reference_std),
    }


def document(agreement: Agreement) -> dict[str, Any]:
    """Return pairs and statistics as plain data [SI]."""
    return {
        "quantity": agreement.quantity,
        "unit": agreement.unit,
        "pairs": [pair_document(pair) for pair in agreement.pairs],
        "limits_of_agreement": agreement.limits,
        "deming": agreement.line,
        "icc_2_1": agreement.correlation,
        "icc_1_1": agreement.repeats,
        "precision": {factor or "repeats": precision for factor, precision in agreement.precision.items()},
    }
