"""What people see of offline fits: comparison, budget, evaluation on other logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from palpate.cli.quantities import measured
from palpate.result import TrackResult
from palpate.units import people

if TYPE_CHECKING:
    from rich.console import RenderableType

Tracks = Mapping[str, TrackResult]


def fit_views(
    logs: Mapping[str, tuple[Tracks, Sequence[str]]],
    crossed: Sequence[dict[str, Any]],
    cycles: Sequence[dict[str, Any]],
) -> Iterator[RenderableType]:
    """Comparison of all fits, their evidence and flags, budgets, evaluation on other logs, and cycles."""
    from rich.text import Text

    yield comparison({name: tracks for name, (tracks, _) in logs.items()})
    for name, (tracks, flags) in logs.items():
        head = f"{name}: " if len(logs) > 1 else ""
        if sentence := evidence(tracks):
            yield Text(head + sentence)
        for text in (*flags, *(f"{label}: {text}" for label, track in tracks.items() for text in track.flags)):
            yield Text(f"  {head}{text}", style="yellow")
    for name, (tracks, _) in logs.items():
        for label, track in tracks.items():
            if track.details.get("budget"):
                yield budget(f"{name}: {label}", track)
    if crossed:
        yield evaluation(crossed)
    if cycles:
        yield by_cycle(cycles)


def comparison(logs: Mapping[str, Tracks]) -> RenderableType:
    """One row for each fit: parameters with uncertainty, residual, evidence, autocorrelation, flags."""
    from rich.table import Table

    table = Table(title="offline fits", title_justify="left")
    several = len(logs) > 1
    for heading in (*(["log"] if several else []), "track", "parameters", "surface\nmm"):
        table.add_column(heading, no_wrap=heading in ("track", "parameters"))
    for heading in ("residual\nN^2", "RMS\nN", "AIC", "BIC", "auto-\ncorrelation", "samples,\neffective", "flags"):
        table.add_column(heading, justify="right")
    for log, tracks in logs.items():
        for label, track in tracks.items():
            table.add_row(*([log] if several else []), label, *_row(track))
    return table


def _row(track: TrackResult) -> list[str]:
    codes = " ".join(sorted({text.partition(":")[0] for text in track.flags}))
    details = track.details
    if not details.get("fit"):
        return ["not fitted", "", "", "", "", "", "", "", codes]
    parameters = "\n".join(_parameter(name, found) for name, found in track.parameters.items())
    extra = [
        _parameter(name, known)
        for name, known in details["unknowns"].items()
        if known["free"] and name not in track.parameters and name != "surface"
    ]
    memory = details["autocorrelation"]
    return [
        "\n".join([parameters, *extra]),
        measured(1e3 * track.surface.value, 1e3 * track.surface.combined),
        f"{details['rss']:.4g}",
        f"{details['rms']:.4g}",
        f"{details['aic']:.1f}",
        f"{details['bic']:.1f}",
        f"{memory['first']:.2f}",
        f"{details['samples']}\n{memory['effective_samples']:.0f}",
        codes,
    ]


def _parameter(name: str, found: Any) -> str:
    value, std, unit = (found.value, found.combined, found.unit) if not isinstance(found, dict) else (
        found["value"],
        found["std"],
        found["unit"],
    )  # fmt: skip
    word, factor = people(unit)
    return f"{name} {measured(value * factor, std * factor)} {word}"


def evidence(tracks: Tracks) -> str:
    """Which model the record prefers, by BIC; empty where there is nothing to compare."""
    fits = {name: track.details for name, track in tracks.items() if track.details.get("fit")}
    if len(fits) < 2:
        return ""
    if len({(details["samples"], details["segment"]) for details in fits.values()}) > 1:
        return "the fits use different samples, so AIC and BIC do not compare them"
    ranked = sorted(fits, key=lambda name: (fits[name]["bic"], name))
    best = fits[ranked[0]]["bic"]
    behind = ", ".join(f"{name} (BIC +{fits[name]['bic'] - best:.1f})" for name in ranked[1:])
    return f"the record prefers {ranked[0]} over {behind}"


def budget(title: str, track: TrackResult) -> RenderableType:
    """Source, standard uncertainty, and for each parameter sensitivity and contribution."""
    from rich.table import Table

    rows = track.details["budget"]
    names = [name for name in track.parameters if name in rows[0]["effects"]]
    table = Table(title=f"uncertainty budget of {title}", title_justify="left")
    table.add_column("source")
    table.add_column("u", justify="right")
    for name in names:
        table.add_column(f"{name}\n{track.parameters[name].unit} per unit", justify="right")
        table.add_column("u\n%", justify="right")
    for row in rows:
        cells = []
        for name in names:
            effect = row["effects"][name]
            cells.append("" if effect["sensitivity"] is None else f"{effect['sensitivity']:.3g}")
            cells.append("?" if effect["percent"] is None else f"{effect['percent']:.3f}")
        table.add_row(row["source"], "" if row["u"] is None else f"{row['u']:.3g} {row['unit']}", *cells)
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
        found = [_parameter(name, known) for name, known in row["unknowns"].items() if known["free"]]
        codes = " ".join(sorted({text.partition(":")[0] for text in row["flags"]}))
        rms = "-" if row["rms"] is None else f"{row['rms']:.4g}"
        table.add_row(row["log"], row["track"], str(row["cycle"]), "\n".join(found) or "not fitted", rms, codes)
    return table
