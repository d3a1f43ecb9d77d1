"""``palpate repeat review``: ratings of many runs, and marks on those that later commands leave out."""

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

from palpate_studies.parameter_values import ParameterValue, readings, report_left_out

# Share of the full rating by verdict, a choice: an invalid value cannot be used, a doubtful one may be right.
_VERDICT_SHARES = {"good": 1.0, "note": 1.0, "doubtful": 0.6, "invalid": 0.0}
_FULL_RATING = 10.0
_MAX_DISTANCE = 3.5  # robust standard deviations (Iglewicz and Hoaglin 1993)
_ROBUST_STD = 1.4826  # of the median absolute deviation, for a normal distribution
_MIN_GROUP = 4  # usable values of a group, a choice: among fewer nobody stands out
_MIN_SPREAD_SHARE = 0.01  # of the median, a choice: a smaller spread does not matter
_TINY_DISTANCE = 1e-9  # keeps a denominator above 0
_TINY_SPREAD = 1e-300  # the same
_WIDTH = 110  # characters of a line without a terminal, a choice: that of the table


@dataclass(frozen=True)
class RatedValue:
    """One reading with its rating and its distances from the group."""

    reading: ParameterValue
    value_distance: float | None  # from the group's median, in robust standard deviations
    residual_distance: float | None  # the same of the residual [N], 0 below the median
    rating: float  # 0 to 10


def rate_values(group: Sequence[ParameterValue]) -> list[RatedValue]:
    """Return readings with their ratings, the worst first.

    A rating is 10 times the share for the verdict, times min(1, 3.5/|z|) for the value and for the residual. Their
    distance z from the median of the group is in robust standard deviations, 1.4826 times the median absolute
    deviation; a residual below the median counts as 0. Readings that were rejected, or cannot be used, do not count
    for the group.
    """
    value_distances = _distances(group, [reading.value for reading in group])
    residual_distances = _distances(group, [reading.residual for reading in group])
    ratings: list[RatedValue] = []
    for reading, value_distance, residual_distance in zip(group, value_distances, residual_distances, strict=True):
        excess = None if residual_distance is None else max(residual_distance, 0.0)
        share = _VERDICT_SHARES.get(reading.verdict, 0.0) if reading.value is not None else 0.0
        share *= _distance_share(value_distance)
        share *= _distance_share(excess)
        ratings.append(RatedValue(reading, value_distance, excess, _FULL_RATING * share))
    return sorted(ratings, key=lambda rated: (rated.rating, natural(rated.reading.name)))


def _distance_share(distance: float | None) -> float:
    """Return the share of the full rating by a distance in standard deviations; 1 for an unknown one."""
    return 1.0 if distance is None else min(1.0, _MAX_DISTANCE / max(abs(distance), _TINY_DISTANCE))


def _distances(group: Sequence[ParameterValue], values: Sequence[float | None]) -> list[float | None]:
    """Return the distance of each value from the median of usable ones, in robust standard deviations.

    `values` are numbers of the readings of the group. None for a value that is not known, and for all of a small group.
    """
    usable = np.array([v for reading, v in zip(group, values) if reading.usable and v is not None and math.isfinite(v)])
    if len(usable) < _MIN_GROUP:
        return [None] * len(values)
    centre = float(np.median(usable))
    robust_std = _ROBUST_STD * float(np.median(np.abs(usable - centre)))
    spread = max(robust_std, _MIN_SPREAD_SHARE * abs(centre), _TINY_SPREAD)
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
    group, failure_count = _read_group(runs, track, parameter, where)
    if reject or accept or clear:
        names_by_mark: dict[Mark, Sequence[str]] = {"bad": reject or (), "good": accept or (), "none": clear or ()}
        _write_marks(group, names_by_mark, (reason or "").strip())
        group, failure_count = _read_group(runs, track, parameter, where)
    ratings = rate_values(group)
    if as_json:
        rows = [_json_row(rated) for rated in ratings]
        typer.echo(json.dumps(finite_tree({"parameter": parameter, "runs": rows}), indent=2))
    else:
        terminal = console(_WIDTH)
        terminal.print(shortened(_rating_table(ratings, parameter)), highlight=False)
        terminal.print(_partition([rated.reading for rated in ratings], parameter), highlight=False)
    if failure_count:
        raise typer.Exit(1)


def _read_group(
    runs: Sequence[Path], track: str | None, parameter: str, where: str | None
) -> tuple[list[ParameterValue], int]:
    """Return the readings of all files, and the number of files that could not be read.

    Raises the UserError of the first file if none could be read, ConfigurationError without any reading.
    """
    group: list[ParameterValue] = []
    failures: dict[str, UserError] = {}
    for path in sorted(set(runs), key=natural):
        try:
            group += readings(path, track, parameter, first=True, where=where)
        except UserError as error:
            failures[str(path)] = error.with_traceback(None)
    report_left_out(failures, has_values=bool(group))
    if not group:
        raise ConfigurationError(
            "name at least one run folder" if where is None else f"--where {where!r}: holds of no curve"
        )
    return group, len(failures)


