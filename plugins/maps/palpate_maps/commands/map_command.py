"""``palpate map``: from a run to a map, or to a curve along a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError, to_si
from palpate_kit.curves.fit_folder import is_fit_folder
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import (
    ForceOption,
    JsonOption,
    LateralOption,
    Overrides,
    Points,
    PositionOption,
    RateOption,
    TimeOption,
    TrackOption,
    WhereOption,
)
from palpate_kit.terminal.progress import progress

from palpate_maps.commands.curve_map import show_cells
from palpate_maps.commands.curves_command import drop_rejected
from palpate_maps.commands.first_run import folder_of
from palpate_maps.commands.map_output import (
    MapAnswer,
    MapOutput,
    MapSource,
    read_output,
    write_flat_map,
    write_map_on_surface,
    write_sweep,
)

Run = Annotated[Path, typer.Argument(help="The run folder.")]
Parameter = Annotated[str | None, typer.Option(help="Parameter of its model. [default: the first]")]

SurfaceName = Annotated[str | None, typer.Option(help="NAME of the [surface.NAME] of the run that was palpated.")]


def length(text: str, option: str) -> float:
    """Return a length of the command line [m]; raises ConfigurationError."""
    try:
        return to_si(text, "m")
    except ValueError as error:
        raise ConfigurationError(f"{option}: {error}") from error


@with_facts
def map_run(
    run: Annotated[
        Path,
        typer.Argument(
            help="The run folder, a folder of fits of many curves, a pipeline file to run first; with --tip a table of "
            "a sweep to run first, or curves to fit first: the map of a microscope, or a folder."
        ),
    ],
    tip: Annotated[str | None, typer.Option(help='Of curves: their tip, such as "sphere 3 mm" (its radius).')] = None,
    model: Annotated[str | None, typer.Option(help="With --tip: the contact model. [default: dr]")] = None,
    force: ForceOption = None,
    position: PositionOption = None,
    lateral: LateralOption = None,
    time: TimeOption = None,
    rate: RateOption = None,
    track: TrackOption = None,
    where: WhereOption = None,
    parameter: Parameter = None,
    cell: Annotated[str, typer.Option(help="Size of the map's cells.")] = "1 mm",
    method: Annotated[str, typer.Option(help="gaussian-process or average.")] = "gaussian-process",
    points: Points = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder to write to. [default: RUN/maps]")] = None,
    svg: Annotated[bool, typer.Option("--svg", help="SVG pictures instead of PNG.")] = False,
    surface: SurfaceName = None,
    overrides: Overrides = None,
    as_json: JsonOption = False,
) -> None:
    """Make the map of a run, with its uncertainty: CSV, NPZ and a picture; for a sweep, a curve.

    Of a folder of fits of many curves each curve is a site, at x_m and y_m of its curves.csv, or where it was measured;
    less than 1 mm apart each is a cell. With --tip, a file of curves or a folder of them is fitted first, as by fit;
    a table whose tip moves along the skin, by its columns x and y or by --lateral, is run first, by a smoother.
    A pipeline file is run first, into a new folder of runs/. No earlier map is written over: the second is map-2.
    Where the pipeline of the run has a surface, the map is on it: a PLY in place of the NPZ, seen from three sides.
    """
    from palpate_maps.curve_cells import read_curve_cells

    if method not in ("gaussian-process", "average"):
        raise ConfigurationError(f'--method: {method!r} is not one of "gaussian-process" and "average"')
    # A pipeline, a log of a sweep or unfitted curves are run or fitted first, with the columns that are stated.
    columns = {"force": force, "position": position, "lateral": lateral, "time": time, "rate": rate}
    stated_columns = {role: column for role, column in columns.items() if column is not None}
    run = folder_of(run, tip, model, stated_columns, overrides or [])
    is_of_curves = is_fit_folder(run)
    if where is not None and not is_of_curves:
        raise ConfigurationError(f"--where: {run} is not a folder of fits of many curves")
    drop_rejected([] if is_of_curves else [run])
    source = MapSource(run=run, track=track, parameter=parameter, where=where, surface=surface)
    folder = out or RunFolder(run).maps
    picture_ending = "svg" if svg else "png"
    # Curves less than 1 mm apart are a cell each, without interpolation.
    if is_of_curves:
        cells = read_curve_cells(run, track, parameter, where)
        if cells is not None:
            show_cells(cells, run, folder, picture_ending, as_json)
            return
    with progress(f"map of {run.resolve().name}"):
        output = read_output(source, folder, picture_ending)
        written = _write(output, cell=cell, method=method, points=points)
    _print_answer(output, written, as_json)


def _write(output: MapOutput, cell: str, method: str, points: Path | None) -> MapAnswer:
    """Write a sweep, a map on a surface or a map in the plane, by where its sites are; raises ConfigurationError."""
    if output.sweep_length is not None:
        return write_sweep(output, output.sweep_length, points)
    if output.surface is None:
        return write_flat_map(output, length(cell, "--cell"), method)
    if method != "gaussian-process":
        raise ConfigurationError("--method: a map on a surface is a Gaussian process, in a PLY file")
    return write_map_on_surface(output, output.surface, length(cell, "--cell"))


def _print_answer(output: MapOutput, written: MapAnswer, as_json: bool) -> None:
    """Print the warning of the lumps' test, then the map in words with its uncertainty, or as JSON."""
    if output.findings is not None and output.findings.warning:
        typer.echo(f"warning: {output.findings.warning}", err=True)
    if as_json:
        files = sorted(output.folder.glob(f"{written.name}.*"))
        print_json({**written.answer, **output.document, "files": files})
        return
    place = f"written to {output.folder / written.name}.csv and next to it"
    typer.echo("\n".join([written.sentence, *output.uncertainty, place]))
