"""What people see of offline fits: comparison, budget, evaluation on other logs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from palpate import BudgetRow, Effect, Flag
from palpate.host import Result, TrackResult, display_unit
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.result_summary import flag_lines
from palpate_kit.terminal.table import Table

from palpate_fits.budget import TIMING

if TYPE_CHECKING:
    from rich.console import RenderableType

Tracks = Mapping[str, TrackResult]


def fit_views(
    logs: Mapping[str, tuple[Tracks, Sequence[Flag]]],
    crossed: Sequence[dict[str, Any]],
    cycles: Sequence[dict[str, Any]],
) -> Iterator[RenderableType]:
    """Comparison of all fits, their evidence and flags, budgets, evaluation on other logs, and cycles."""
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
    if crossed:
        yield evaluation(crossed)
    if cycles:
        yield by_cycle(cycles)


def each_table(tracks: Mapping[str, Mapping[str, Any]]) -> Table:
    """Of many curves: how many were fitted, and median and quartiles of each parameter by track."""
    rows = []
    for label, found in tracks.items():
        spreads = found.get("quartiles", {}).items()
        texts = [f"{name} {middle:.4g} ({low:.4g} to {high:.4g})" for name, (low, middle, high) in spreads]
        counts = [str(found[name]) for name in ("curves", "failed", "flagged")]
        rows.append([label, *counts, "\n".join(text for text in texts if "_std " not in text)])
    median = "median (quartiles), SI"
    return Table.of("fits of each curve", ["track", "curves", "failed", "flagged", median], rows, ["track", median])


def fits_of_a_run(result: Result) -> list[Table | str]:
    """Comparison of the offline fits among a run's tracks, where there are several."""
    fits = {name: track for name, track in result.tracks.items() if track.report is not None}
    return [comparison({result.run["name"]: fits}), evidence(fits)] if len(fits) > 1 else []


def comparison(logs: Mapping[str, Tracks]) -> Table:
    """One row for each fit: parameters with uncertainty, residual, evidence, autocorrelation, flags."""
    head = ["log"] if len(logs) > 1 else []
    left = [*head, "track", "parameters", "surface\nmm"]
    numbers = ["residual\nN^2", "RMS\nN", "AIC", "BIC", "auto-\ncorrelation", "samples,\neffective", "flags"]
    rows = [
        [*([log] if head else []), label, *_row(track)]
        for log, tracks in logs.items()
        for label, track in tracks.items()
    ]
    return Table.of("offline fits", [*left, *numbers], rows, left)


def _row(track: TrackResult) -> list[str]:
    codes = " ".join(sorted({flag.code for flag in track.flags}))
    report = track.report
    if not track.usable or (report is None and not any(math.isfinite(f.value) for f in track.parameters.values())):
        return ["not fitted" if report is None else "not usable", "", "", "", "", "", "", "", codes]
    lines = [_parameter(name, f.value, f.combined, f.unit) for name, f in track.parameters.items()]
    surface = value_with_uncertainty(1e3 * track.surface.value, 1e3 * track.surface.combined)
    if report is None:  # an offline estimator that is no fit, or reports nothing
        return ["\n".join(lines), surface, "", f"{track.force_rms:.4g}", "", "", "", str(track.samples), codes]
    lines += [
        _parameter(name, known.value, known.std, known.unit)
        for name, known in report.unknowns.items()
        if known.free and name not in track.parameters and name != "surface"
    ]
    return [
        "\n".join(lines),
        surface,
        f"{report.rss:.4g}",
        f"{report.rms:.4g}",
        _number(report.aic, ".1f"),
        _number(report.bic, ".1f"),
        _number(report.autocorrelation, ".2f"),
        f"{report.samples}\n{_number(report.effective_samples, '.0f')}",
        codes,
    ]


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _parameter(name: str, value: float, std: float | None, unit: str) -> str:
    word, factor = display_unit(unit)
    return f"{name} {value_with_uncertainty(value * factor, (std or 0.0) * factor)} {word}"


def evidence(tracks: Tracks) -> str:
    """Which model the record prefers, by BIC; empty where there is nothing to compare."""
    fits = {name: track.report for name, track in tracks.items() if track.report is not None}
    bic = {name: report.bic for name, report in fits.items() if report.bic is not None}
    if len(bic) < 2:
        return ""
    if len({(fits[name].samples, fits[name].basis) for name in bic}) > 1:
        return "the fits use different samples, so AIC and BIC do not compare them"
    ranked = sorted(bic, key=lambda name: (bic[name], name))
    behind = ", ".join(f"{name} (BIC +{bic[name] - bic[ranked[0]]:.1f})" for name in ranked[1:])
    return f"the record prefers {ranked[0]} over {behind}"


def all_sources(track: TrackResult, own: Sequence[BudgetRow]) -> list[BudgetRow]:
    """What adds up to the combined uncertainty: the fit's own rows in place of the estimator's, then what judges add.

    The timing is one of theirs, where there are any.
    """
    others = [row for row in track.budget if row.source != "estimator"]
    return [row for row in own if not (others and row.source.startswith(TIMING))] + others


def budget(title: str, track: TrackResult, rows: Sequence[BudgetRow]) -> RenderableType:
    """Source, standard uncertainty, and for each parameter sensitivity and contribution."""
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
    combined = []
    for name in names:
        found = track.parameters[name]
        combined += ["", f"{100 * found.combined / abs(found.value):.3f}" if found.value else "?"]
    table.add_row("combined", "", *combined, style="bold")
    return table


def evaluation(rows: Sequence[dict[str, Any]]) -> RenderableType:
    """Residual sum of squares of every fit on every log."""
    from rich.table import Table

    logs = list(dict.fromkeys(row["on"] for row in rows))
    table = Table(title="residual N^2 (RMS N) of what was fitted on one log on the others", title_justify="left")
    table.add_column("track")
    table.add_column("fitted on")
    for log in logs:
        table.add_column(f"on {log}", justify="right")
    for track, source in dict.fromkeys((row["track"], row["fitted_on"]) for row in rows):
        cells = {row["on"]: row for row in rows if (row["track"], row["fitted_on"]) == (track, source)}
        table.add_row(track, source, *(_left(cells.get(log)) for log in logs))
    return table


def _left(row: dict[str, Any] | None) -> str:
    if row is None or row["rss"] is None:
        return "-"
    return f"{row['rss']:.4g} ({row['rms']:.3g})"


def by_cycle(rows: Sequence[dict[str, Any]]) -> RenderableType:
    """One row for each cycle."""
    from rich.table import Table

    table = Table(title="every cycle by itself", title_justify="left")
    for heading in ("log", "track", "cycle", "parameters", "RMS N", "flags"):
        table.add_column(heading)
    for row in rows:
        free = {name: known for name, known in row["unknowns"].items() if known["free"]}
        found = [_parameter(name, known["value"], known["std"], known["unit"]) for name, known in free.items()]
        codes = " ".join(sorted({flag["code"] for flag in row["flags"]}))
        rms = "-" if row["rms"] is None else f"{row['rms']:.4g}"
        table.add_row(row["log"], row["track"], str(row["cycle"]), "\n".join(found) or "not fitted", rms, codes)
    return table
