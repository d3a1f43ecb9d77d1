"""``palpate map``: from a run to a map, or to a curve along a sweep."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError, KnowsTruth, LogError, PalpateError, Surface, to_si
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.figures import save_figure
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
from palpate_maps.commands.curves_command import curves_of, drop_rejected, points_of, unit_of
from palpate_maps.commands.first_run import folder_of

if TYPE_CHECKING:
    from palpate_maps.body_field import BodyFit
    from palpate_maps.map_analysis import Findings, Path2D, Sites
    from palpate_maps.rig_share import RigShare

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
    columns = {"force": force, "position": position, "lateral": lateral, "time": time, "rate": rate}
    stated_columns = {role: column for role, column in columns.items() if column is not None}
    run = folder_of(run, tip, model, stated_columns, overrides or [])
    is_of_curves = is_fit_folder(run)
    if where is not None and not is_of_curves:
        raise ConfigurationError(f"--where: {run} is not a folder of fits of many curves")
    drop_rejected([] if is_of_curves else [run])
    folder, ending = out or RunFolder(run).maps, "svg" if svg else "png"
    if is_of_curves and (cells := read_curve_cells(run, track, parameter, where)) is not None:
        show_cells(cells, run, folder, ending, as_json)
        return
    with progress(f"map of {run.resolve().name}"):
        output, skin, sweep_length = _sites_and_lumps(run, folder, ending, track, parameter, where, surface)
        if sweep_length is not None:
            name, sentence, answer = _sweep(output, sweep_length, track, parameter, points)
        elif skin is not None:
            if method != "gaussian-process":
                raise ConfigurationError("--method: a map on a surface is a Gaussian process, in a PLY file")
            name, sentence, answer = _on_surface(output, skin, length(cell, "--cell"))
        else:
            name, sentence, answer = _map(output, length(cell, "--cell"), method)
    if output.findings is not None and output.findings.warning:
        typer.echo(f"warning: {output.findings.warning}", err=True)
    if as_json:
        print_json({**answer, **output.document, "files": sorted(output.folder.glob(f"{name}.*"))})
        return
    typer.echo("\n".join([sentence, *output.uncertainty, f"written to {output.folder / name}.csv and next to it"]))


def _sites_and_lumps(
    run: Path,
    folder: Path,
    ending: str,
    track: str | None,
    parameter: str | None,
    where: str | None,
    surface: str | None,
) -> tuple[_MapOutput, Surface | None, float | None]:
    """Return the sites and lumps of a run or a folder of fits, its surface, and of a sweep the length [m].

    Sites along a line that are not all points are a sweep; the length of anything else is None.
    """
    from palpate_maps import map_analysis as maps

    is_of_curves = is_fit_folder(run)
    skin = None
    if is_of_curves:
        path, sites = maps.read_curve_sites(run, track, parameter, where)
    else:
        path = maps.read_path(run, track, parameter)
        sites = maps.sites_along(path)
        skin = maps.surface_of_run(run, surface)
    along = None if sites.standing.all() else maps.line_coordinate(sites)
    findings = None
    with suppress(LogError):  # too few sites for lumps are enough for a map
        sites_of_lumps = sites if skin is None or along is not None else maps.sites_on(sites, skin)
        findings = maps.find_lumps(sites_of_lumps) if is_of_curves else maps.lumps_of_run(run, path, sites_of_lumps)
    output = _MapOutput(run=run, folder=folder, ending=ending, path=path, sites=sites, findings=findings)
    return output, skin, None if along is None else float(along.max() - along.min())


@dataclass(frozen=True)
class _MapOutput:
    """The sites and findings of a map or a curve, and the folder of its files."""

    run: Path
    folder: Path
    ending: str  # of pictures
    path: Path2D
    sites: Sites
    findings: Findings | None

    @property
    def unit(self) -> str:
        """Of the parameter."""
        if is_fit_folder(self.run):
            return FitFolder(self.run).units.get(self.path.parameter, "")
        return unit_of(self.run, self.path.track, self.path.parameter)

    @cached_property
    def common(self) -> RigShare:
        """The uncertainties that all places have in common."""
        from palpate_maps.rig_share import RigShare, rig_share

        if is_fit_folder(self.run):
            return RigShare(0.0, {})
        return rig_share(self.run, self.path.track, self.path.parameter)

    @property
    def uncertainty(self) -> list[str]:
        """The parts of the ±, repeatability and that of the rig, as sentences."""
        repeatability = 100 * float(self.sites.std.mean())
        line = f"±: of a place {repeatability:.2g} % as the estimator states it, which the table and the picture have"
        return [line, *filter(None, [self.common.sentence("±")])]

    @property
    def fit(self) -> BodyFit | None:
        """The bodies of an area."""
        return self.findings.fit if self.findings is not None else None

    @property
    def document(self) -> dict[str, Any]:
        """For --json: the track, the parameter, the parts of the relative uncertainty, and the lumps."""
        return {
            "track": self.path.track,
            "other_tracks": self.path.others,
            "parameter": self.path.parameter,
            "unit": self.unit,
            "sites": len(self.sites),
            "common_uncertainty": {"run": self.common.run, **self.common.causes},
            "lumps": self.findings.lumps if self.findings is not None else None,
        }


Written = tuple[str, str, dict[str, Any]]  # name of the files, a sentence, and the answer for programs


def _sweep(output: _MapOutput, way: float, track: str | None, parameter: str | None, points: Path | None) -> Written:
    """Write the curve along a line of a length [m], and its picture."""
    from palpate_maps import map_figures, map_files

    path, folder = output.path, output.folder
    curves = curves_of(output.run, [track] if track else None, parameter)
    series = {name: (curve.along, curve.sites) for name, curve in curves.items()}
    checked = points_of(points, folder, parameter) if points is not None else None
    image = map_figures.sweep_picture(series, path.parameter, output.unit, output.findings, checked)
    table = map_files.sweep_csv(series, path.parameter)
    name = map_files.free_name(folder, "sweep", table)
    map_files.replace_file(folder / f"{name}.csv", table)
    save_figure(image, folder / f"{name}.{output.ending}")
    sentence = f"sweep of {1e3 * way:.4g} mm, {len(output.sites)} sites, {path.source}"
    return name, sentence, {"kind": "sweep", "length": way}


def _map(output: _MapOutput, cell_size: float, method: str) -> Written:
    """Write the map of an area, with cells of a size [m], and its picture."""
    from palpate_maps import map_analysis as maps, map_figures, map_files

    path, folder, sites = output.path, output.folder, output.sites
    field = maps.make_map(sites, cell_size, method, output.fit)  # type: ignore[arg-type]
    image = map_figures.map_picture(field, path.parameter, output.unit, output.findings, outlines_of(output.run))
    table = map_files.map_csv(field, path.parameter)
    name = map_files.free_name(folder, "map", table)
    map_files.replace_file(folder / f"{name}.csv", table)
    map_files.replace_file(folder / f"{name}.npz", map_files.map_npz(field, path.parameter))
    save_figure(image, folder / f"{name}.{output.ending}")
    size = f"{1e3 * (field.x[-1] - field.x[0]):.4g} mm x {1e3 * (field.y[-1] - field.y[0]):.4g} mm"
    covered = f"{100 * field.coverage:.0f} % covered, {len(sites)} sites, {path.source}"
    sentence = f"map of {size}, {covered}, interpolated over {1e3 * field.length:.3g} mm\n{_blind(field.blind_below)}"
    ends = {"low": [field.x[0], field.y[0]], "high": [field.x[-1], field.y[-1]]}
    numbers = {"coverage": field.coverage, "interpolated_over": field.length, "blind_below": field.blind_below}
    return name, sentence, {"kind": "map", **ends, **numbers}


def _blind(width: float) -> str:
    """Return a sentence on lumps that may lie between the sites of a map, narrower than a width [m]."""
    return f"blind to lumps narrower than {1e3 * width:.2g} mm: they may lie between the places that were palpated"


def _on_surface(output: _MapOutput, surface: Surface, cell: float) -> Written:
    """Write the map on a surface, with cells of a size [m], and its picture."""
    from palpate_kit.runs.surface_map_figure import surface_map_figure
    from palpate_kit.runs.surface_map_file import write_surface_map

    from palpate_maps import map_files
    from palpate_maps.surface_map import make_surface_map, sites_on, surface_map_csv

    path, folder, sites = output.path, output.folder, output.sites
    surface_map = make_surface_map(sites, surface, cell, path.parameter, output.unit, output.fit)
    lumps = output.findings.lumps if output.findings else ()
    places = [(*lump.place, lump.height, lump.p) for lump in lumps if lump.height is not None]
    excluded = map_files.exclusion_table(output.findings) if output.findings else []
    image = surface_map_figure(surface_map.map, sites_on(sites, surface).place, places, excluded=excluded)
    table = surface_map_csv(surface_map)
    name = map_files.free_name(folder, "map", table)
    map_files.replace_file(folder / f"{name}.csv", table)
    map_files.replace_file(folder / f"{name}.ply", write_surface_map(surface_map.map))
    save_figure(image, folder / f"{name}.{output.ending}")
    if surface_map.warning:
        typer.echo(f"warning: {surface_map.warning}", err=True)
    size = f"{len(surface_map.map.vertices)} vertices, {len(sites)} sites, {path.source}"
    interpolated = f"interpolated over {1e3 * surface_map.length:.3g} mm\n{_blind(surface_map.blind_below)}"
    sentence = f"map on a surface, {size}, {interpolated}"
    vertices = surface_map.map.vertices
    ends = {"low": vertices.min(axis=0).tolist(), "high": vertices.max(axis=0).tolist()}
    numbers = {
        "interpolated_over": surface_map.length,
        "blind_below": surface_map.blind_below,
        "straight_within": surface_map.reach,
    }
    return name, sentence, {"kind": "surface", **ends, **numbers}


def outlines_of(run: Path) -> list[Any]:
    """Return the outlines of what a simulated rig hides; none where the pipeline cannot be read again."""
    from palpate_kit.runs.continuation import recorded_pipeline

    try:
        devices = recorded_pipeline(run).devices.values()
        return [outline for device in devices if isinstance(device, KnowsTruth) for outline in device.outlines]
    except PalpateError:
        return []
