"""``palpate agree``: how well palpation agrees with a reference instrument, and how well with itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from palpate import ConfigurationError, Floats, printable, to_si
from palpate.host import display_unit, make_folder, write_new, write_whole
from palpate_kit.numerics.normalised_error import normalised_error
from palpate_kit.terminal.json_output import json_text, print_aside, print_json
from palpate_kit.terminal.options import FolderOption, FormatOption, JsonOption, TrackOption
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table, console

from palpate_reference.agreement.bland_altman import (
    DemingLine,
    Interval,
    LimitsOfAgreement,
    deming_line,
    limits_of_agreement,
)
from palpate_reference.agreement.precision import (
    Correlation,
    Precision,
    grouped,
    method_correlation,
    precision,
    repeat_correlation,
)
from palpate_reference.agreement.reference_source import QUANTITIES, file_reference, stated_reference
from palpate_reference.agreement.value_pairs import FACTORS, ReferenceOf, ValuePair, run_pairs, table_pairs
from palpate_reference.run_values import Conditions
from palpate_reference.table_options import ModulusOption, UnitOption, table_settings

AGREEMENT = "agreement.json"
_TREND = 0.05  # p-value below which differences are said to grow with the mean


@dataclass(frozen=True)
class Agreement:
    """Pairs, and what they say together [SI]."""

    quantity: str
    unit: str
    pairs: tuple[ValuePair, ...]
    limits: LimitsOfAgreement | None
    line: DemingLine | None
    correlation: float  # ICC(2,1) of palpation and reference over specimens; NaN for one
    repeats: Correlation | None
    precision: dict[str, Precision]  # by what groups differ; "" of repeats alone


def agree(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...", help="Run folders on one specimen; or a CSV of many specimens and references."
        ),
    ],
    reference: Annotated[
        str | None,
        typer.Option(metavar="FILE|VALUE", help="A table of a rheometer, DMA or dynamometer; or '112.5 kPa'."),
    ] = None,
    uncertainty: Annotated[
        str | None,
        typer.Option(metavar="VALUE", help="Standard uncertainty of the reference (k = 1); of a table in %."),
    ] = None,
    quantity: Annotated[Literal["elasticity", "viscosity"], typer.Option(help="What is compared.")] = "elasticity",
    frequency: Annotated[str | None, typer.Option(help="At which a reference value was measured, '2 Hz'.")] = None,
    strain: Annotated[str | None, typer.Option(help="To which it was deformed, '10 %'.")] = None,
    speed: Annotated[str | None, typer.Option(help="At which it was deformed, '50 mm/min'.")] = None,
    track: TrackOption = None,
    units: UnitOption = None,
    modulus: ModulusOption = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Compare palpation with a reference instrument at the same frequency, strain and speed, or say why not.

    E_n of each run (ISO 13528), Bland and Altman's limits of agreement and Deming's line over specimens, repeatability
    and reproducibility (ISO 5725), ICC and the smallest detectable change. The report of each run shows the result.
    """
    unit = QUANTITIES[quantity]
    stated = Conditions(_stated(frequency, "Hz"), _percent(strain), _stated(speed, "m/s"))
    if len(runs) == 1 and runs[0].is_file():
        if reference is not None:
            raise ConfigurationError(f"{runs[0]}: the table has its own references: leave --reference out")
        pairs = table_pairs(runs[0], quantity, unit, track)
    elif reference is None:
        raise ConfigurationError('--reference is missing: "112.5 kPa" with --uncertainty, or a table of an instrument')
    else:
        settings = table_settings(units, modulus)
        known = _reference(reference, uncertainty, unit, stated, quantity, settings)
        pairs = run_pairs(runs, quantity, track, known)
    found = agreement_of(pairs, quantity)
    folder = make_folder("agreement", out, datetime.now(UTC).astimezone())
    _write(found, folder)
    if as_json:
        print_json({"folder": folder, **document(found)})
        return
    with print_aside(False):
        _show(found)
    typer.echo(f"written to {folder}: {AGREEMENT}, agreement.png", err=layout != "table")


def _stated(text: str | None, unit: str) -> float | None:
    try:
        return None if text is None else to_si(text, unit)
    except ValueError as error:
        raise ConfigurationError(f"--frequency, --speed: {error}") from error


