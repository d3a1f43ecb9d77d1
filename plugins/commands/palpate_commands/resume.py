"""``palpate run resume``: continue a run that was interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate_kit.runs.continuation import demand_unchanged
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.options import Overrides, UnchangedOption

from palpate_commands.remaining_motion import remaining_pipeline
from palpate_commands.run import execute


def resume(
    run: Annotated[Path, typer.Argument(help="The folder of the run that was interrupted.")],
    overrides: Overrides = None,
    yes: UnchangedOption = False,
) -> None:
    """Do the rest of an interrupted run: whole lines of a raster, whole points; in a folder inside the run's.

    The pipeline is used as recorded, and a rehearsal's in simulated time. Before a robot moves it is asked whether
    specimen and tool are still the same.
    """
    pipeline = remaining_pipeline(run, overrides or [])
    if pipeline is None:
        typer.echo(f"{run}: is complete; nothing is left to do")
        return
    demand_unchanged(pipeline, yes)
    execute(pipeline, RunFolder(run).next_part)
