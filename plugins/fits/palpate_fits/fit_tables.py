"""Tables of offline fits: comparison, budget, evaluation on other logs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate import BudgetRow, Effect, FitReport, Flag
from palpate_engine import Result, TrackResult, UncertainValue, display_unit, is_open
from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.quantities import value_or_fixed, value_with_uncertainty
from palpate_kit.terminal.result_screen import coloured, fact_lines, filled, finding_lines, value_lines, value_table
from palpate_kit.terminal.result_summary import flag_lines
from palpate_kit.terminal.result_table import ResultTable, track_row
from palpate_kit.terminal.table import Table

from palpate_fits.budget import TIMING

if TYPE_CHECKING:
    from rich.console import RenderableType

Tracks = Mapping[str, TrackResult]
# Columns of a comparison behind the unknowns.
_NUMBERS = ("surface\nmm", "residual\nN^2", "RMS\nN", "AIC", "BIC", "auto-\ncorrelation", "samples", "effective")


def fit_overview(logs: Mapping[str, tuple[Tracks, Sequence[Flag]]]) -> Iterator[RenderableType]:
    """Yield the values with their verdicts, the model that each record prefers, findings, open facts, and counts."""
    from rich.text import Text

    table = logs_table(logs)
    if len(table.rows) == 1 and layout() == "table":
        yield from value_lines(table.rows[0], {})
    else:
        yield value_table(table, whole_names=True).view()
    for name, (tracks, _) in logs.items():
        if sentence := evidence(tracks):
            yield Text(f"{name}: {sentence}" if len(logs) > 1 else sentence)
    yield from map(coloured, (*finding_lines(table), *fact_lines(table)))
    if len(table.rows) > 1:
        yield Text("\n".join(filled(table.partition(), "  ")))


def logs_table(logs: Mapping[str, tuple[Tracks, Sequence[Flag]]]) -> ResultTable:
    """Return the table of the tracks of some logs, with the flags of each record."""
    rows = tuple(
        track_row(track, label, name, flags)
        for name, (tracks, flags) in logs.items()
        for label, track in tracks.items()
    )
    return ResultTable(rows, thing="log" if len(rows) == len(logs) else "track")


def _value(value: UncertainValue | None) -> str:
    """Return a value with its uncertainty, and its verdict if that is open; a dash without one."""
    if value is None or not math.isfinite(value.value):
        return "-"
    factor = display_unit(value.unit)[1]
    number = value_or_fixed(value.value * factor, value.combined * factor)
    verdict = value.verdict or ""
    return f"{number} {verdict}" if is_open(verdict) else number


def fit_views(logs: Mapping[str, tuple[Tracks, Sequence[Flag]]]) -> Iterator[RenderableType]:
    """Yield the comparison of all fits, their evidence and flags, and the budget of each."""
    from rich.text import Text

    yield comparison({name: tracks for name, (tracks, _) in logs.items()}).view()
    for name, (tracks, flags) in logs.items():
        head = f"{name}: " if len(logs) > 1 else ""
        if sentence := evidence(tracks):
            yield Text(head + sentence)
        for line in flag_lines(flags, tracks):
            yield Text(f"{head}{line}", style="yellow")
    for name, (tracks, _) in logs.items():
        for label, track in tracks.items():
            if track.usable and track.report is not None and track.report.budget:
                yield budget(f"{name}: {label}", track, all_sources(track, track.report.budget))


def fits_of_a_run(result: Result) -> list[Table | str]:
    """Return the comparison of the offline fits among a run's tracks; empty without several."""
    fits = {name: track for name, track in result.tracks.items() if track.report is not None}
    return [comparison({result.run["name"]: fits})] if len(fits) > 1 else []


def best_fit_of_a_run(result: Result) -> list[Table | str]:
    """Return which of its offline fits the record of a run prefers; empty without several."""
    return list(filter(None, [evidence(result.tracks)]))


def comparison(logs: Mapping[str, Tracks]) -> Table:
    """Return a row for each fit: unknowns with uncertainty, residual, evidence, autocorrelation, flags."""
    head = ["log"] if len(logs) > 1 else []
    units = {name: unit for tracks in logs.values() for track in tracks.values() for name, unit in _unknowns(track)}
    values = [f"{name}\n{display_unit(unit)[0]}" for name, unit in units.items()]
    label_headings = [*head, "track"]
    rows = [
        [*([log] if head else []), label, *_row(track, list(units))]
        for log, tracks in logs.items()
        for label, track in tracks.items()
    ]
    return Table.of("offline fits", [*label_headings, *values, *_NUMBERS, "flags"], rows, [*label_headings, "flags"])


