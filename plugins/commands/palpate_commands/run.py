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
from palpate_engine import Pipeline, context_of, function_of, load_pipeline, run_pipeline
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
    assignments = [*(overrides or []), *([f"run.seed={seed}"] if seed is not None else [])]
    assignments += ["run.report=true"] if report else []
    assignments += ['sink.live.type="live"'] if live else []
    with progress(f"look at {file}"):  # a log of gigabytes is passed once for what it holds
        pipeline = load_pipeline(file, assignments)
    for name, table in pipeline.tables.items():
        if command := getattr(table, "many_runs_by", ""):
            typer.echo(f"one run: [{name}] is for `palpate {command} {file}`, which makes all of them", err=True)
    if speed is not None and lift is None:
        raise ConfigurationError("--speed is for --lift: a slower palpation is another measurement, of [trajectory.*]")
    execute(pipeline if lift is None else lifted(pipeline, lift, speed), out, as_json, details)


def execute(pipeline: Pipeline, out: Path | None, as_json: bool = False, details: bool = False) -> None:
    """Run a pipeline, show progress and results; ends with the code of the signal that stopped it."""
    for notice in pipeline.notices:
        typer.echo(notice, err=True)
    with contextlib.ExitStack() as stack:
        screen = None
        for name, display in [] if as_json else list(pipeline.registry.displays.items())[:1]:
            screen = stack.enter_context(context_of(function_of(display)(pipeline), f"display {name}"))
        result = run_pipeline(pipeline, out, screen and screen.progress, screen)
    if result.signal == signal.SIGHUP:  # the terminal is gone
        result.demand_whole()
    if as_json:
        typer.echo(json.dumps(result.table(), indent=2))
    else:
        terminal = console(_DETAILS_WIDTH if details else WIDTH)
        for view in result_views(pipeline, result, details):
            print_view(terminal, view)
        if (lift := result.run.get("lifted")) is not None:
            typer.echo(
                f"lifted by {1e3 * lift['height']:g} mm, at {lift['pace']:.0%} of the speed: nothing was palpated"
            )
        typer.echo(f"written to {result.folder}", err=layout() != "table")
    for line in _report_lines(pipeline, result.folder):
        typer.echo(line, err=as_json or layout() != "table")
    result.demand_whole()
    result.demand_no_failure()


def _report_lines(pipeline: Pipeline, folder: Path) -> Iterator[str]:
    """Yield the path of each report that the pipeline requests, or the command that writes it later."""
    for name, report in pipeline.registry.reports.items():
        if pipeline.run.report:
            yield f"{name}: {function_of(report)(folder)}"
        else:
            place = shlex.quote(str(folder))
            yield f"share: palpate {name} {place}"
            yield f"why ±: palpate {name} budget {place}"
