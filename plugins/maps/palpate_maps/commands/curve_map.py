"""``palpate map`` of curves: those of a microscope are fitted first, and each is a cell of the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from palpate import ConfigurationError
from palpate_engine import analysis, make_folder
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.figures import save_figure
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.json_output import print_aside, print_json

if TYPE_CHECKING:
    from palpate_maps.curve_cells import CurveCells


def is_of_curves(run: Path, tip: str | None) -> bool:
    """Return True for files of curves that are to be fitted; raises ConfigurationError for a tip of anything else."""
    if run.is_file() and run.suffix != ".toml":
        return True
    if tip is not None and (run.suffix == ".toml" or is_fit_folder(run) or RunFolder(run).began):
        raise ConfigurationError(f"--tip: {run} has one; it is for files without a pipeline")
    return tip is not None


def fit_first(
    curves: Path, tip: str | None, model: str | None, choices: Mapping[str, str], overrides: Sequence[str]
) -> Path:
    """Return a new folder of fits of curves, whose columns `choices` name."""
    folder = make_folder("fit", None, datetime.now(UTC).astimezone())
    with print_aside(True), suppress(typer.Exit):  # which says that one of them has no value: the map does, too
        analysis("fit")([curves], tip=tip, model=model, overrides=[*overrides], out=folder, **choices)
    return folder


def show_cells(cells: CurveCells, run: Path, folder: Path, ending: str, as_json: bool) -> None:
    """Write the map of curves on a grid, and print where, and which curves have no value.

    `cells` has the value of each curve at its cell of a grid. `ending` is that of the picture, such as "png".
    """
    from palpate_maps import map_files
    from palpate_maps.curve_cells import cells_csv, cells_npz, cells_picture, length_unit

    unit = FitFolder(run).units.get(cells.parameter, "")
    table = cells_csv(cells)
    name = map_files.free_name(folder, "map", table)
    map_files.replace_file(folder / f"{name}.csv", table)
    map_files.replace_file(folder / f"{name}.npz", cells_npz(cells))
    save_figure(cells_picture(cells, unit), folder / f"{name}.{ending}")
    # As JSON: the corners of the grid [m], and the counts.
    if as_json:
        ends = {"low": [cells.x[0], cells.y[0]], "high": [cells.x[-1], cells.y[-1]]}
        facts = {"parameter": cells.parameter, "unit": unit, "curves": len(cells.rows), "without": cells.failures}
        print_json({"kind": "cells", **ends, **facts, "files": sorted(folder.glob(f"{name}.*"))})
        return
    _print_failures(cells.failures)
    length, per_metre = length_unit(max(cells.extent))
    size = " x ".join(f"{per_metre * side:.4g} {length}" for side in cells.extent)
    counts = f"{len(cells.rows)} curves, {len(cells.failures)} without {cells.parameter}"
    typer.echo(f"map of {size}, {counts}\nwritten to {folder / name}.csv and next to it")


def _print_failures(failures: Mapping[str, str]) -> None:
    """Print each reason for which curves have no value once, with the first curve and the number of the others."""
    curves_by_lack: dict[str, list[str]] = {}
    for curve, lack in failures.items():
        curves_by_lack.setdefault(lack, []).append(curve)
    for lack, curves in curves_by_lack.items():
        remainder = f" and {len(curves) - 1} more" if len(curves) > 1 else ""
        typer.echo(f"{curves[0]}{remainder}: {lack}", err=True)
