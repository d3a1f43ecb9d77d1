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
    found = {
        one.number: SweepRow.of(one, RunAnswer(done)) for one in planned if (done := cached_result(one.job)) is not None
    }
    earlier = len(found)
    gone: UserError | None = None
    try:
        _carry_out(planned, found, engine_of(scheduler, jobs, folder, stage))
    except UserError as error:
        gone = error
    rows = [row for one in planned if one.number in found for row in found[one.number].rows]
    write_rows(folder, rows)
    failed = _tell_failures(found)
    if gone is not None:
        raise gone
    if len(found) < len(planned):
        typer.echo(f"stopped after {len(found)} of {len(planned)} combinations; go on with --out {folder}", err=True)
        raise typer.Exit(130)
    if as_json:
        print_json({"folder": folder, "combinations": len(planned), "failed": failed, "rows": rows})
    elif failed < len(planned):
        screen = terminal()
        screen.print(best_rows(rows).view())
        for line in sweep_doubt_lines(rows):
            screen.print(line, style="yellow", highlight=False)
    before = f", {earlier} found in the folder" if earlier else ""
    typer.echo(
        f"{len(planned)} combinations, {failed} failed{before}: {folder / 'sweep.csv'}",
        err=as_json or layout != "table",
    )
    if (picture or points is not None) and failed < len(planned):
        runs = _runs(planned, found)
        with print_aside(as_json):
            analysis("map curves")(list(runs.values()), list(runs), points, folder / "sweep.png")
    if failed:
        raise typer.Exit(1)


def _carry_out(planned: Sequence[Combination], found: dict[int, SweepRow], engine: Engine) -> None:
    """Run what is not `found` yet, until all is done or somebody stops it; raises OtherSettingsError."""
    rest = {one.job.name: one for one in planned if one.number not in found}
    with (
        progress("sweep", "combinations", len(planned)),
        closing(engine([one.job for one in rest.values()])) as running,
        suppress(KeyboardInterrupt),
    ):
        report_progress(len(found))
        for job, outcome in running:
            if isinstance(outcome, StoppedError):
                return
            if isinstance(outcome, OtherSettingsError):
                raise outcome
            one = rest[job.name]
            found[one.number] = SweepRow.of(one, outcome)
            report_progress(len(found))


def _tell_failures(found: Mapping[int, SweepRow]) -> int:
    """Say which combinations failed, and why; how many."""
    failures = {number: done.failure for number, done in sorted(found.items()) if done.failure is not None}
    for number, reason in failures.items():
        typer.echo(f"combination {number} failed: {reason}", err=True)
    return len(failures)


def _planned(
    source: Source, combinations: Sequence[dict[str, Any]], overrides: list[str], folder: Path
) -> list[Combination]:
    return [
        Combination.of(number, values, _written(source, (*overrides, *_assignments(values))), folder)
        for number, values in enumerate(combinations, start=1)
    ]


def _written(source: Source, overrides: tuple[str, ...]) -> PortablePipeline:
    return PortablePipeline(source.text, source.path, overrides, source.named)


def _runs(planned: Sequence[Combination], found: Mapping[int, SweepRow]) -> dict[str, Path]:
    """The run of each combination that has one, by its values."""
    runs = {}
    for one in planned:
        if (folder := found[one.number].folder) is not None:
            told = ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in one.values.items())
            runs[told] = folder
    return runs


def _source(file: Path, overrides: Sequence[str]) -> Source:
    source = Source.read(file)
    for assignment in overrides:
        source.override(assignment)
    return source


def _assignments(values: dict[str, Any]) -> list[str]:
    return [f"{key}={tomli_w.dumps({'v': value}).strip().removeprefix('v = ')}" for key, value in values.items()]


def _folder(source: Source, wanted: Path | None) -> Path:
    """The sweep's folder: a new one, or one that holds a part of this very sweep."""
    if wanted is None or not (wanted / "sweep.toml").is_file():
        name = source.tables.get("run", {}).get("name", "run")
        folder = make_folder(f"{name}-sweep", wanted, datetime.now(UTC).astimezone())
        write_new(folder / "sweep.toml", source.text)
        return folder
    if bounded_text(wanted / "sweep.toml") != source.text:
        raise OutputError(f"{wanted}: holds the sweep of another pipeline file, or of this one before it was changed")
    return wanted
