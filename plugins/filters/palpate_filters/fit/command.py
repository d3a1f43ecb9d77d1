"""``palpate fit``: offline fits of several models to several logs, side by side."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import Batch, ConfigurationError, Estimates, Problem, Samples, UserError
from palpate.host import (
    Carried,
    FormatOption,
    Overrides,
    Pipeline,
    Result,
    SchedulerOption,
    Source,
    TrackResult,
    build_pipeline,
    carried_by,
    connected,
    console,
    finite_tree,
    load_pipeline,
    make_folder,
    progress,
    progressed,
    replay_source,
    run_pipeline,
    spread,
    taken_values,
    withdraw_folder,
    write_whole,
)

from palpate_filters.fit.each import Reader, curve_files, curves_by, fit_each
from palpate_filters.fit.tables import each_table, fit_views

# Settings of an estimator that can evaluate on one log what was found on another.
_REFITTED = {"fixed", "bounds", "start_at", "profile", "systematic", "contact_point", "solver", "bootstrap"}


@dataclass
class KeptRun:
    """A writer that keeps samples and offline estimates in memory, for tables and pictures."""

    blocks: list[Samples] = field(default_factory=list)
    found: dict[str, Estimates] = field(default_factory=dict)

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not kept."""

    def samples(self, samples: Samples) -> None:
        """Keep a block."""
        self.blocks.append(samples)

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Keep the estimates of a track."""
        self.found[track] = estimates


@dataclass(frozen=True)
class LogFit:
    """One log with the fits of every track."""

    name: str
    pipeline: Pipeline
    result: Result
    samples: Samples
    estimates: dict[str, Estimates]

    @property
    def fitted(self) -> dict[str, TrackResult]:
        """Tracks whose fit succeeded."""
        return {name: track for name, track in self.result.tracks.items() if track.report is not None}


def fit(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...", help="Pipeline files, or logs that --pipeline can read; folders, with --each."
        ),
    ],
    pipeline: Annotated[
        Path | None, typer.Option(help="How to read the logs: a pipeline with one device that has a file.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; must be new or empty. [default: runs/DATE_TIME_fit]")
    ] = None,
    overrides: Overrides = None,
    carry: Annotated[
        bool,
        typer.Option(help="Evaluate what was fitted on each log on all others with the surface of the first, too."),
    ] = False,
    cycles: Annotated[bool, typer.Option("--cycles", help="Fit every cycle of a log by itself.")] = False,
    scheduler: SchedulerOption = None,
    pictures: Annotated[bool, typer.Option(help="Draw force over time and depth, and residuals.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print fit.json instead of the tables.")] = False,
    layout: FormatOption = "table",
    each: Annotated[
        bool, typer.Option("--each", help="Thousands of curves, one a file: a row of fits.csv each; --out goes on.")
    ] = False,
    by: Annotated[str | None, typer.Option(help="With --each: a new curve begins where this channel changes.")] = None,
    workers: Annotated[int | None, typer.Option(help="With --each: processes. [default: all cores]", min=1)] = None,
) -> None:
    """Fit every offline track to every log; compare, and evaluate what was found on one log on the others."""
    if each or by:
        if scheduler is not None:
            raise ConfigurationError("--each fits curves on the cores of this machine; it has no --scheduler")
        _each(sources, pipeline, overrides or [], out, by, workers, as_json)
        return
    failures: dict[str, UserError] = {}
    with progress(f"look at {len(sources)} sources"):
        loaded = _pipelines(sources, pipeline, overrides or [], failures)
    folder = make_folder("fit", out, datetime.now(UTC).astimezone())
    logs: list[LogFit] = []
    for name, outcome in _outcomes(loaded, folder, scheduler):
        if isinstance(outcome, UserError):
            _failed(name, outcome, failures)
            continue
        logs.append(outcome)
        write_whole(folder / "fit.json", _text(_document(logs, [], [])))  # what is found until now
    given = [name for name, _ in loaded]
    logs.sort(key=lambda log: given.index(log.name))
    if not logs:
        withdraw_folder(folder)
        raise next(iter(failures.values()))
    crossed = evaluate(logs, carry) if len(logs) > 1 else []
    by_cycle = [row for log in logs for row in each_cycle(log)] if cycles else []
    document = _document(logs, crossed, by_cycle)
    write_whole(folder / "fit.json", _text(document))
    if pictures:
        from palpate_filters.fit.pictures import draw

        for log in logs:
            draw(log.samples, log.estimates, log.pipeline.alignment.tip_mass or 0.0, log.result.folder)
    if as_json:
        typer.echo(json.dumps(document, indent=2))
    else:
        terminal = console(160)
        tables = {log.name: (log.result.tracks, log.result.flags) for log in logs}
        for view in fit_views(tables, crossed, by_cycle):
            terminal.print(view)
        terminal.print(f"written to {folder}", highlight=False, markup=False)
    if failures:
        typer.echo(f"{len(failures)} of {len(sources)} logs failed: {', '.join(failures)}", err=True)
        raise typer.Exit(1)


def _each(
    sources: Sequence[Path],
    reader: Path | None,
    overrides: list[str],
    out: Path | None,
    by: str | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Many curves, each a row of a table."""
    if reader is None:
        raise ConfigurationError("--each: say with --pipeline FILE how a curve is read")
    device = _log_device(load_pipeline(reader, overrides), reader)
    files = list(curve_files(sources, type(load_pipeline(reader, overrides).devices[device])))
    assignments = [*overrides, f"device.{device}.file={json.dumps(str(files[0].file))}"]
    pipeline = _offline(load_pipeline(reader, assignments))
    log = pipeline.devices[device]
    curves = curves_by([log.model_copy(update={"file": Path(one.file)}) for one in files], by) if by else files
    told = Reader(pipeline.text, str(pipeline.path), tuple(assignments), device)
    folder = out or make_folder("fit", None, datetime.now(UTC).astimezone())
    with progress("fit", "curves", None if by else len(files)):
        table = fit_each(pipeline, told, curves, folder, workers)
    found = table.summary()
    if as_json:
        typer.echo(json.dumps({"table": str(table.path), "tracks": found}, indent=2))
    else:
        console(160).print(each_table(found).view())
        typer.echo(f"written to {table.path}")
    if failed := sum(track["failed"] for track in found.values()):
        typer.echo(f"{failed} fits of {sum(track['curves'] for track in found.values())} failed", err=True)
        raise typer.Exit(1)


