"""The command over run folders, and the section of a report."""

from pathlib import Path
from typing import Annotated

import typer
from palpate_engine import Result
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.table import Table, console


def stairs(runs: Annotated[list[Path], typer.Argument(help="Run folders.")]) -> None:
    """Print the elasticity of every track of runs."""
    rows = []
    for run in runs:
        for label, track in RunFolder(run).result["tracks"].items():
            value = track["parameters"]["elasticity"]
            rows.append((run.name, label, f"{1e-3 * value['value']:.4g}", f"{1e-3 * value['combined']:.2g}"))
    console().print(Table.of("staircases", ["run", "track", "kPa", "+-"], rows, ["run", "track"]).view())


def section(result: Result) -> list[Table | str]:
    """Say of each track how many sources its budget has."""
    tracks = result.table()["tracks"]
    return [f"stairs: {label} has {len(track['budget'])} rows in its budget" for label, track in tracks.items()]
