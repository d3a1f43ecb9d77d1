"""``palpate resume``: go on with a run that was interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.tables import result_view


def resume(run: Annotated[Path, typer.Argument(help="The folder of the run that was interrupted.")]) -> None:
    """Do what an interrupted run left: whole lines of a raster, whole points; in a folder inside the run's."""
    from rich.console import Console

    from palpate.pipeline import next_part, remaining_pipeline, run_pipeline

    pipeline = remaining_pipeline(run)
    if pipeline is None:
        typer.echo(f"{run}: was finished; nothing is left to do")
        return
    result = run_pipeline(pipeline, next_part(run))
    Console(width=120).print(result_view(result))
    if result.interrupted is not None:
        raise typer.Exit(130)
