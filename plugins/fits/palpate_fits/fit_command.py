"""``palpate fit``: offline fits of files, of logs and of folders of curves."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from palpate import ConfigurationError, UserError
from palpate_kit.curves.stated_facts import StatedFacts, stated_facts
from palpate_kit.jobs.engines import SchedulerOption, StageOption, demand_scheduler
from palpate_kit.runs.replay_source import read_run_log
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.options import (
    DetailsOption,
    ForceOption,
    FormatOption,
    LateralOption,
    Overrides,
    PositionOption,
    RateOption,
    TimeOption,
    WhereOption,
)

from palpate_fits.fit_request import (
    ByOption,
    CurveOption,
    EachOption,
    FilesArgument,
    FitRequest,
    GroupsOption,
    JobsOption,
    JsonOption,
    ModelOption,
    NoRefitOption,
    OutOption,
    PicturesOption,
    PipelineOption,
    TipOption,
    UnsetOption,
)


@with_facts
def fit(
    sources: FilesArgument,
    pipeline: PipelineOption = None,
    tip: TipOption = None,
    model: ModelOption = None,
    force: ForceOption = None,
    position: PositionOption = None,
    lateral: LateralOption = None,  # column or columns of the place along the skin
    time: TimeOption = None,
    rate: RateOption = None,  # of readings without times
    curve: CurveOption = None,  # name of the one record to fit, of a file of several
    out: OutOption = None,
    overrides: Overrides = None,
    scheduler: SchedulerOption = None,  # address of the dask scheduler whose workers do the fits
    stage: StageOption = None,  # URL that inputs and runs pass through where these share no folder
    pictures: PicturesOption = True,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",  # set for all tables by the option's callback
    each: EachOption = False,  # one curve a file, and one row of fits.csv a curve
    by: ByOption = None,  # groups, or with --each the channel whose changes divide a file into curves
    jobs: JobsOption = None,
    where: WhereOption = None,
    unset: UnsetOption = None,
    groups: GroupsOption = None,  # table of a folder of fits by which its curves are grouped
    no_refit: NoRefitOption = False,
) -> None:
    """Fit every offline track to every log: elasticity, viscosity and a verdict for each.

    A folder that --each or --tip has made is continued: what has changed since is fitted again. There, --set, --tip
    and --model change the settings of all curves, and --set with --where those of some.
    """
    columns = {"force": force, "position": position, "lateral": lateral, "time": time, "rate": rate}
    _fit(
        FitRequest(
            sources=tuple(sources),
            pipeline=pipeline,
            overrides=tuple(overrides or ()),
            tip=tip,
            model=model,
            choices={role: column for role, column in columns.items() if column is not None},
            out=out,
            scheduler=scheduler,
            stage=stage,
            pictures=pictures,
            as_json=as_json,
            details=details,
            each=each,
            by=by,
            jobs=jobs,
            where=where,
            unset=tuple(unset or ()),
            groups=groups,
            fitting=not no_refit,
            curve=curve,
        )
    )


def _fit(request: FitRequest) -> None:
    """Fit a folder of fits again, files without a pipeline, many curves by one, or whole logs."""
    demand_scheduler(request.scheduler, request.stage)
    if request.fit_folder is not None:
        from palpate_fits.folder_command import fit_folder

        fit_folder(request.fit_folder, request)
        return
    request.demand_no_folder_options()
    if request.tip is not None and request.has_pipeline:
        raise ConfigurationError("--tip is for files without a pipeline, which has a tip of its own")
    if request.curve is not None and (request.has_pipeline or request.each):
        raise ConfigurationError("--curve is for files without a pipeline; with one: --set device.log.record=NAME")
    if not request.has_pipeline and not request.each and (stated := _stated_tip(request)) is not None:
        from palpate_fits.file_fits import fit_files

        fit_files(request, stated)
        return
    if not request.fitting and not request.each:
        raise ConfigurationError("--no-refit: is for many curves, with --each or --tip")
    if request.each or request.by:
        from palpate_fits.each_fits import fit_each

        fit_each(request)
        return
    from palpate_fits.whole_logs import fit_logs

    fit_logs(request)


def _stated_tip(request: FitRequest) -> StatedFacts | None:
    """Return the facts of files without a pipeline, the tip asked of a person; None without it, and for others."""
    stated = stated_facts(request.sources, request.overrides, tip=request.tip, model=request.model)
    sources = request.sources
    if stated.facts.tip is None and all(source.exists() for source in sources) and not any(map(_has_run, sources)):
        from palpate_fits.sitting import ask_fact, is_asking, prompt

        if is_asking():
            stated = ask_fact(stated, "tip", "nothing is fitted", prompt)
    return stated if stated.facts.tip is not None else None


def _has_run(source: Path) -> bool:
    """Return True if a source brings the pipeline by which it was made."""
    if source.is_dir():
        return RunFolder(source).began
    with suppress(UserError):
        return read_run_log(source) is not None
    return False
