"""``palpate compare``: every model with every estimator on one log, in one table and one picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError, PalpateError, UserError, printable
from palpate_engine import Pipeline, Source, analysis, make_folder, values_on_trust, write_new
from palpate_kit.figures import save_figure
from palpate_kit.jobs.engines import SchedulerOption, StageOption, demand_scheduler
from palpate_kit.jobs.job import Job
from palpate_kit.logs.draft_pipeline import pipeline_of, rate_note, suggestion_of
from palpate_kit.runs.replay_source import added_table, read_run_log, replay_source, with_other_channels
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import DetailsOption, FolderOption, FormatOption, JsonOption, Overrides, Points
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.result_summary import flag_lines, lines_below
from palpate_kit.terminal.table import console

from palpate_studies import comparison_table
from palpate_studies.tracks_that_run import with_what_runs

if TYPE_CHECKING:
    from palpate_engine import Result
    from rich.console import RenderableType


def compare(
    log: Annotated[Path, typer.Argument(help="A log (.mcap, .db3, a bag folder, .csv), or a pipeline file (.toml).")],
    models: Annotated[str | None, typer.Option(help="Contact models by type, with commas between.")] = None,
    estimators: Annotated[str | None, typer.Option(help="Estimators by type, with commas between.")] = None,
    reference: Annotated[str | None, typer.Option(metavar="TRACK", help="Show this track as the truth.")] = None,
    out: FolderOption = None,
    overrides: Overrides = None,
    time: Annotated[str | None, typer.Option(metavar="COLUMN", help="What is the time in a CSV file.")] = None,
    rate: Annotated[str | None, typer.Option(help="Rate of a CSV file without a time, such as '500 Hz'.")] = None,
    force: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="What is the force in the log.")] = None,
    position: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="What is the position.")] = None,
    velocity: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="What is the velocity.")] = None,
    points: Points = None,
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",
) -> None:
    """Run every model with every estimator on one log, read once; print one table, draw one picture.

    What cannot run is a row with the reason.

    Of a sweep along a line, the curves are drawn, too, with the lumps in each.
    """
    from palpate_engine import run_pipeline

    demand_scheduler(scheduler, stage)
    log = log if scheduler is None else log.resolve()
    given = {"force": force, "position": position, "velocity": velocity, "time": time, "rate": rate}
    choices = {role: text for role, text in given.items() if text is not None}
    with progress(f"look at {log}"):
        source, added = _chosen(_source(log, choices), models, estimators, overrides or [])
        pipeline, refused = with_what_runs(source, added)
    if details and log.suffix != ".toml":
        told = ", ".join(f"{key} = {text}" for key, text in values_on_trust(pipeline).items())
        typer.echo(f"taken for known: {told}", err=True)
    names = [track.name for track in pipeline.tracks]
    if reference is not None and reference not in names:
        raise ConfigurationError(f"--reference: there is no track {reference!r} (there are: {', '.join(names)})")
    with progress(str(log), "s"):
        if scheduler is None:
            result = run_pipeline(pipeline, out, report_progress)
        else:
            result = _there(pipeline, out, scheduler, stage)
    if as_json:
        print_json({**result.table(), "folder": result.folder, "not_run": refused})
    else:
        _tell(result, refused, reference, details)
    result.demand_whole()
    write_new(result.folder / "compare.csv", comparison_table.csv_text(result, refused))
    with print_aside(as_json):
        typer.echo(f"picture: {_draw(result, reference)}\nwritten to {result.folder}, all tracks in compare.csv")
        _along(pipeline, result, points)
    if any(flag.code == "failed" for track in result.tracks.values() for flag in track.flags):
        raise typer.Exit(1)


def _there(pipeline: Pipeline, out: Path | None, scheduler: str, stage: str | None) -> Result:
    """The run on a worker of a scheduler: all tracks on one, for they share their samples and are weighed together."""
    from palpate_kit.jobs.cluster import on_cluster

    folder = make_folder("compare", out, datetime.now(UTC).astimezone())
    with closing(on_cluster(scheduler, folder, stage)([Job("compare", pipeline, folder / "run")])) as found:
        ((_, outcome),) = found
    if isinstance(outcome, PalpateError):
        raise outcome
    return outcome.result


def _tell(result: Result, refused: Mapping[str, str], reference: str | None, details: bool) -> None:
    terminal = console(120) if details else console()
    for shown in comparison_table.tables(result, refused, details):
        terminal.print(shown if isinstance(shown, str) else shown.view(), highlight=False)
    for line in flag_lines(result.flags, result.tracks) if details else lines_below(result):
        terminal.print(line, style="yellow", markup=False, highlight=False)
    if reference is not None:
        terminal.print(_differences(result, reference))


def _along(pipeline: Pipeline, result: Result, points: Path | None) -> None:
    """Curves of a sweep along a line; nothing where it was none."""
    aligned = pipeline.alignment
    if points is not None or aligned.lateral_x is not None or aligned.lateral_y is not None:
        try:
            analysis("map curves")([result.folder], [""], points, result.folder / "sweep.png")
        except UserError:  # no curves along a line; without points nobody has asked for them
            if points is not None:
                raise


def _source(log: Path, choices: Mapping[str, str]) -> Source:
    """A pipeline file, or what is suggested for a log."""
    if log.suffix == ".toml":
        if choices:
            raise ConfigurationError(f"--{next(iter(choices))} is for logs: {log} says by itself what it reads")
        return Source.read(log)
    carried = read_run_log(log)
    if carried is not None and not choices:
        typer.echo(f"{log}: tip, models, estimators and alignment are those of its run", err=True)
        return replay_source(carried)
    suggestion = suggestion_of(log, dict(choices))
    if suggestion.blanks:
        raise ConfigurationError(f"{log}: {'; '.join(suggestion.blanks)}")
    if note := rate_note(choices, [suggestion]):
        typer.echo(note, err=True)
    for text in suggestion.doubts:
        typer.echo(f"check: {printable(text)}", err=True)
    if carried is not None:
        typer.echo(f"{log}: all but {', '.join(choices)} is that of its run", err=True)
        return with_other_channels(carried, suggestion, choices)
    return Source(pipeline_of(suggestion, log), Path(f"{log.name}.toml"))


def _chosen(
    source: Source, models: str | None, estimators: str | None, overrides: list[str]
) -> tuple[Source, set[tuple[str, str]]]:
    """A source with the models and estimators that are named, and those that it had no table of, by kind and name."""
    added = set[tuple[str, str]]()
    for kind, given in (("model", models), ("estimator", estimators)):
        if given is not None:
            added |= {(kind, name) for name in _names(given) if name not in source.tables.get(kind, {})}
            source.tables[kind] = {name: _table(kind, name, source.tables) for name in _names(given)}
            if kind == "model":
                _forget_models(source.tables)
    for assignment in overrides:
        source.override(assignment)
    return source, added


def _forget_models(tables: dict[str, Any]) -> None:
    """Take out of ``[run] assumed`` what was of models that are not there any more."""
    run = tables.setdefault("run", {})
    gone = [key for key in run.get("assumed", ()) if key.startswith("model.") and "*" not in key]
    gone = [key for key in gone if key.split(".")[1] not in tables["model"]]
    run["assumed"] = [key for key in run.get("assumed", ()) if key not in gone]


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _table(kind: str, name: str, tables: dict[str, Any]) -> dict[str, Any]:
    """The table of that name, or one of that type with its defaults, on the pipeline's indenter."""
    known = tables.get(kind, {})
    if isinstance(known, dict) and name in known:
        return dict(known[name])
    return added_table(kind, name, tables)


def _differences(result: Result, reference: str) -> RenderableType:
    """Every track's parameters against those of the reference, in per cent and in their joint standard deviations."""
    from rich.table import Table

    table = Table(title=f"against {reference}", title_justify="left")
    table.add_column("track")
    truth = result.tracks[reference].parameters
    for name in truth:
        table.add_column(f"{name}\n%", justify="right")
        table.add_column("sigma\n", justify="right")
    for label, track in result.tracks.items():
        if label == reference:
            continue
        cells = []
        for name, true in truth.items():
            found = track.parameters.get(name) if track.usable else None
            difference = math.nan if found is None else found.value - true.value
            spread = math.nan if found is None else math.hypot(found.combined, true.combined)
            cells += [_cell(100.0 * difference, true.value), _cell(difference, spread)]
        table.add_row(label, *cells)
    return table


def _cell(value: float, scale: float) -> str:
    return f"{value / scale:+.2f}" if scale and math.isfinite(value) and math.isfinite(scale) else "-"


def _draw(result: Result, reference: str | None) -> Path:
    path = result.folder / "compare.png"
    save_figure(comparison_table.picture(result, RunFolder(result.folder).tracks, reference), path)
    return path
