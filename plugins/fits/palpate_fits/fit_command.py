"""``palpate fit``: offline fits of files, of logs and of folders of curves."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError, UserError
from palpate_engine import (
    Pipeline,
    approved_plugins,
    load_pipeline,
    make_folder,
    parsed_assignment,
    registry,
    toml_tables,
)
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, offline
from palpate_kit.curves.curve_list import Entries, cells_beside, fact_counts, stated_in
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.curves.shared_specimen import setup_pairs
from palpate_kit.curves.stated_facts import StatedFacts, keep_facts, rig_beside, stated_facts
from palpate_kit.jobs.engines import SchedulerOption, StageOption, demand_no_jobs, demand_scheduler
from palpate_kit.runs.replay_source import read_run_log
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.options import DetailsOption, FormatOption, Overrides, WhereOption
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.table import console

from palpate_fits.curve_files import curve_files, curves_by
from palpate_fits.fit_sources import log_device
from palpate_fits.fit_tables import each_table
from palpate_fits.folder_fits import fit_each
from palpate_fits.setup_tables import pairs_document, show_pairs
from palpate_fits.whole_logs import (
    JsonOption,
    OutOption,
    PicturesOption,
    PipelineOption,
    WholeLogs,
    fit_logs,
)


@with_facts
def fit(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...", help="Files or folders, with --tip; pipelines; logs that --pipeline can read."
        ),
    ],
    pipeline: PipelineOption = None,
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
    out: OutOption = None,
    overrides: Overrides = None,
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
    pictures: PicturesOption = True,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",
    each: Annotated[
        bool, typer.Option("--each", help="Thousands of curves, one a file: a row of fits.csv each; --out goes on.")
    ] = False,
    by: Annotated[
        str | None,
        typer.Option(
            help='With --tip: groups by a pattern of the names, as in "(ctrl|treat)", or a column of curves.csv. With '
            "--each: a new curve begins where this channel changes."
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(help="With --each: curves at a time. [default: one per core]", min=1)
    ] = None,
    where: WhereOption = None,
    unset: Annotated[
        list[str] | None,
        typer.Option(
            "--unset",
            metavar="TABLE.KEY",
            help="Take back a setting of these curves; without --where a fact.",
        ),
    ] = None,
    groups: Annotated[
        Path | None, typer.Option(help="Of a folder of fits: a CSV with a column `curve`, and columns to group by.")
    ] = None,
    no_refit: Annotated[
        bool, typer.Option("--no-refit", help="Of many curves: write the settings, and fit nothing yet.")
    ] = False,
) -> None:
    """Fit every offline track to every log: elasticity, viscosity and a verdict for each.

    A folder that --each or --tip has made is continued: what has changed since is fitted again. There, --set, --tip
    and --model change the settings of all curves, and --set with --where those of some.
    """
    demand_scheduler(scheduler, stage)
    if len(sources) == 1 and is_fit_folder(sources[0]):
        from palpate_fits.folder_command import FolderChange, fit_folder

        if pipeline is not None or out is not None or by is not None:
            raise ConfigurationError(f"{sources[0]}: is a folder of fits, which has its pipeline; change it with --set")
        change = FolderChange(
            where, tuple(overrides or ()), tuple(unset or ()), tip, model, groups, not no_refit, jobs, as_json, details
        )
        fit_folder(sources[0], change)
        return
    for option, value in (("--where", where), ("--unset", unset), ("--groups", groups)):
        if value:
            raise ConfigurationError(f"{option}: is for one folder of fits, that --each or --tip has made")
    has_pipeline = pipeline is not None or any(source.suffix == ".toml" for source in sources)
    if tip is not None and has_pipeline:
        raise ConfigurationError("--tip is for files without a pipeline, which has a tip of its own")
    if not has_pipeline and not each and (stated := _files_facts(sources, overrides or (), tip, model)) is not None:
        from palpate_fits.file_fits import FileFit, fit_files

        if scheduler:
            raise ConfigurationError("--scheduler: needs a pipeline; --tip writes one next to its table")
        given = {"force": force, "position": position, "time": time, "rate": rate}
        choices = {role: text for role, text in given.items() if text is not None}
        fit_files(sources, FileFit(stated, choices, out, jobs, as_json, not no_refit, details, by))
        return
    if no_refit and not each:
        raise ConfigurationError("--no-refit: is for many curves, with --each or --tip")
    if each or by:
        if pipeline is not None and not _rigs(overrides or ()) and (rig := rig_beside(sources)) is not None:
            overrides = [f"run.rig={json.dumps(str(rig.absolute()))}", *(overrides or ())]
            typer.echo(f"facts of the rig: {rig}", err=True)
        if scheduler is not None:
            _demand_seen_files(by, stage, jobs)
        _each(sources, pipeline, overrides or [], out, by, scheduler, jobs, as_json, not no_refit)
        return
    fit_logs(WholeLogs(sources, pipeline, overrides, out, scheduler, stage, pictures, details, as_json))


def _files_facts(
    sources: Sequence[Path], overrides: Sequence[str], tip: str | None, model: str | None
) -> StatedFacts | None:
    """The facts of files without a pipeline, their tip asked for; None where they bring one, or nobody answers."""
    stated = stated_facts(sources, overrides, tip=tip, model=model)
    if stated.facts.tip is None and all(source.exists() for source in sources) and not any(map(_has_run, sources)):
        from palpate_fits.sitting import ask_fact, is_asking, prompt

        if is_asking():
            stated = ask_fact(stated, "tip", "nothing is fitted", prompt)
    return stated if stated.facts.tip is not None else None


def _has_run(source: Path) -> bool:
    """Whether a source brings the pipeline by which it was made."""
    if source.is_dir():
        return RunFolder(source).began
    with suppress(UserError):
        return read_run_log(source) is not None
    return False


def _rigs(overrides: Sequence[str]) -> list[Path]:
    """The file of facts that is named, or found next to the curves."""
    return [Path(str(value)) for keys, value in map(parsed_assignment, overrides) if keys == ("run", "rig")]


def _demand_seen_files(by: str | None, stage: str | None, jobs: int | None) -> None:
    """Raise ConfigurationError for what many curves on the workers of a scheduler cannot have."""
    for option, given in (("--by", by), ("--stage", stage)):
        if given:
            raise ConfigurationError(f"{option}: with --each, workers read each curve from a file that they can see")
    demand_no_jobs(jobs)


def _cells(sources: Sequence[Path], files: Sequence[Curve], stated: StatedFacts, pipeline: Pipeline) -> Entries:
    """Return the cells of ``curves.csv`` next to files but for the facts that options state; report the facts."""
    tables, beside = toml_tables(pipeline.text), cells_beside(sources, files)
    cells = {name: stated.without_options(of_curve, tables) for name, of_curve in beside.items()}
    if words := fact_counts(map(stated_in, cells.values()), len(files)):
        typer.echo(words, err=True)
    return cells


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
    pipeline = replace(pipeline, run=pipeline.run.model_copy(update={"curves": None}))  # of another folder of fits
    log = pipeline.devices[device]
    curves = curves_by([log.model_copy(update={"file": Path(one.file)}) for one in files], by) if by else files
    stated = stated_facts(sources, overrides)
    cells = {} if by else _cells(sources, files, stated, pipeline)
    told = CurveReader(pipeline.text, str(pipeline.path.resolve()), tuple(assignments), device, approved_plugins())
    folder = out or make_folder("fit", None, datetime.now(UTC).astimezone())
    pool = None
    if scheduler is not None:
        from palpate_fits.curve_cluster import on_workers

        pool = partial(on_workers, scheduler, folder.resolve())
    with progress("fit", "curves", None if by else len(files)):
        table = fit_each(pipeline, told, curves, folder, workers, fitting=fitting, pool=pool, cells=cells)
    keep_facts(folder, stated)
    if not fitting:
        typer.echo(f"{len(files)} curves to fit: palpate fit {folder}")
        return
    found = table.summary()
    of_folder = FitFolder(folder)
    pairs = setup_pairs(of_folder, of_folder.names, registry.load())
    if as_json:
        document = {"table": str(table.path), "tracks": found, "specimens": pairs_document(pairs)}
        typer.echo(json.dumps(document, indent=2))
    else:
        console().print(each_table(found, pipeline).view())
        show_pairs(pairs)
        typer.echo(f"written to {table.path}")
    if failed := sum(track["failed"] for track in found.values()):
        typer.echo(f"{failed} fits of {sum(track['curves'] for track in found.values())} failed", err=True)
        raise typer.Exit(1)
