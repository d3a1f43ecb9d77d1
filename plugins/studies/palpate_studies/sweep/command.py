"""``palpate sweep``: one pipeline with many settings, side by side, into one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tomli_w
import typer
from palpate import OutputError, UserError
from palpate.host import (
    Engine,
    FormatOption,
    Job,
    JsonOption,
    Overrides,
    Points,
    Source,
    analysis,
    aside,
    built,
    console as terminal,
    finished,
    make_folder,
    print_json,
    progress,
    progressed,
    write_new,
)

from palpate_studies.engines import SchedulerOption, StageOption, engine_of
from palpate_studies.sweep.combinations import combinations_of
from palpate_studies.sweep.table import best_rows, rows_of, write_rows


def sweep(
    file: Annotated[Path, typer.Argument(help="A pipeline file with a [sweep] table.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the sweep; one that holds a part of it is gone on with. [default: runs/...]"),
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
        _refuse_hopeless(_planned(source, combinations, overrides or [], Path()))
    folder = _folder(source, out)
    planned = _planned(source, combinations, overrides or [], folder)
    found = {job.number: done for job in planned if (done := finished(job)) is not None}
    earlier = len(found)
    gone: UserError | None = None
    try:
        _carry_out(planned, found, engine_of(scheduler, jobs, folder, stage))
    except UserError as error:
        gone = error
    rows = [row for job in planned if job.number in found for row in rows_of(job, found[job.number])]
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
        terminal().print(best_rows(rows).view())
    before = f", {earlier} found in the folder" if earlier else ""
    typer.echo(
        f"{len(planned)} combinations, {failed} failed{before}: {folder / 'sweep.csv'}",
        err=as_json or layout != "table",
    )
    if failed == len(planned):
        raise typer.Exit(1)
    if picture or points is not None:
        runs = _runs(planned)
        with aside(as_json):
            analysis("curves")(list(runs.values()), list(runs), points, folder / "sweep.png")


def _carry_out(planned: Sequence[Job], found: dict[int, dict[str, Any]], engine: Engine) -> None:
    """Run what is not `found` yet, until all is done or somebody stops it."""
    rest = [job for job in planned if job.number not in found]
    with progress("sweep", "combinations", len(planned)), closing(engine(rest)) as running:
        progressed(len(found))
        for job, result in running:
            if "interrupted" in result:
                return
            found[job.number] = result
            progressed(len(found))


def _tell_failures(found: Mapping[int, dict[str, Any]]) -> int:
    """Say which combinations failed, and why; how many."""
    failures = {number: result["error"] for number, result in sorted(found.items()) if "error" in result}
    for number, reason in failures.items():
        typer.echo(f"combination {number} failed: {reason}", err=True)
    return len(failures)


def _planned(source: Source, combinations: Sequence[dict[str, Any]], overrides: list[str], folder: Path) -> list[Job]:
    return [
        Job(number, source.text, str(source.path), (*overrides, *_assignments(values)), values, str(folder))
        for number, values in enumerate(combinations, start=1)
    ]


def _runs(planned: Sequence[Job]) -> dict[str, Path]:
    """The latest run of each combination, by its values."""
    runs = {}
    for job in planned:
        told = ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in job.values.items())
        for run in sorted(Path(job.folder).glob(f"{job.number:05d}*"))[-1:]:
            runs[told] = run
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
    if (wanted / "sweep.toml").read_text(encoding="utf-8") != source.text:
        raise OutputError(f"{wanted}: holds the sweep of another pipeline file, or of this one before it was changed")
    return wanted


def _refuse_hopeless(planned: Sequence[Job]) -> None:
    """Raise what is wrong with the first combination if the last one is wrong, too: then it is not a value's fault."""
    try:
        built(planned[0])
    except UserError as error:
        try:
            built(planned[-1])
        except UserError:
            raise error from None