def _outcomes(
    loaded: Sequence[tuple[str, Pipeline]], folder: Path, scheduler: str | None
) -> Iterator[tuple[str, LogFit | UserError]]:
    """What every log gives, as it is ready: in their order here, in any order on the workers of a scheduler."""
    tasks = [_FitTask(name, pipeline, folder.resolve() / name) for name, pipeline in loaded]
    if scheduler is None:
        yield from ((task.name, _fit_task(replace(task, folder=folder / task.name))) for task in tasks)
        return
    with connected(scheduler, folder) as client:
        for task, outcome in spread(client, _fit_task, tasks):
            if isinstance(outcome, LogFit | UserError):
                yield task.name, outcome
            else:
                yield task.name, UserError(f"lost: {type(outcome).__name__}: {outcome}")


@dataclass(frozen=True)
class _FitTask:
    """One log to be fitted, by any process."""

    name: str
    pipeline: Pipeline
    folder: Path


def _fit_task(task: _FitTask) -> LogFit | UserError:
    folder = task.folder
    for attempt in range(2, 100):  # a worker that was killed left the first
        if not folder.exists():
            break
        folder = task.folder.with_name(f"{task.name}-{attempt}")
    try:
        return _fitted(task.name, task.pipeline, folder)
    except UserError as error:
        return error


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _failed(name: str, error: UserError, failures: dict[str, UserError]) -> None:
    """Note and tell that a log of many is left out, and why."""
    failures[name] = error
    typer.echo(f"{name} is left out: {error}", err=True)


def _pipelines(
    sources: Sequence[Path], reader: Path | None, overrides: list[str], failures: dict[str, UserError]
) -> list[tuple[str, Pipeline]]:
    """Every source as a pipeline, with a name of its own; of many, one that cannot be read is a failure of its own."""
    found: list[tuple[str, Pipeline]] = []
    taken: set[str] = set()
    for source in sources:
        try:
            loaded = _offline(_pipeline(source, reader, overrides))
        except UserError as error:
            if len(sources) == 1:
                raise
            _failed(str(source), error, failures)
            continue
        stem = source.name.split(".")[0] or "log"
        name = next(n for k in range(len(sources) + 1) if (n := stem if k == 0 else f"{stem}-{k + 1}") not in taken)
        taken.add(name)
        found.append((name, loaded))
    return found


def _pipeline(source: Path, reader: Path | None, overrides: list[str]) -> Pipeline:
    if not source.exists():
        raise ConfigurationError(f"{source}: there is no such file")
    if source.suffix == ".toml":
        return load_pipeline(source, overrides)
    if reader is None:
        return _carried(source, overrides)
    device = _log_device(load_pipeline(reader, overrides), reader)
    return load_pipeline(reader, [*overrides, f"device.{device}.file={json.dumps(str(source.resolve()))}"])


