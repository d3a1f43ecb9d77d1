"""``palpate sweep``: one pipeline with many settings, side by side, into one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tomli_w
import typer
from palpate import OutputError, UserError
from palpate_engine import Source, StoppedError, analysis, bounded_text, make_folder, write_new
from palpate_kit.jobs.engines import SchedulerOption, StageOption, engine_of
from palpate_kit.jobs.job import Engine, OtherSettingsError, PortablePipeline, RunAnswer, cached_result
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FormatOption, JsonOption, Overrides, Points
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.table import console as terminal

from palpate_studies.sweep.combinations import Combination, combinations_of, refuse_hopeless
from palpate_studies.sweep.sweep_table import SweepRow, best_rows, sweep_doubt_lines, write_rows

_INTERRUPTED = 130  # exit code of a command that was stopped from the keyboard: 128 and the number of the signal


def sweep(
    file: Annotated[Path, typer.Argument(help="A pipeline file with a [sweep] table.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Folder of the sweep; one that holds a part of it is continued. [default: runs/...]"
        ),
    ] = None,
    overrides: Overrides = None,
    jobs: Annotated[int | None, typer.Option(help="Runs at a time. [default: one per core]", min=1)] = None,
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
    picture: Annotated[
        bool, typer.Option("--picture", help="Draw the estimates along the way of all combinations, with their lumps.")
    ] = False,
    points: Points = None,
    as_json: JsonOption = False,
    layout: FormatOption = "table",
) -> None:
    """Run a pipeline with every combination of the settings in its [sweep] table; write sweep.csv and sweep.json."""
    source = _source(file, overrides or [])
    combinations = combinations_of(source)
    if out is None or not (out / "sweep.toml").is_file():
        refuse_hopeless(_planned(source, combinations, overrides or [], Path()))
    folder = _folder(source, out)
    planned = _planned(source, combinations, overrides or [], folder)
    outcomes: dict[int, SweepRow] = {}
    for combination in planned:
        if (result := cached_result(combination.job)) is not None:
            outcomes[combination.number] = SweepRow.of(combination, RunAnswer(result))
    earlier = len(outcomes)
    # The rows of all that was done are written before an error of the scheduler ends the command.
    scheduler_error: UserError | None = None
    try:
        _carry_out(planned, outcomes, engine_of(scheduler, jobs, folder, stage))
    except UserError as error:
        scheduler_error = error
    rows = [row for item in planned if item.number in outcomes for row in outcomes[item.number].rows]
    write_rows(folder, rows)
    failed = _report_failures(outcomes)
    if scheduler_error is not None:
        raise scheduler_error
    if len(outcomes) < len(planned):
        typer.echo(f"stopped after {len(outcomes)} of {len(planned)} combinations; go on with --out {folder}", err=True)
        raise typer.Exit(_INTERRUPTED)
    if as_json:
        print_json({"folder": folder, "combinations": len(planned), "failed": failed, "rows": rows})
    elif failed < len(planned):
        _print_best(rows)
    before = f", {earlier} found in the folder" if earlier else ""
    typer.echo(
        f"{len(planned)} combinations, {failed} failed{before}: {folder / 'sweep.csv'}",
        err=as_json or layout != "table",
    )
    if (picture or points is not None) and failed < len(planned):
        runs = _runs(planned, outcomes)
        with print_aside(as_json):
            analysis("map curves")(list(runs.values()), list(runs), points, folder / "sweep.png")
    if failed:
        raise typer.Exit(1)


def _print_best(rows: Sequence[dict[str, Any]]) -> None:
    """Print the best combinations, and the doubts about them."""
    screen = terminal()
    screen.print(best_rows(rows).view())
    for line in sweep_doubt_lines(rows):
        screen.print(line, style="yellow", highlight=False)


def _carry_out(planned: Sequence[Combination], outcomes: dict[int, SweepRow], engine: Engine) -> None:
    """Run the combinations without an outcome, until all are done or a person stops it; raises OtherSettingsError."""
    remaining = {item.job.name: item for item in planned if item.number not in outcomes}
    with (
        progress("sweep", "combinations", len(planned)),
        closing(engine([item.job for item in remaining.values()])) as running,
        suppress(KeyboardInterrupt),
    ):
        report_progress(len(outcomes))
        for job, outcome in running:
            if isinstance(outcome, StoppedError):
                return
            if isinstance(outcome, OtherSettingsError):
                raise outcome
            combination = remaining[job.name]
            outcomes[combination.number] = SweepRow.of(combination, outcome)
            report_progress(len(outcomes))


def _report_failures(outcomes: Mapping[int, SweepRow]) -> int:
    """Report which combinations failed, and why; return their number."""
    failures = {number: row.failure for number, row in sorted(outcomes.items()) if row.failure is not None}
    for number, reason in failures.items():
        typer.echo(f"combination {number} failed: {reason}", err=True)
    return len(failures)


def _planned(
    source: Source, combinations: Sequence[dict[str, Any]], overrides: list[str], folder: Path
) -> list[Combination]:
    """Return the combinations as jobs, numbered from 1."""
    return [
        Combination.of(number, values, _written(source, (*overrides, *_assignments(values))), folder)
        for number, values in enumerate(combinations, start=1)
    ]


def _written(source: Source, overrides: tuple[str, ...]) -> PortablePipeline:
    """Return a source with its overrides as any process can build it."""
    return PortablePipeline(source.text, source.path, overrides, source.named)


def _runs(planned: Sequence[Combination], outcomes: Mapping[int, SweepRow]) -> dict[str, Path]:
    """Return the run of each combination that has one, by its values."""
    runs = {}
    for combination in planned:
        folder = outcomes[combination.number].folder
        if folder is not None:
            label = ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in combination.values.items())
            runs[label] = folder
    return runs


def _source(file: Path, overrides: Sequence[str]) -> Source:
    """Return a pipeline file with its overrides."""
    source = Source.read(file)
    for assignment in overrides:
        source.override(assignment)
    return source


def _assignments(values: dict[str, Any]) -> list[str]:
    """Return the values of a combination as assignments."""
    return [f"{key}={tomli_w.dumps({'v': value}).strip().removeprefix('v = ')}" for key, value in values.items()]


def _folder(source: Source, out: Path | None) -> Path:
    """Return the sweep's folder: a new one, or one that holds a part of this very sweep; raises OutputError."""
    if out is None or not (out / "sweep.toml").is_file():
        name = source.tables.get("run", {}).get("name", "run")
        folder = make_folder(f"{name}-sweep", out, datetime.now(UTC).astimezone())
        write_new(folder / "sweep.toml", source.text)
        return folder
    if bounded_text(out / "sweep.toml") != source.text:
        raise OutputError(f"{out}: holds the sweep of another pipeline file, or of this one before it was changed")
    return out
