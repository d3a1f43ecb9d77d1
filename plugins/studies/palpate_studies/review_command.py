"""``palpate repeat review``: which of many runs stand out, and which of them are left out of what comes after."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from palpate import ConfigurationError, UserError, suggest
from palpate_engine import display_unit, finite_tree, verdict_word
from palpate_kit.figures import force_unit
from palpate_kit.runs.review_file import Mark, write_mark
from palpate_kit.runs.run_groups import natural
from palpate_kit.terminal.options import FormatOption, TrackOption, WhereOption
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.result_screen import with_legend
from palpate_kit.terminal.result_table import ResultRow, ResultTable, TableValue
from palpate_kit.terminal.table import Table, console, shortened

from palpate_studies.parameter_values import ParameterValue, readings, tell_left_out

# What is left of the rating by a verdict; what cannot be used is worth nothing.
_BY_VERDICT = {"good": 1.0, "note": 1.0, "doubtful": 0.6, "invalid": 0.0}
_FAR = 3.5  # robust standard deviations (Iglewicz and Hoaglin 1993)
_FEWEST = 4  # of a group; among fewer nobody stands out
_WIDE = 110  # characters of a line without a terminal
_SURELY = 0.01  # of the median: a smaller spread does not matter


@dataclass(frozen=True)
class RatedValue:
    """One reading and how it stands in its group."""

    reading: ParameterValue
    apart: float | None  # of the value from the group's median, in robust standard deviations
    residual_apart: float | None  # the same of its residual, upwards only
    rating: float  # 0 to 10


def rate_values(group: Sequence[ParameterValue]) -> list[RatedValue]:
    """Readings with their ratings, the worst first.

    A rating is 10 times the share for the verdict, times 3.5/z for the value and for the residual where they are more
    than z = 3.5 robust standard deviations (1.4826 times the median absolute deviation) from the group's median; a
    residual that is small is not a fault. What was rejected, or cannot be used, does not count for the group.
    """
    values = _apart(group, [reading.value for reading in group])
    residuals = _apart(group, [reading.residual for reading in group])
    found = []
    for reading, value, residual in zip(group, values, residuals, strict=True):
        high = None if residual is None else max(residual, 0.0)
        share = _BY_VERDICT.get(reading.verdict, 0.0) if reading.value is not None else 0.0
        for apart in (value, high):
            share *= 1.0 if apart is None else min(1.0, _FAR / max(abs(apart), 1e-9))
        found.append(RatedValue(reading, value, high, 10.0 * share))
    return sorted(found, key=lambda one: (one.rating, natural(one.reading.name)))


def _apart(group: Sequence[ParameterValue], values: Sequence[float | None]) -> list[float | None]:
    """How far each value is from the median of what is usable; None where that is not known."""
    known = np.array([v for reading, v in zip(group, values) if reading.usable and v is not None and math.isfinite(v)])
    if len(known) < _FEWEST:
        return [None] * len(values)
    centre = float(np.median(known))
    spread = 1.4826 * float(np.median(np.abs(known - centre)))
    spread = max(spread, _SURELY * abs(centre), 1e-300)
    return [None if v is None or not math.isfinite(v) else (v - centre) / spread for v in values]


def review(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Run folders, or folders of `palpate fit`.")],
    track: TrackOption = None,
    parameter: Annotated[str, typer.Option(help="Parameter, or surface.")] = "elasticity",
    reject: Annotated[
        list[str] | None, typer.Option("--reject", metavar="NAME", help="Leave this one out from now on; nothing is "
                                       "deleted. Can be repeated.")
    ] = None,
    accept: Annotated[
        list[str] | None, typer.Option("--accept", metavar="NAME", help="Mark as good; a rejection is taken back. Can "
                                       "be repeated.")
    ] = None,
    clear: Annotated[
        list[str] | None, typer.Option("--clear", metavar="NAME", help="Take any mark back. Can be repeated.")
    ] = None,
    where: WhereOption = None,
    reason: Annotated[str | None, typer.Option(help="Why; required with --reject.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
    layout: FormatOption = "table",
) -> None:  # fmt: skip
    """List runs, cycles or curves, the worst first, by verdict, residual and distance from the others, and mark them.

    `repeat`, `map compare`, maps and reports leave out what is rejected, and say so.
    """
    if reject and not (reason or "").strip():
        raise ConfigurationError('--reject: say why, with --reason "..."')
    group, failures = _read(runs, track, parameter, where)
    if reject or accept or clear:
        marks: dict[Mark, Sequence[str]] = {"bad": reject or (), "good": accept or (), "none": clear or ()}
        _mark(group, marks, (reason or "").strip())
        group, failures = _read(runs, track, parameter, where)
    found = rate_values(group)
    if as_json:
        typer.echo(json.dumps(finite_tree({"parameter": parameter, "runs": [_row(one) for one in found]}), indent=2))
    else:
        terminal = console(_WIDE)
        terminal.print(shortened(_table(found, parameter)), highlight=False)
        terminal.print(_partition([one.reading for one in found], parameter), highlight=False)
    if failures:
        raise typer.Exit(1)


def _read(
    runs: Sequence[Path], track: str | None, parameter: str, where: str | None
) -> tuple[list[ParameterValue], int]:
    """All readings, and how many files could not be read; raises what the only one raised."""
    found: list[ParameterValue] = []
    failures: dict[str, UserError] = {}
    for path in sorted(set(runs), key=natural):
        try:
            found += readings(path, track, parameter, first=True, where=where)
        except UserError as error:
            failures[str(path)] = error.with_traceback(None)
    tell_left_out(failures, others=bool(found))
    if not found:
        nothing = "name at least one run folder" if where is None else f"--where {where!r}: holds of no curve"
        raise ConfigurationError(nothing)
    return found, len(failures)


_OPTIONS: dict[Mark, str] = {"bad": "--reject", "good": "--accept", "none": "--clear"}


def _mark(group: Sequence[ParameterValue], marks: Mapping[Mark, Sequence[str]], reason: str) -> None:
    """Write marks next to the results; raises ConfigurationError for a name that none, or more than one, has."""
    changes: list[tuple[ParameterValue, Mark]] = [
        (_named(group, name, _OPTIONS[mark]), mark) for mark, names in marks.items() for name in names
    ]
    for reading, mark in changes:
        write_mark(reading.folder, reading.key, mark, reason if mark == "bad" else "")


def _named(group: Sequence[ParameterValue], name: str, option: str) -> ParameterValue:
    exact = [reading for reading in group if name.rstrip("/") == reading.name]
    known = exact or [reading for reading in group if name in (Path(reading.name).name, reading.key or None)]
    if not known:
        raise ConfigurationError(f"{option}: no run is called {name!r}{suggest(name, [r.name for r in group])}")
    if len(known) > 1:
        raise ConfigurationError(f"{option}: {name!r} may be {' or '.join(reading.name for reading in known)}")
    return known[0]


def _partition(readings: Sequence[ParameterValue], parameter: str) -> str:
    """Return how many of some readings have which word, and how many of them are rejected."""
    rows = [
        ResultRow(one.name, one.track, {parameter: TableValue(parameter, one.value, math.nan, one.unit, one.verdict)})
        for one in readings
        if one.rejected is None
    ]
    line = ResultTable(tuple(rows), thing="value").partition()
    rejected = len(readings) - len(rows)
    return f"{line}; {rejected} more rejected" if rejected else line


def _row(one: RatedValue) -> dict[str, object]:
    reading = one.reading
    return {
        "name": reading.name, "track": reading.track, "rating": one.rating, "value": reading.value,
        "combined": reading.std, "unit": reading.unit, "apart": one.apart, "residual": reading.residual,
        "residual_apart": one.residual_apart, "verdict": reading.verdict,
        "flags": [flag.code for flag in reading.flags], "rejected": reading.rejected,
    }  # fmt: skip


def _table(found: Sequence[RatedValue], parameter: str) -> Table:
    word, factor = display_unit(found[0].reading.unit)
    known = [abs(one.reading.residual) for one in found if one.reading.residual is not None]
    force, newtons = force_unit(float(np.median(known)) if known else 1.0)
    headings = ["run", "rating", f"{parameter}\n{word}", "apart\nsigma", f"residual\n{force}", "verdict", "flags"]
    folders = dict.fromkeys(one.reading.folder for one in found)
    short = len(folders) == 1 and all(one.reading.key for one in found)
    rows = []
    for one in found:
        reading = one.reading
        value = (
            "-"
            if reading.value is None
            else value_with_uncertainty(reading.value * factor, (reading.std or 0.0) * factor)
        )
        is_doubted = verdict_word(reading.verdict) != "good"
        codes = "\n".join(dict.fromkeys(flag.code for flag in reading.flags if is_doubted and flag.severity != "note"))
        said = verdict_word(reading.verdict) if reading.rejected is None else f"rejected:\n{reading.rejected}"
        rows.append([
            reading.key if short else reading.name, f"{one.rating:.1f}", value, _number(one.apart, "+.1f"),
            "-" if reading.residual is None else f"{newtons * reading.residual:.3g}", said, codes,
        ])  # fmt: skip
    tracks = ", ".join(dict.fromkeys(one.reading.track for one in found))
    place = f" in {next(iter(folders))}" if short else ""
    return Table.of(with_legend(f"{tracks}{place}, the worst first"), headings, rows, ["run", "verdict", "flags"])


def _number(value: float | None, form: str) -> str:
    return "-" if value is None or not math.isfinite(value) else format(value, form)
