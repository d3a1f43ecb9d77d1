"""``palpate run``: a pipeline from its file to its result."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.rehearsal import rehearse
from palpate.cli.tables import result_view
from palpate.config import load_pipeline


def run(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    out: Annotated[
        Path | None, typer.Option(help="Run folder; must be new or empty. [default: runs/DATE_TIME_NAME]")
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Override a setting; can be repeated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead of the table.")] = False,
    dry: Annotated[bool, typer.Option("--dry-run", help="Show the motion and its limits; connect to nothing.")] = False,
    seed: Annotated[int | None, typer.Option(help="Seed of the run; overrides that of the file.", min=0)] = None,
) -> None:
    """Run a pipeline; print what was found and where it is written."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    from palpate.pipeline import run_pipeline

    assignments = [*(overrides or []), *([f"run.seed={seed}"] if seed is not None else [])]
    pipeline = load_pipeline(file, assignments)
    if dry:
        rehearse(pipeline)
        return
    errors, console = Console(stderr=True), Console()
    for plugin, reason in pipeline.registry.failures.items():
        errors.print(f"[yellow]plugin {plugin} could not be loaded: {reason}[/]", highlight=False)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[state]}"))
    with Progress(*columns, console=errors, disable=as_json or not errors.is_terminal, transient=True) as bar:
        task = bar.add_task(pipeline.run.name, total=None, state="")
        began = time.monotonic()

        def show(now: float, total: float | None) -> None:
            rate = now / max(time.monotonic() - began, 1e-3)
            bar.update(task, completed=now, total=total, state=f"{now:.1f} s, {rate:.0f} x real time")

        result = run_pipeline(pipeline, out, show)
    if as_json:
        typer.echo(json.dumps(result.table(), indent=2))
    else:
        if not console.is_terminal:
            console = Console(width=120)
        console.print(result_view(result))
    if result.interrupted is not None:
        raise typer.Exit(130)
