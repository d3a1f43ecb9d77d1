"""``palpate run``: a pipeline from its file to its result."""

from __future__ import annotations

import contextlib
import json
import signal
import time
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate.host import Overrides, Pipeline, console, load_pipeline, run_pipeline

from palpate_basics.rehearsal import rehearse
from palpate_basics.view import result_view

_BEHIND = 0.5  # [s] from which on it is shown
_LOGS = (".mcap", ".db3", ".csv", ".gz")


def run(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    out: Annotated[
        Path | None, typer.Option(help="Run folder; must be new or empty. [default: runs/DATE_TIME_NAME]")
    ] = None,
    overrides: Overrides = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead of the table.")] = False,
    dry: Annotated[bool, typer.Option("--dry-run", help="Show the motion and its limits; connect to nothing.")] = False,
    seed: Annotated[int | None, typer.Option(help="Seed of the run; overrides that of the file.", min=0)] = None,
) -> None:
    """Run a pipeline; print what was found and where it is written."""
    if file.is_dir() or file.suffix in _LOGS:
        raise ConfigurationError(f"{file}: is no pipeline file; a recorded run is estimated anew by `palpate replay`")
    assignments = [*(overrides or []), *([f"run.seed={seed}"] if seed is not None else [])]
    pipeline = load_pipeline(file, assignments)
    if dry:
        rehearse(pipeline)
        return
    execute(pipeline, out, as_json)


def execute(pipeline: Pipeline, out: Path | None, as_json: bool) -> None:
    """Run a pipeline with a progress bar and show its result; ends with the code of the signal that stopped it."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    errors = Console(stderr=True, markup=False, emoji=False)
    for notice in pipeline.registry.notices:
        typer.echo(notice, err=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[state]}"))
    with Progress(*columns, console=errors, disable=as_json or not errors.is_terminal, transient=True) as bar:
        task = bar.add_task(pipeline.run.name, total=None, state="")
        began = time.monotonic()

        def show(now: float, total: float | None, behind: float) -> None:
            rate = now / max(time.monotonic() - began, 1e-3)
            late = f"; estimates are {behind:.1f} s behind" if behind > _BEHIND else ""
            with contextlib.suppress(OSError):  # a terminal that has gone
                bar.update(task, completed=now, total=total, state=f"{now:.1f} s, {rate:.0f} x real time{late}")

        result = run_pipeline(pipeline, out, show)
    if result.signal == signal.SIGHUP:  # there is no terminal any more
        result.demand_whole()
    if as_json:
        typer.echo(json.dumps(result.table(), indent=2))
    else:
        console().print(result_view(result, pipeline.registry.sections))
    result.demand_whole()
