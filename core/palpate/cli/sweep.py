"""``palpate sweep``: one pipeline with many settings, side by side, into one table."""

from __future__ import annotations

import csv
import itertools
import json
import multiprocessing
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tomli_w
import typer

from palpate.cli.curves import Points, tell_runs
from palpate.config import Source, build_pipeline
from palpate.errors import ConfigurationError, OutputError, PalpateError, UserError
from palpate.result import make_folder, write_new


@dataclass(frozen=True)
class Job:
    """One combination, as plain data that any engine can send anywhere."""

    number: int
    text: str  # of the pipeline file
    path: str  # where the file stands: what is relative in it is relative to here
    overrides: tuple[str, ...]  # "table.key=value"
    values: dict[str, Any]  # what is swept
    folder: str  # in which the run makes its own


Engine = Callable[[Sequence[Job]], Generator[tuple[Job, dict[str, Any]]]]  # results in any order


def sweep(
    file: Annotated[Path, typer.Argument(help="A pipeline file with a [sweep] table.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the sweep; one that holds a part of it is gone on with. [default: runs/...]"),
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Override a setting; can be repeated.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Runs at a time. [default: one per core]", min=1)] = None,
    picture: Annotated[
        bool, typer.Option("--picture", help="Draw the estimates along the way of all combinations, with their lumps.")
    ] = False,
    points: Points = None,
) -> None:
    """Run a pipeline with every combination of the settings in its [sweep] table; write sweep.csv and sweep.json."""
    from rich.console import Console
    from rich.progress import Progress

    source = _source(file, overrides or [])
    combinations = combinations_of(source)
    folder = _folder(source, out)
    planned = [
        Job(number, source.text, str(source.path), (*(overrides or []), *_assignments(values)), values, str(folder))
        for number, values in enumerate(combinations, start=1)
    ]
    found = {job.number: done for job in planned if (done := finished(job)) is not None}
    rest = [job for job in planned if job.number not in found]
    if not found:
        _refuse_hopeless(planned)
    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(f"{len(planned)} combinations", total=len(planned), completed=len(found))
        with closing(on_all_cores(rest, jobs)) as running:
            for job, result in running:
                found[job.number] = result
                bar.advance(task)
    rows = [row for job in planned for row in rows_of(job, found[job.number])]
    _write(folder, rows)
    failed = sum("error" in result for result in found.values())
    earlier = len(planned) - len(rest)
    typer.echo(
        f"{len(planned)} combinations, {failed} failed"
        + (f", {earlier} found in the folder" if earlier else "")
        + f": {folder / 'sweep.csv'}"
    )
    if failed == len(planned):
        raise typer.Exit(1)
    if picture or points is not None:
        tell_runs(_runs(planned), folder, points)


def _runs(planned: Sequence[Job]) -> dict[str, Path]:
    """The latest run of each combination, by its values."""
    runs = {}
    for job in planned:
        told = ", ".join(f"{key.rpartition('.')[2]} {value}" for key, value in job.values.items())
        for run in sorted(Path(job.folder).glob(f"{job.number:05d}*"))[-1:]:
            runs[told] = run
    return runs


def combinations_of(source: Source) -> list[dict[str, Any]]:
    """The combinations that a [sweep] table asks for, each a value for every swept setting.

    Raises ConfigurationError where the table is missing, empty, or not made of lists.
    """
    table = source.tables.get("sweep")
    if not isinstance(table, dict):
        raise ConfigurationError(
            f'{source.path}: the table [sweep] is missing: give lists of values, such as "estimator.ekf.force_std" = '
            '["0.03 N", "0.05 N"]'
        )
    lists = dict(_lists(source, {key: value for key, value in table.items() if key != "combine"}, ()))
    if not lists:
        raise ConfigurationError(f"{source.where(('sweep',))}: [sweep] names no setting")
    combine = table.get("combine", "grid")
    if combine == "list":
        lengths = {key: len(values) for key, values in lists.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{key} has {length}" for key, length in lengths.items())
            raise ConfigurationError(
                f'{source.where(("sweep",))}: [sweep] combine = "list" wants lists of one length: {told}'
            )
        tuples: Iterable[tuple[Any, ...]] = zip(*lists.values(), strict=True)
    elif combine == "grid":
        tuples = itertools.product(*lists.values())
    else:
        raise ConfigurationError(
            f'{source.where(("sweep", "combine"))}: [sweep] combine: {combine!r} is none of "grid", "list"'
        )
    return [dict(zip(lists, values, strict=True)) for values in tuples]


def _lists(source: Source, table: dict[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, list[Any]]]:
    """Lists by dotted setting; a key may be dotted in quotes, or without them, which makes tables in tables."""
    for key, value in table.items():
        where = (*path, key)
        if isinstance(value, dict):
            yield from _lists(source, value, where)
            continue
        name = ".".join(where)
        if not isinstance(value, list) or not value:
            raise ConfigurationError(
                f"{source.where(('sweep', *where))}: [sweep] {name}: {value!r}: must be a list of values"
            )
        if "." not in name:
            raise ConfigurationError(
                f"{source.where(('sweep', *where))}: [sweep] {name}: must be a setting with its table, "
                'such as "estimator.ekf.force_std"'
            )
        yield name, value


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


def _build(job: Job) -> Any:
    source = Source(job.text, Path(job.path))
    for assignment in job.overrides:
        source.override(assignment)
    return build_pipeline(source)


def _refuse_hopeless(planned: Sequence[Job]) -> None:
    """Raise what is wrong with the first combination if the last one is wrong, too: then it is not a value's fault."""
    try:
        _build(planned[0])
    except UserError as error:
        try:
            _build(planned[-1])
        except UserError:
            raise error from None


def run_job(job: Job) -> dict[str, Any]:
    """Run one combination; its ``result.json``, or ``{"error": reason}``. For any process on any machine."""
    from palpate.pipeline import run_pipeline

    try:
        pipeline = _build(job)
        return run_pipeline(pipeline, _free(job)).table()
    except PalpateError as error:
        return {"error": str(error)}
    except Exception as error:  # one broken plugin must not end a night's sweep
        return {"error": f"{type(error).__name__}: {error}"}


def _free(job: Job) -> Path:
    """A folder that no earlier attempt has used."""
    for attempt in itertools.count(1):
        folder = Path(job.folder) / (f"{job.number:05d}" if attempt == 1 else f"{job.number:05d}-{attempt}")
        if not folder.exists():
            return folder
    raise AssertionError


def finished(job: Job) -> dict[str, Any] | None:
    """What an earlier, interrupted sweep found for a combination; None where it did not get that far."""
    for path in sorted(Path(job.folder).glob(f"{job.number:05d}*/result.json")):
        result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if not any("interrupted:" in flag for track in result["tracks"].values() for flag in track["flags"]):
            return result
    return None


def on_all_cores(jobs: Sequence[Job], workers: int | None = None) -> Generator[tuple[Job, dict[str, Any]]]:
    """The engine of this machine: as many processes as cores."""
    count = min(workers or len(os.sched_getaffinity(0)), len(jobs))
    if count <= 1:
        yield from ((job, run_job(job)) for job in jobs)
        return
    context = multiprocessing.get_context("spawn")  # forking a process with threads is asking for trouble
    with ProcessPoolExecutor(count, mp_context=context) as pool:
        running = {pool.submit(run_job, job): job for job in jobs}
        try:
            for future in as_completed(running):
                error = future.exception()
                yield running[future], future.result() if error is None else {"error": f"lost: {error}"}
        finally:
            pool.shutdown(cancel_futures=True)


def rows_of(job: Job, result: dict[str, Any]) -> list[dict[str, Any]]:
    """One row for each track of a combination; one with the reason where it failed."""
    head = {"combination": job.number, **job.values}
    if "error" in result:
        return [{**head, "error": result["error"]}]
    rows = []
    for name, track in result["tracks"].items():
        row = {**head, "track": name}
        for parameter, found in {**track["parameters"], "surface": track["surface"]}.items():
            row |= {f"{parameter} [{found['unit']}]": found["value"], f"{parameter}_std": found["std"]}
            row |= {f"{parameter}_{key}": found[key] for key in ("systematic", "combined") if key in found}
        truth = {f"{parameter}_truth": value for parameter, value in result["truth"].items()}
        rows.append(row | truth | {key: track[key] for key in ("force_rms", "nis", "flags")})
    return rows


def _write(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    columns = list(dict.fromkeys(column for row in rows for column in row if column not in ("flags", "error")))
    columns += ["flags", "error"]
    partial = folder / "sweep.csv.part"
    with partial.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows({**row, "flags": "; ".join(row.get("flags", []))} for row in rows)
    partial.replace(folder / "sweep.csv")
    (folder / "sweep.json").write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n", encoding="utf-8")
