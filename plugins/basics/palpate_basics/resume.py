"""``palpate resume``: go on with a run that was interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate.host import RunFolder, console, remaining_pipeline, run_pipeline

from palpate_basics.view import result_view


def resume(run: Annotated[Path, typer.Argument(help="The folder of the run that was interrupted.")]) -> None:
    """Do what an interrupted run left: whole lines of a raster, whole points; in a folder inside the run's."""
    pipeline = remaining_pipeline(run)
    if pipeline is None:
        typer.echo(f"{run}: was finished; nothing is left to do")
        return
    result = run_pipeline(pipeline, RunFolder(run).next_part)
    console().print(result_view(result, pipeline.registry.sections))
    result.demand_whole()