def _unknowns(track: TrackResult) -> Iterator[tuple[str, str]]:
    """Yield parameters and the other free unknowns of a fit but the surface, with their SI units."""
    for name, value in track.parameters.items():
        yield name, value.unit
    if track.report is not None:
        for name, unknown in track.report.unknowns.items():
            if unknown.free and name != "surface":
                yield name, unknown.unit


def _row(track: TrackResult, names: Sequence[str]) -> list[str]:
    """Return the cells of a track: its unknowns of these names, then `_NUMBERS`, then its flags.

    The numbers are surface, sum of squares, RMS, AIC, BIC, autocorrelation, samples, and how many of these independent.
    """
    codes = " ".join(sorted({flag.code for flag in track.flags}))
    report = track.report
    if not track.usable or (report is None and not any(math.isfinite(f.value) for f in track.parameters.values())):
        reason = "not fitted" if report is None else "not usable"
        return [*([reason] * len(names)), *([""] * len(_NUMBERS)), codes]
    cells = [_value(track.parameters[name]) if name in track.parameters else _unknown(report, name) for name in names]
    cells.append(value_or_fixed(1e3 * track.surface.value, 1e3 * track.surface.combined))  # in mm
    if report is None:  # an offline estimator that is not a fit, or reports nothing
        return [*cells, "", f"{track.force_rms:.4g}", "", "", "", str(track.samples), "", codes]
    return [
        *cells,
        f"{report.rss:.4g}",
        f"{report.rms:.4g}",
        _number(report.aic, ".1f"),
        _number(report.bic, ".1f"),
        _number(report.autocorrelation, ".2f"),
        str(report.samples),
        _number(report.effective_samples, ".0f"),
        codes,
    ]


def _unknown(report: FitReport | None, name: str) -> str:
    """Return an unknown that is not a parameter of the model as text; empty where the fit does not have it."""
    unknown = None if report is None else report.unknowns.get(name)
    if unknown is None or not unknown.free:
        return ""
    factor = display_unit(unknown.unit)[1]
    return value_with_uncertainty(unknown.value * factor, (unknown.std or 0.0) * factor)


def _number(value: float | None, form: str) -> str:
    """Return a number as text; a dash without one."""
    return "-" if value is None else format(value, form)


def evidence(tracks: Tracks) -> str:
    """Return which model the record prefers, by BIC; empty where there is nothing to compare."""
    fits = {name: track.report for name, track in tracks.items() if track.report is not None}
    bic = {name: report.bic for name, report in fits.items() if report.bic is not None}
    if len(bic) < 2:
        return ""
    if len({(fits[name].samples, fits[name].basis) for name in bic}) > 1:
        return "the fits use different samples, so AIC and BIC do not compare them"
    ranked = sorted(bic, key=lambda name: (bic[name], name))
    behind = ", ".join(f"{name} (BIC +{bic[name] - bic[ranked[0]]:.1f})" for name in ranked[1:])
    return f"the record prefers {ranked[0]} over {behind}"


def all_sources(track: TrackResult, fit_rows: Sequence[BudgetRow]) -> list[BudgetRow]:
    """Return the rows of the combined uncertainty: the fit's own in place of the estimator's, then those of judges.

    The timing is one of the judges' rows, if they have any.
    """
    judged_rows = [row for row in track.budget if row.source != "estimator"]
    return [row for row in fit_rows if not (judged_rows and row.source.startswith(TIMING))] + judged_rows


def budget(title: str, track: TrackResult, rows: Sequence[BudgetRow]) -> RenderableType:
    """Return the table of sources: standard uncertainty, and for each parameter sensitivity and contribution.

    `rows` are the sources of the budget, each with its effects by parameter.
    """
    from rich.table import Table

    names = [name for name in track.parameters if name in rows[0].effects]
    table = Table(title=f"uncertainty budget of {title}", title_justify="left")
    table.add_column("source")
    table.add_column("u", justify="right")
    for name in names:
        table.add_column(f"{name}\n{track.parameters[name].unit} per unit", justify="right")
        table.add_column("u\n%", justify="right")
    for row in rows:
        cells = []
        for name in names:
            effect = row.effects.get(name, Effect(None, None, None))
            cells.append("" if effect.sensitivity is None else f"{effect.sensitivity:.3g}")
            cells.append("?" if effect.percent is None else f"{effect.percent:.3f}")
        table.add_row(row.source, "" if row.std is None else f"{row.std:.3g} {row.unit}".removesuffix(" 1"), *cells)
    # The last row: the combined uncertainty of each value.
    combined = []
    for name in names:
        value = track.parameters[name]
        combined += ["", f"{100 * value.combined / abs(value.value):.3f}" if value.value else "?"]
    table.add_row("combined", "", *combined, style="bold")
    return table
