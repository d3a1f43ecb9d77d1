"""``palpate fit``: offline fits of several models to several logs, side by side."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import ConfigurationError, OutputError, PalpateError
from palpate_engine import (
    approved_plugins,
    finite_tree,
    load_pipeline,
    make_folder,
    values_on_trust,
    withdraw_folder,
    write_whole,
)
from palpate_kit.curves.curve_files import curve_files, curves_by
from palpate_kit.curves.curve_fits import CurveReader, offline
from palpate_kit.curves.fit_folder import is_fit_folder
from palpate_kit.jobs.engines import SchedulerOption, StageOption, demand_no_jobs, demand_scheduler
from palpate_kit.terminal.options import DetailsOption, FormatOption, Overrides, WhereOption
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.table import console

from palpate_fits.evaluation import each_cycle, evaluate
from palpate_fits.fit_jobs import LogFit, fits_of
from palpate_fits.fit_sources import leave_out, log_device, named_pipelines
from palpate_fits.fit_tables import by_cycle, each_table, evaluation, fit_overview, fit_views
from palpate_fits.folder_fits import fit_each

_FIT = "fit.json"


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
    tip: Annotated[
        str | None, typer.Option(help='Fit files without a pipeline, or folders of them: "sphere 3 mm" (its radius).')
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="With --tip: the contact model, by name or initials. [default: dr]")
    ] = None,
    force: Annotated[str | None, typer.Option(help="With --tip: the column of the force.")] = None,
    position: Annotated[str | None, typer.Option(help="With --tip: the column of the height or depth.")] = None,
    time: Annotated[str | None, typer.Option(help="With --tip: the column of the time.")] = None,
    rate: Annotated[str | None, typer.Option(help='With --tip: of readings without a time, as in "500 Hz".')] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Folder; what is fitted already in one of the same logs is kept. [default: runs/...]"
        ),
    ] = None,
    overrides: Overrides = None,
    cross: Annotated[bool, typer.Option("--cross", help="Evaluate what was fitted on each log on all others.")] = False,
    carry: Annotated[bool, typer.Option(help="As --cross, with the surface of the first, too.")] = False,
    cycles: Annotated[bool, typer.Option("--cycles", help="Fit every cycle of a log by itself.")] = False,
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
    pictures: Annotated[bool, typer.Option(help="Draw force over time and depth, and residuals.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print fit.json instead of the tables.")] = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",
    each: Annotated[
        bool, typer.Option("--each", help="Thousands of curves, one a file: a row of fits.csv each; --out goes on.")
    ] = False,
    by: Annotated[str | None, typer.Option(help="With --each: a new curve begins where this channel changes.")] = None,
    jobs: Annotated[
        int | None, typer.Option(help="With --each: curves at a time. [default: one per core]", min=1)
    ] = None,
    where: WhereOption = None,
    unset: Annotated[
        list[str] | None,
        typer.Option("--unset", metavar="TABLE.KEY", help="With --where: take an own setting of these curves back."),
    ] = None,
    groups: Annotated[
        Path | None, typer.Option(help="Of a folder of fits: a CSV with a column `curve`, and columns to group by.")
    ] = None,
    no_refit: Annotated[
        bool, typer.Option("--no-refit", help="Of many curves: write the settings, and fit nothing yet.")
    ] = False,
) -> None:
    """Fit every offline track to every log: elasticity, viscosity and a verdict for each.

    A folder that --each or --tip has made is continued: what has changed since is fitted anew. There, --set, --tip
    and --model change the settings of all curves, and --set with --where those of some.
    """
    demand_scheduler(scheduler, stage)
    if len(sources) == 1 and is_fit_folder(sources[0]):
        from palpate_fits.folder_command import FolderChange, fit_folder

        if pipeline is not None or out is not None or by is not None:
            raise ConfigurationError(f"{sources[0]}: is a folder of fits, which has its pipeline; change it with --set")
        change = FolderChange(
            where, tuple(overrides or ()), tuple(unset or ()), tip, model, groups, not no_refit, jobs, as_json
        )
        fit_folder(sources[0], change)
        return
    for option, value in (("--where", where), ("--unset", unset), ("--groups", groups)):
        if value:
            raise ConfigurationError(f"{option}: is for one folder of fits, that --each or --tip has made")
    if no_refit and not (tip or each):
        raise ConfigurationError("--no-refit: is for many curves, with --each or --tip")
    if tip is not None:
        if pipeline is not None or any(source.suffix == ".toml" for source in sources):
            raise ConfigurationError("--tip is for files without a pipeline, which has a tip of its own")
        from palpate_fits.file_fits import FileFit, fit_files

        for option, asked in (
            ("--cross", cross or carry),
            ("--cycles", cycles),
            ("--by", by),
            ("--scheduler", scheduler),
        ):
            if asked:
                raise ConfigurationError(f"{option}: wants a pipeline; --tip writes one beside its table")
        given = {"force": force, "position": position, "time": time, "rate": rate}
        choices = {role: text for role, text in given.items() if text is not None}
        fit_files(
            sources,
            FileFit(tip, model or "dr", choices, tuple(overrides or ()), out, jobs, as_json, not no_refit, details),
        )
        return
    if each or by:
        if scheduler is not None:
            _demand_seen_files(by, stage, jobs)
        _each(sources, pipeline, overrides or [], out, by, scheduler, jobs, as_json, not no_refit)
        return
    if scheduler is not None:  # workers stand elsewhere
        sources, pipeline = [source.resolve() for source in sources], pipeline.resolve() if pipeline else None
    failures: dict[str, PalpateError] = {}
    folder, logs = _fitted(sources, pipeline, overrides or [], out, scheduler, stage, pictures, details, failures)
    crossed = evaluate(logs, carry) if (cross or carry) and len(logs) > 1 else []
    by_cycle = [row for log in logs for row in each_cycle(log)] if cycles else []
    document = _document(logs, crossed, by_cycle)
    _write(folder, document)
    if as_json:
        typer.echo(json.dumps(document, indent=2))
    else:
        _show(logs, crossed, by_cycle, folder, details)
    if failures:
        typer.echo(f"{len(failures)} of {len(sources)} logs failed: {', '.join(failures)}", err=True)
        raise typer.Exit(1)


def _fitted(
    sources: Sequence[Path],
    reader: Path | None,
    overrides: list[str],
    out: Path | None,
    scheduler: str | None,
    stage: str | None,
    pictures: bool,
    details: bool,
    failures: dict[str, PalpateError],
) -> tuple[Path, list[LogFit]]:
    """The folder, and the logs that were fitted in the order of the sources; of the others, `failures` hold why.

    What is found is written down log by log. Raises UserError where no log was fitted.
    """
    with progress(f"look at {len(sources)} sources"):
        loaded = named_pipelines(sources, reader, overrides, failures)
    if details:
        for name, pipeline in loaded:
            told = ", ".join(f"{key} = {text}" for key, text in values_on_trust(pipeline).items())
            typer.echo(f"{name}: taken for known: {told}", err=True)
    names = [name for name, _ in loaded]
    gone_on_with = out is not None and (out / _FIT).is_file()
    folder = _folder(out, names)
    logs: list[LogFit] = []
    for name, outcome in fits_of(loaded, folder, scheduler, stage, pictures):
        if isinstance(outcome, PalpateError):
            leave_out(name, outcome, failures)
            continue
        logs.append(outcome)
        logs.sort(key=lambda log: names.index(log.name))
        _write(folder, _document(logs, [], []))  # what is found until now
    if not logs:
        if not gone_on_with:
            withdraw_folder(folder)
        raise next(iter(failures.values()))
    return folder, logs


def _folder(wanted: Path | None, names: Sequence[str]) -> Path:
    """A new folder, or one that holds fits of none but these logs; raises OutputError."""
    if wanted is None or not (wanted / _FIT).is_file():
        folder = make_folder("fit", wanted, datetime.now(UTC).astimezone())
        _write(folder, _document([], [], []))
        return folder
    try:
        known = list(json.loads((wanted / _FIT).read_text(encoding="utf-8"))["logs"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"{wanted / _FIT}: is no document of palpate fit: {error}") from error
    if others := [name for name in known if name not in names]:
        raise OutputError(f"{wanted}: holds fits of {', '.join(others)}, which is not among these; nothing is mixed")
    return wanted


def _show(
    logs: Sequence[LogFit], crossed: list[dict[str, Any]], cycles: list[dict[str, Any]], folder: Path, details: bool
) -> None:
    terminal = console(160) if details else console()
    tables = {log.name: (log.result.tracks, log.result.flags) for log in logs}
    for view in fit_views(tables) if details else fit_overview(tables):
        terminal.print(view)
    if crossed:
        terminal.print(evaluation(crossed))
    if cycles:
        terminal.print(by_cycle(cycles))
    terminal.print(f"written to {folder}", highlight=False, markup=False, soft_wrap=True)


def _demand_seen_files(by: str | None, stage: str | None, jobs: int | None) -> None:
    """Raise ConfigurationError for what many curves on the workers of a scheduler cannot have."""
    for option, given in (("--by", by), ("--stage", stage)):
        if given:
            raise ConfigurationError(f"{option}: with --each, workers read each curve from a file that they can see")
    demand_no_jobs(jobs)


def _each(
    sources: Sequence[Path],
    reader: Path | None,
    overrides: list[str],
    out: Path | None,
    by: str | None,
    scheduler: str | None,
    workers: int | None,
    as_json: bool,
    fitting: bool,
) -> None:
    """Many curves, each a row of a table."""
    if reader is None:
        raise ConfigurationError("--each: say with --pipeline FILE how a curve is read")
    reading = load_pipeline(reader, overrides)
    device = log_device(reading, reader)
    files = list(curve_files(sources, type(reading.devices[device])))
    assignments = [*overrides, f"device.{device}.file={json.dumps(str(files[0].file))}"]
    pipeline = offline(load_pipeline(reader, assignments))
    log = pipeline.devices[device]
    curves = curves_by([log.model_copy(update={"file": Path(one.file)}) for one in files], by) if by else files
    told = CurveReader(pipeline.text, str(pipeline.path.resolve()), tuple(assignments), device, approved_plugins())
    folder = out or make_folder("fit", None, datetime.now(UTC).astimezone())
    pool = None
    if scheduler is not None:
        from palpate_fits.curve_cluster import on_workers

        pool = partial(on_workers, scheduler, folder.resolve())
    with progress("fit", "curves", None if by else len(files)):
        table = fit_each(pipeline, told, curves, folder, workers, fitting=fitting, pool=pool)
    if not fitting:
        typer.echo(f"{len(files)} curves to fit: palpate fit {folder}")
        return
    found = table.summary()
    if as_json:
        typer.echo(json.dumps({"table": str(table.path), "tracks": found}, indent=2))
    else:
        console().print(each_table(found, pipeline).view())
        typer.echo(f"written to {table.path}")
    if failed := sum(track["failed"] for track in found.values()):
        typer.echo(f"{failed} fits of {sum(track['curves'] for track in found.values())} failed", err=True)
        raise typer.Exit(1)


def _write(folder: Path, document: dict[str, Any]) -> None:
    write_whole(folder / _FIT, json.dumps(document, indent=2, allow_nan=False) + "\n")


def _document(logs: Sequence[LogFit], crossed: list[dict[str, Any]], cycles: list[dict[str, Any]]) -> dict[str, Any]:
    """The contents of ``fit.json``."""
    tables = {log.name: {"folder": str(log.result.folder), **log.result.table()} for log in logs}
    document: dict[str, Any] = finite_tree({"logs": tables, "evaluation": crossed, "cycles": cycles})
    return document