_OPTIONS: dict[Mark, str] = {"bad": "--reject", "good": "--accept", "none": "--clear"}


def _write_marks(group: Sequence[ParameterValue], names_by_mark: Mapping[Mark, Sequence[str]], reason: str) -> None:
    """Write marks next to the results, a rejection with its reason.

    Raises ConfigurationError, before any is written, for a name that no reading or more than one has.
    """
    changes: list[tuple[ParameterValue, Mark]] = [
        (_reading_named(group, name, _OPTIONS[mark]), mark) for mark, names in names_by_mark.items() for name in names
    ]
    for reading, mark in changes:
        write_mark(reading.folder, reading.key, mark, reason if mark == "bad" else "")


def _reading_named(group: Sequence[ParameterValue], name: str, option: str) -> ParameterValue:
    """Return the reading with a whole name, else with its last part; raises ConfigurationError without a single one."""
    exact = [reading for reading in group if name.rstrip("/") == reading.name]
    candidates = exact or [reading for reading in group if name in (Path(reading.name).name, reading.key or None)]
    if not candidates:
        raise ConfigurationError(f"{option}: no run is called {name!r}{suggest(name, [r.name for r in group])}")
    if len(candidates) > 1:
        raise ConfigurationError(f"{option}: {name!r} may be {' or '.join(reading.name for reading in candidates)}")
    return candidates[0]


def _partition(readings: Sequence[ParameterValue], parameter: str) -> str:
    """Return the line with the numbers of readings of each verdict, and of rejected ones."""
    rows: list[ResultRow] = []
    for reading in readings:
        if reading.rejected is None:
            value = TableValue(parameter, reading.value, math.nan, reading.unit, reading.verdict)
            rows.append(ResultRow(reading.name, reading.track, {parameter: value}))
    line = ResultTable(tuple(rows), thing="value").partition()
    rejected_count = len(readings) - len(rows)
    return f"{line}; {rejected_count} more rejected" if rejected_count else line


def _json_row(rated: RatedValue) -> dict[str, object]:
    """Return a rated reading as plain data."""
    reading = rated.reading
    return {
        "name": reading.name, "track": reading.track, "rating": rated.rating, "value": reading.value,
        "combined": reading.std, "unit": reading.unit, "apart": rated.value_distance, "residual": reading.residual,
        "residual_apart": rated.residual_distance, "verdict": reading.verdict,
        "flags": [flag.code for flag in reading.flags], "rejected": reading.rejected,
    }  # fmt: skip


def _rating_table(ratings: Sequence[RatedValue], parameter: str) -> Table:
    """Return the table of rated readings; of a single folder of curves without its name in each row."""
    unit_symbol, factor = display_unit(ratings[0].reading.unit)
    # Residuals are in the unit of their median.
    residuals = [abs(rated.reading.residual) for rated in ratings if rated.reading.residual is not None]
    residual_unit, residual_factor = force_unit(float(np.median(residuals)) if residuals else 1.0)
    folders = dict.fromkeys(rated.reading.folder for rated in ratings)
    is_one_folder = len(folders) == 1 and all(rated.reading.key for rated in ratings)
    # A row for each reading.
    rows = []
    for rated in ratings:
        reading = rated.reading
        value, residual = "-", "-"
        if reading.value is not None:
            value = value_with_uncertainty(reading.value * factor, (reading.std or 0.0) * factor)
        if reading.residual is not None:
            residual = f"{residual_factor * reading.residual:.3g}"
        distance = _number(rated.value_distance, "+.1f")
        name = reading.key if is_one_folder else reading.name
        rows.append([name, f"{rated.rating:.1f}", value, distance, residual, *_verdict_cells(reading)])
    headings = ["run", "rating", f"{parameter}\n{unit_symbol}", "apart\nsigma", f"residual\n{residual_unit}"]
    headings += ["verdict", "flags"]
    tracks = ", ".join(dict.fromkeys(rated.reading.track for rated in ratings))
    place = f" in {next(iter(folders))}" if is_one_folder else ""
    return Table.of(with_legend(f"{tracks}{place}, the worst first"), headings, rows, ["run", "verdict", "flags"])


def _verdict_cells(reading: ParameterValue) -> tuple[str, str]:
    """Return the verdict of a reading, or its rejection, and the codes of the flags that count against it."""
    verdict = verdict_word(reading.verdict)
    codes = dict.fromkeys(flag.code for flag in reading.flags if verdict != "good" and flag.severity != "note")
    return verdict if reading.rejected is None else f"rejected:\n{reading.rejected}", "\n".join(codes)


def _number(value: float | None, form: str) -> str:
    """Return a number in a form; a dash for one that is not finite, and without one."""
    return "-" if value is None or not math.isfinite(value) else format(value, form)