def _percent(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        if not text.strip().endswith("%"):
            raise ValueError(text)
        return float(text.strip()[:-1]) / 100.0
    except ValueError as error:
        raise ConfigurationError(f"--strain {text!r}: in per cent, such as '10 %'") from error


def _reference(
    text: str, uncertainty: str | None, unit: str, stated: Conditions, quantity: str, settings: Any
) -> ReferenceOf:
    """A value where the text begins as a number, and is no file; else a file."""
    path = Path(text)
    if path.is_file() or not text.strip()[:1].isdigit():
        return file_reference(path, settings, quantity, uncertainty)
    return stated_reference(text, uncertainty, unit, stated)


def agreement_of(pairs: Sequence[ValuePair], quantity: str) -> Agreement:
    """Everything that pairs say together."""
    if not pairs:
        raise ConfigurationError("there is no value to compare")
    specimens = [pair.specimen for pair in pairs]
    values = grouped([pair.value for pair in pairs], specimens)
    references = grouped([pair.reference for pair in pairs], specimens)
    once = [np.unique(one) for one in references.values()]  # the reference of a specimen is one value, however often
    means = np.array([[values[name].mean(), references[name].mean()] for name in values])
    ratio = float(np.mean([p.std**2 for p in pairs]) / np.mean([p.reference_std**2 for p in pairs]))
    return Agreement(
        quantity, QUANTITIES[quantity], tuple(pairs),
        limits_of_agreement(list(values.values()), once), deming_line(means[:, 0], means[:, 1], ratio),
        method_correlation(means), repeat_correlation(list(values.values())), dict(_precisions(pairs)),
    )  # fmt: skip


def _precisions(pairs: Sequence[ValuePair]) -> Iterator[tuple[str, Precision]]:
    """Of values that share every factor, and by each factor of which a specimen has several."""
    alike = grouped(
        [pair.value for pair in pairs], [f"{pair.specimen}|{sorted(pair.factors.items())}" for pair in pairs]
    )
    if repeats := precision([[values] for values in alike.values() if len(values) > 1]):
        yield "", repeats
    for factor in FACTORS:
        levels: list[list[Floats]] = []
        for specimen in dict.fromkeys(pair.specimen for pair in pairs):
            own = [pair for pair in pairs if pair.specimen == specimen]
            labels = [pair.factors.get(factor, "") for pair in own]
            levels.append(list(grouped([pair.value for pair in own], labels).values()))
        if any(len(groups) > 1 for groups in levels) and (found := precision(levels)) is not None:
            yield factor, found


def _write(found: Agreement, folder: Path) -> None:
    from palpate_reference.agreement.agreement_figure import draw_agreement

    write_new(folder / AGREEMENT, json_text(document(found)))
    draw_agreement(found.pairs, found.limits, found.line, found.quantity, folder / "agreement.png")
    for pair in found.pairs:
        if pair.run is not None:
            own = {"quantity": found.quantity, "unit": found.unit, **_row(pair)}
            write_whole(pair.run / AGREEMENT, json_text(own))


def _show(found: Agreement) -> None:
    screen = console()
    screen.print(pair_table(found).view(), highlight=False)
    rows = list(_statistics(found))
    if rows:
        table = Table.of("together", ("statistic", "value", "95 % interval"), rows, ("statistic",))
        screen.print(table.view(), highlight=False)
    for remark in dict.fromkeys(remark for pair in found.pairs for remark in pair.remarks):
        screen.print(printable(f"not the same: {remark}"), style="yellow", highlight=False)
    if found.limits is not None and found.limits.trend_p < _TREND:
        text = "differences change with the mean: limits of agreement hold for the middle of the range alone"
        screen.print(text, style="yellow", highlight=False)
    if found.limits is None:
        screen.print("limits of agreement and Deming's line need three specimens", highlight=False)


def pair_table(found: Agreement) -> Table:
    """One row for each pair."""
    word, factor = display_unit(found.unit)
    rows = []
    for pair in found.pairs:
        score = normalised_error(pair.value, pair.std, pair.reference, pair.reference_std)
        both = [(pair.value, pair.std), (pair.reference, pair.reference_std), (pair.difference, pair.difference_std)]
        cells = [value_with_uncertainty(factor * value, factor * std) for value, std in both]
        of = ", ".join(pair.factors.values())
        name = pair.specimen if pair.specimen == pair.label else f"{pair.specimen}, {of or pair.label}"
        rows.append((printable(name), *cells, f"{100 * pair.difference / pair.reference:+.1f}", f"{score:+.2f}"))
    headings = ("specimen", f"{found.quantity}\n{word}", f"reference\n{word}", f"difference\n{word}", "%", "E_n")
    return Table.of("palpation and reference", headings, rows, ("specimen",))


def _statistics(found: Agreement) -> Iterator[tuple[str, str, str]]:
    """Rows of what pairs say together."""
    word, factor = display_unit(found.unit)
    limits, line = found.limits, found.line

    def row(name: str, one: Interval, scale: float, unit: str) -> tuple[str, str, str]:
        return (name, f"{scale * one.value:.4g}{unit}", f"{scale * one.low:.4g} to {scale * one.high:.4g}{unit}")

    if limits is not None:
        yield row("bias", limits.bias, factor, f" {word}")
        yield row("lower limit of agreement", limits.lower, factor, f" {word}")
        yield row("upper limit of agreement", limits.upper, factor, f" {word}")
    if line is not None:
        yield row("Deming slope", line.slope, 1.0, "")
        yield row("Deming intercept", line.intercept, factor, f" {word}")
    if np.isfinite(found.correlation):
        yield ("ICC(2,1) of palpation and reference", f"{found.correlation:.4f}", "")
    if (repeats := found.repeats) is not None:
        yield (
            "ICC(1,1) of palpation over specimens",
            f"{repeats.value:.4f}",
            f"{repeats.low:.4f} to {repeats.high:.4f}",
        )
    for name, one in found.precision.items():
        if name:
            yield (f"reproducibility over {name} s_R", f"{factor * one.reproducibility:.4g} {word}", "")
        else:
            yield ("repeatability s_r", f"{factor * one.repeatability:.4g} {word}", "")
        yield ("smallest detectable change", f"{factor * one.detectable:.4g} {word}", "")


def _row(pair: ValuePair) -> dict[str, Any]:
    return {
        "label": pair.label, "specimen": pair.specimen, "value": pair.value, "std": pair.std,
        "reference": pair.reference, "reference_std": pair.reference_std, "difference": pair.difference,
        "difference_std": pair.difference_std, "factors": pair.factors, "remarks": pair.remarks,
        "e_n": normalised_error(pair.value, pair.std, pair.reference, pair.reference_std),
    }  # fmt: skip


def document(found: Agreement) -> dict[str, Any]:
    """Everything as plain data [SI]."""
    return {
        "quantity": found.quantity, "unit": found.unit, "pairs": [_row(pair) for pair in found.pairs],
        "limits_of_agreement": found.limits, "deming": found.line, "icc_2_1": found.correlation,
        "icc_1_1": found.repeats, "precision": {name or "repeats": one for name, one in found.precision.items()},
    }  # fmt: skip
