"""``palpate sweep``: one pipeline with many settings, side by side, into one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import OutputError, UserError
from palpate_engine import Source, StoppedError, analysis, bounded_text, make_folder, write_new
from palpate_kit.jobs.engines import SchedulerOption, StageOption, engine_of
from palpate_kit.jobs.job import Engine, OtherSettingsError, PortablePipeline, RunAnswer, cached_result
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import FormatOption, JsonOption, Overrides, Points
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.table import console as terminal

from palpate_studies.sweep.combinations import Combination, assignments_of, combinations_of, refuse_hopeless
from palpate_studies.sweep.sweep_table import SweepRow, best_rows, sweep_doubt_lines, write_rows

_SETTINGS_FILE = "sweep.toml"  # of the folder: the pipeline file
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
    source = _source_with_overrides(file, overrides or [])
    combinations = combinations_of(source)
    # A new sweep makes no folder if all of it is likely to fail.
    if out is None or not (out / _SETTINGS_FILE).is_file():
        refuse_hopeless(_planned_combinations(source, combinations, overrides or [], Path()))
    folder = _sweep_folder(source, out)
    planned = _planned_combinations(source, combinations, overrides or [], folder)
    outcomes = _kept_outcomes(planned)
    kept_count = len(outcomes)
    # The rows of all runs are written before an error of the scheduler ends the command.
    scheduler_error: UserError | None = None
    try:
        _run_missing(planned, outcomes, engine_of(scheduler, jobs, folder, stage))
    except UserError as error:
        scheduler_error = error
    rows = [row for number in sorted(outcomes) for row in outcomes[number].rows]
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
    kept_text = f", {kept_count} found in the folder" if kept_count else ""
    typer.echo(
        f"{len(planned)} combinations, {failed} failed{kept_text}: {folder / 'sweep.csv'}",
        err=as_json or layout != "table",
    )
    if (picture or points is not None) and failed < len(planned):
        runs = _run_folders(planned, outcomes)
        with print_aside(as_json):
            analysis("map curves")(list(runs.values()), list(runs), points, folder / "sweep.png")
    if failed:
        raise typer.Exit(1)


def _kept_outcomes(planned: Sequence[Combination]) -> dict[int, SweepRow]:
    """Return the outcomes of an earlier attempt by the numbers of their combinations, which are not run again."""
    outcomes: dict[int, SweepRow] = {}
    for combination in planned:
        result = cached_result(combination.job)
        if result is not None:
            outcomes[combination.number] = SweepRow.of(combination, RunAnswer(result))
    return outcomes


def _print_best(rows: Sequence[dict[str, Any]]) -> None:
    """Print the best combinations, and the doubts about them."""
    screen = terminal()
    screen.print(best_rows(rows).view())
    for line in sweep_doubt_lines(rows):
        screen.print(line, style="yellow", highlight=False)


def _run_missing(planned: Sequence[Combination], outcomes: dict[int, SweepRow], engine: Engine) -> None:
    """Run the combinations without an outcome, and add theirs, until all are done or a person stops them.

    Raises OtherSettingsError.
    """
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
    """Print each combination that failed with the reason; return their number."""
    failures = {number: row.failure for number, row in sorted(outcomes.items()) if row.failure is not None}
    for number, reason in failures.items():
        typer.echo(f"combination {number} failed: {reason}", err=True)
    return len(failures)


def _planned_combinations(
    source: Source, combinations: Sequence[dict[str, Any]], overrides: list[str], folder: Path
) -> list[Combination]:
    """Return the combinations as jobs, numbered from 1."""
    planned: list[Combination] = []
    for number, values in enumerate(combinations, start=1):
        all_overrides = (*overrides, *assignments_of(values))
        plan = PortablePipeline(source.text, source.path, all_overrides, source.named)
        planned.append(Combination.of(number, values, plan, folder))
    return planned


def _run_folders(planned: Sequence[Combination], outcomes: Mapping[int, SweepRow]) -> dict[str, Path]:
    """Return the run folder of each combination that has one, by a label of its values, such as "theta 1 mm/s"."""
    folders = {}
    for combination in planned:
        folder = outcomes[combination.number].folder
        if folder is not None:
            label = ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in combination.values.items())
            folders[label] = folder
    return folders


def _source_with_overrides(file: Path, overrides: Sequence[str]) -> Source:
    """Return a pipeline file with its overrides."""
    source = Source.read(file)
    for assignment in overrides:
        source.override(assignment)
    return source


def _sweep_folder(source: Source, out: Path | None) -> Path:
    """Return the folder of a sweep: a new one, or one that holds a part of this very sweep; raises OutputError."""
    if out is None or not (out / _SETTINGS_FILE).is_file():
        name = source.tables.get("run", {}).get("name", "run")
        folder = make_folder(f"{name}-sweep", out, datetime.now(UTC).astimezone())
        write_new(folder / _SETTINGS_FILE, source.text)
        return folder
    if bounded_text(out / _SETTINGS_FILE) != source.text:
        raise OutputError(f"{out}: holds the sweep of another pipeline file, or of this one before it was changed")
    return out
