"""The command and the section."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from palpate.host import Result
from palpate_kit.runs.continuation import recorded_pipeline
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.table import Table, console

from palpate_histogram import HistogramSettings


def histogram(
    runs: Annotated[list[Path], typer.Argument(help="Run folders.")],
    track: Annotated[str, typer.Option(help="Which track.")] = "dr/ekf",
    parameter: Annotated[str, typer.Option(help="Which parameter.")] = "elasticity",
) -> None:
    """Print how often an estimate of runs falls into each bin; `[histogram] bins` of the first run says how many."""
    settings = recorded_pipeline(runs[0]).tables.get("histogram", HistogramSettings())
    values = [RunFolder(run).result["tracks"][track]["parameters"][parameter]["value"] for run in runs]
    counts, edges = np.histogram(values, bins=settings.bins)
    rows = [(f"{low:.4g} to {high:.4g}", str(count)) for low, high, count in zip(edges, edges[1:], counts)]
    console().print(Table.of(f"{parameter} of {track}", ["SI", "runs"], rows).view())


def section(result: Result) -> list[Table | str]:
    """A sentence on the result."""
    return [f"histogram: {len(result.tracks)} tracks to count"]
