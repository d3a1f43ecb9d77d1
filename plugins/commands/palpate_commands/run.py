"""``palpate run``: a pipeline from its file to its result."""

from __future__ import annotations

import contextlib
import json
import shlex
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate_engine import Pipeline, Result, context_of, function_of, load_pipeline, run_pipeline
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.options import DetailsOption, FolderOption, FormatOption, Overrides
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.result_screen import WIDTH, print_view
from palpate_kit.terminal.result_summary import result_views
from palpate_kit.terminal.table import console

from palpate_commands.lifted_run import lifted

_LOG_SUFFIXES = (".mcap", ".db3", ".csv", ".gz")
_DETAILS_WIDTH = 120  # characters of a line with details: a choice


@with_facts
def run(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    out: FolderOption = None,
    overrides: Overrides = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead of the table.")] = False,
    seed: Annotated[int | None, typer.Option(help="Seed of the run; overrides that of the file.", min=0)] = None,
    report: Annotated[bool, typer.Option("--report", help="Write a report into the run folder.")] = False,
    live: Annotated[bool, typer.Option("--live", help='Show it in the browser: --set sink.live.type="live".')] = False,
    lift: Annotated[
        str | None, typer.Option(metavar="HEIGHT", help="Make the very motion so far above: 20mm. Nothing is palpated.")
    ] = None,
    speed: Annotated[
        str | None, typer.Option(metavar="PERCENT", help="With --lift: so fast, in % of the motion's own: 25%.")
    ] = None,
    details: DetailsOption = False,
    form: FormatOption = "table",
) -> None:
    """Run a pipeline; print the results and where they are written."""
    if file.is_dir() or file.suffix in _LOG_SUFFIXES:
        raise ConfigurationError(f"{file}: is not a pipeline file; `palpate replay` estimates a recorded run again")
    # Options stand for keys of the pipeline.
    assignments = list(overrides or [])
    if seed is not None:
        assignments.append(f"run.seed={seed}")
    if report:
        assignments.append("run.report=true")
    if live:
        assignments.append('sink.live.type="live"')
    with progress(f"look at {file}"):  # a log of gigabytes is passed once for what it holds
        pipeline = load_pipeline(file, assignments)
    for name, table in pipeline.tables.items():
        if command := getattr(table, "many_runs_by", ""):
            typer.echo(f"one run: [{name}] is for `palpate {command} {file}`, which makes all of them", err=True)
    if speed is not None and lift is None:
        raise ConfigurationError("--speed is for --lift: a slower palpation is another measurement, of [trajectory.*]")
    if lift is not None:
        pipeline = lifted(pipeline, lift, speed)
    execute(pipeline, out, as_json, details)


def execute(pipeline: Pipeline, out: Path | None, as_json: bool = False, details: bool = False) -> None:
    """Run a pipeline, show progress and results; ends with the code of the signal that stopped it."""
    for notice in pipeline.notices:
        typer.echo(notice, err=True)
    with contextlib.ExitStack() as stack:
        # The first display of all plugins shows the run, unless a program reads the output.
        screen = None
        displays = {} if as_json else pipeline.registry.displays
        for name, display in list(displays.items())[:1]:  # none or one
            screen = stack.enter_context(context_of(function_of(display)(pipeline), f"display {name}"))
        result = run_pipeline(pipeline, out, screen and screen.progress, screen)
    if result.signal == signal.SIGHUP:  # the terminal is gone
        result.demand_whole()
    if as_json:
        typer.echo(json.dumps(result.table(), indent=2))
    else:
        _print_result(pipeline, result, details)
    for line in _report_lines(pipeline, result.folder):
        typer.echo(line, err=as_json or layout() != "table")
    result.demand_whole()
    result.demand_no_failure()


def _print_result(pipeline: Pipeline, result: Result, details: bool) -> None:
    """Print the views of a result, and the folder that it is written to."""
    terminal = console(_DETAILS_WIDTH if details else WIDTH)
    for view in result_views(pipeline, result, details):
        print_view(terminal, view)
    lift = result.run.get("lifted")
    if lift is not None:
        typer.echo(f"lifted by {1e3 * lift['height']:g} mm, at {lift['pace']:.0%} of the speed: nothing was palpated")
    typer.echo(f"written to {result.folder}", err=layout() != "table")


def _report_lines(pipeline: Pipeline, folder: Path) -> Iterator[str]:
    """Yield the path of each report that the pipeline requests, or the command that writes it later."""
    for name, report in pipeline.registry.reports.items():
        if pipeline.run.report:
            yield f"{name}: {function_of(report)(folder)}"
        else:
            place = shlex.quote(str(folder))
            yield f"share: palpate {name} {place}"
            yield f"why ±: palpate {name} budget {place}"