def _carried(log: Path, overrides: list[str]) -> Pipeline:
    """The pipeline that a log carries, with an offline fit where it has none; raises ConfigurationError."""
    carried = carried_by(log)
    if carried is None:
        raise ConfigurationError(f"{log}: is a log; say with --pipeline FILE which pipeline reads it")
    typer.echo(f"{log}: tip, models and alignment are those of its run", err=True)
    source = replay_source(carried)
    for assignment in overrides:
        source.override(assignment)
    pipeline = build_pipeline(source)
    if not any(not track.estimator.online for track in pipeline.tracks):
        pipeline = build_pipeline(_with_fit(carried, overrides))
    told = ", ".join(f"{key} = {text}" for key, text in taken_values(pipeline).items())
    typer.echo(f"taken for known: {told}", err=True)
    return pipeline


def _with_fit(carried: Carried, overrides: list[str]) -> Source:
    source = replay_source(carried, ["*/casadi-fit"], ["casadi-fit"])
    for assignment in overrides:
        source.override(assignment)
    return source


def _log_device(pipeline: Pipeline, path: Path) -> str:
    logs = [name for name, device in pipeline.devices.items() if "file" in type(device).model_fields]
    if len(logs) != 1:
        raise ConfigurationError(f"{path}: --pipeline wants one device with a file, and this has {len(logs)}")
    return logs[0]


def _offline(pipeline: Pipeline) -> Pipeline:
    """The pipeline with its offline tracks only."""
    tracks = tuple(track for track in pipeline.tracks if not track.estimator.online)
    if not tracks:
        raise ConfigurationError(
            f'{pipeline.path}: has no offline estimator; add for example [estimator.fit] type = "casadi-fit"'
        )
    return replace(pipeline, tracks=tracks)


def _fitted(name: str, pipeline: Pipeline, folder: Path) -> LogFit:
    kept = KeptRun()
    with progress(name, "s"):
        result = run_pipeline(pipeline, folder, progressed, kept)
    result.demand_whole()
    if not kept.blocks:
        raise UserError(f"{name}: the log holds no samples")
    return LogFit(name, pipeline, result, Samples.joined(kept.blocks), kept.found)


def evaluate(logs: Sequence[LogFit], carry: bool) -> list[dict[str, Any]]:
    """What the material that was found on one log leaves of the force on another.

    Surface and bias are found anew on each log, or with `carry` taken over, too.
    """
    rows = []
    for source in logs:
        for name, track in source.fitted.items():
            for target in logs:
                if set(type(_track(target, name).estimator).model_fields) >= _REFITTED:
                    rows.append(
                        {"track": name, "fitted_on": source.name, "on": target.name} | _left(track, target, name, carry)
                    )
    return rows


def _track(log: LogFit, name: str) -> Any:
    for track in log.pipeline.tracks:
        if track.name == name:
            return track
    raise ConfigurationError(f"{log.pipeline.path}: has no track {name!r}, so nothing can be evaluated on it")


def _left(track: TrackResult, target: LogFit, name: str, carry: bool) -> dict[str, Any]:
    there = _track(target, name)
    fixed = {parameter.name: track.parameters[parameter.name].value for parameter in there.model.parameters}
    if carry:
        fixed["surface"] = track.surface.value
    changes = {
        "fixed": {**there.estimator.fixed, **fixed},
        "bounds": {},
        "start_at": {},
        "profile": False,
        "systematic": {},
    }
    changes |= {"contact_point": "free", "solver": "auto", "bootstrap": 0}
    return _refit(target, there, changes)


def _refit(log: LogFit, track: Any, changes: dict[str, Any]) -> dict[str, Any]:
    """RSS, RMS, surface and parameters of a fit under changed settings."""
    problem = Problem(track.model, log.pipeline.alignment.tip_mass)
    estimates = track.estimator.model_copy(update=changes).start(problem).run(log.samples)
    found = estimates.report.table() if estimates.report is not None else {"unknowns": {}}
    return {
        **{key: found.get(key) for key in ("rss", "rms", "samples", "unknowns")},
        "flags": [flag.table() for flag in log.pipeline.registry.judged(estimates.flags)],
    }


def each_cycle(log: LogFit) -> Iterable[dict[str, Any]]:
    """Every cycle of a log fitted by itself."""
    for name, result in log.fitted.items():
        track = _track(log, name)
        if "segment" not in type(track.estimator).model_fields:
            continue
        for cycle in range(1, (result.report.cycles if result.report else 0) + 1):
            segment = f"{track.estimator.segment}, cycles {cycle}..{cycle}"
            yield {"log": log.name, "track": name, "cycle": cycle} | _refit(log, track, {"segment": segment})


def _document(logs: Sequence[LogFit], crossed: list[dict[str, Any]], cycles: list[dict[str, Any]]) -> dict[str, Any]:
    """The contents of ``fit.json``."""
    tables = {log.name: {"folder": str(log.result.folder), **log.result.table()} for log in logs}
    document: dict[str, Any] = finite_tree({"logs": tables, "evaluation": crossed, "cycles": cycles})
    return document
