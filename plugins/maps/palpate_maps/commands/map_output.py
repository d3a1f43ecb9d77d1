"""Files of a map: the table, the arrays or the surface, and the picture, of a sweep or of an area."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from palpate import Floats, KnowsTruth, LogError, PalpateError, Surface
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.figures import save_figure

from palpate_maps.commands.curves_command import curves_of, points_of, unit_of

if TYPE_CHECKING:
    from palpate_maps.body_field import BodyFit
    from palpate_maps.map_analysis import Findings, Path2D, Sites
    from palpate_maps.rig_share import RigShare


@dataclass(frozen=True)
class MapSource:
    """A run or a folder of fits, and the part of it that is mapped; None is the default of each."""

    run: Path
    track: str | None
    parameter: str | None
    where: str | None  # filter of a folder's curves
    surface: str | None  # name of the [surface.NAME] that was palpated


@dataclass(frozen=True)
class MapOutput:
    """The sites and findings of a map or a sweep, and the folder of its files."""

    source: MapSource
    folder: Path
    picture_ending: str
    path: Path2D
    sites: Sites
    findings: Findings | None
    surface: Surface | None
    sweep_length: float | None  # [m]; None of an area, and of points only

    @property
    def unit(self) -> str:
        """Of the parameter."""
        run = self.source.run
        if is_fit_folder(run):
            return FitFolder(run).units.get(self.path.parameter, "")
        return unit_of(run, self.path.track, self.path.parameter)

    @cached_property
    def common(self) -> RigShare:
        """The uncertainties that all places have in common."""
        from palpate_maps.rig_share import RigShare, rig_share

        if is_fit_folder(self.source.run):
            return RigShare(0.0, {})
        return rig_share(self.source.run, self.path.track, self.path.parameter)

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

    def write_files(self, stem: str, table: str, arrays: Mapping[str, str | bytes], figure: Any) -> str:
        """Write a CSV table, a file for each ending of `arrays`, and a picture; return their free name."""
        from palpate_maps import map_files

        name = map_files.free_name(self.folder, stem, table)
        map_files.replace_file(self.folder / f"{name}.csv", table)
        for ending, content in arrays.items():
            map_files.replace_file(self.folder / f"{name}.{ending}", content)
        save_figure(figure, self.folder / f"{name}.{self.picture_ending}")
        return name


@dataclass(frozen=True)
class MapAnswer:
    """Name of a map's files, the map in a sentence, and its answer for programs."""

    name: str
    sentence: str
    answer: dict[str, Any]


def read_output(source: MapSource, folder: Path, picture_ending: str) -> MapOutput:
    """Return the sites and lumps of a run or a folder of fits, with its surface, and of a sweep the length [m].

    `picture_ending` is that of the picture to write into the folder, such as "png".
    Sites along a line that are not all points are a sweep; the length of anything else is None.
    """
    from palpate_maps import map_analysis as maps

    surface = None
    is_of_curves = is_fit_folder(source.run)
    if is_of_curves:
        path, sites = maps.read_curve_sites(source.run, source.track, source.parameter, source.where)
    else:
        path = maps.read_path(source.run, source.track, source.parameter)
        sites = maps.sites_along(path)
        surface = maps.surface_of_run(source.run, source.surface)
    coordinate = None if sites.standing.all() else maps.line_coordinate(sites)

    # Lumps of an area are sought on its surface, those of a sweep along the line.
    findings = None
    with suppress(LogError):  # too few sites for lumps are enough for a map
        sites_of_lumps = sites
        if surface is not None and coordinate is None:
            sites_of_lumps = maps.sites_on(sites, surface)
        if is_of_curves:
            findings = maps.find_lumps(sites_of_lumps)
        else:
            findings = maps.lumps_of_run(source.run, path, sites_of_lumps)
    return MapOutput(
        source=source,
        folder=folder,
        picture_ending=picture_ending,
        path=path,
        sites=sites,
        findings=findings,
        surface=surface,
        sweep_length=None if coordinate is None else float(coordinate.max() - coordinate.min()),
    )


def write_sweep(output: MapOutput, sweep_length: float, points: Path | None) -> MapAnswer:
    """Write the curves along a line of a length [m] and their picture, with point palpations if there are any."""
    from palpate_maps import map_figures, map_files

    source, path = output.source, output.path
    curves = curves_of(source.run, [source.track] if source.track else None, source.parameter)
    series = {name: (curve.along, curve.sites) for name, curve in curves.items()}
    palpations = points_of(points, output.folder, source.parameter) if points is not None else None
    figure = map_figures.sweep_picture(series, path.parameter, output.unit, output.findings, palpations)
    table = map_files.sweep_csv(series, path.parameter)
    name = output.write_files("sweep", table, {}, figure)
    sentence = f"sweep of {1e3 * sweep_length:.4g} mm, {len(output.sites)} sites, {path.source}"
    return MapAnswer(name, sentence, {"kind": "sweep", "length": sweep_length})


def write_flat_map(output: MapOutput, cell_size: float, method: str) -> MapAnswer:
    """Write the map of an area, with cells of a size [m], and its picture; return its text, and its facts for JSON."""
    from palpate_maps import map_analysis as maps, map_figures, map_files

    path, sites = output.path, output.sites
    field = maps.make_map(sites, cell_size, method, output.fit)  # type: ignore[arg-type]
    outlines = outlines_of(output.source.run)
    figure = map_figures.map_picture(field, path.parameter, output.unit, output.findings, outlines)
    arrays = {"npz": map_files.map_npz(field, path.parameter)}
    name = output.write_files("map", map_files.map_csv(field, path.parameter), arrays, figure)

    size = f"{1e3 * (field.x[-1] - field.x[0]):.4g} mm x {1e3 * (field.y[-1] - field.y[0]):.4g} mm"
    covered = f"{100 * field.coverage:.0f} % covered, {len(sites)} sites, {path.source}"
    interpolated = _interpolation_text(field.length, field.blind_below)
    answer = {
        "kind": "map",
        "low": [field.x[0], field.y[0]],
        "high": [field.x[-1], field.y[-1]],
        "coverage": field.coverage,
        "interpolated_over": field.length,
        "blind_below": field.blind_below,
    }
    return MapAnswer(name, f"map of {size}, {covered}, {interpolated}", answer)


def write_map_on_surface(output: MapOutput, surface: Surface, cell_size: float) -> MapAnswer:
    """Write the map on a surface, with cells of a size [m], and its picture; print a warning of its curvature."""
    from palpate_kit.runs.surface_map_file import write_surface_map

    from palpate_maps.surface_map import make_surface_map, sites_on, surface_map_csv

    path, sites = output.path, output.sites
    surface_map = make_surface_map(sites, surface, cell_size, path.parameter, output.unit, output.fit)
    figure = _surface_figure(surface_map.map, sites_on(sites, surface).place, output.findings)
    arrays = {"ply": write_surface_map(surface_map.map)}
    name = output.write_files("map", surface_map_csv(surface_map), arrays, figure)
    if surface_map.warning:
        typer.echo(f"warning: {surface_map.warning}", err=True)

    # The text, and the facts for JSON: all lengths in m, `reach` the one within which straight distances hold.
    vertices = surface_map.map.vertices
    size = f"{len(vertices)} vertices, {len(sites)} sites, {path.source}"
    interpolated = _interpolation_text(surface_map.length, surface_map.blind_below)
    answer = {
        "kind": "surface",
        "low": vertices.min(axis=0).tolist(),
        "high": vertices.max(axis=0).tolist(),
        "interpolated_over": surface_map.length,
        "blind_below": surface_map.blind_below,
        "straight_within": surface_map.reach,
    }
    return MapAnswer(name, f"map on a surface, {size}, {interpolated}", answer)


def _surface_figure(surface_map: Any, places: Floats, findings: Findings | None) -> Any:
    """Draw a map on a surface with the places (n, 3) [m] of its sites, the lumps, and those that are excluded."""
    from palpate_kit.runs.surface_map_figure import surface_map_figure

    from palpate_maps import map_files

    if findings is None:
        return surface_map_figure(surface_map, places, [], excluded=[])
    lumps = [(*lump.place, lump.height, lump.p) for lump in findings.lumps if lump.height is not None]
    return surface_map_figure(surface_map, places, lumps, excluded=map_files.exclusion_table(findings))


def _interpolation_text(interpolation_length: float, blind_width: float) -> str:
    """Return the length [m] of a map's interpolation, and the width [m] below which lumps may lie between sites."""
    return (
        f"interpolated over {1e3 * interpolation_length:.3g} mm\nblind to lumps narrower than "
        f"{1e3 * blind_width:.2g} mm: they may lie between the places that were palpated"
    )


def outlines_of(run: Path) -> list[Any]:
    """Return the outlines of what a simulated rig hides; none where the pipeline cannot be read again."""
    from palpate_kit.runs.continuation import recorded_pipeline

    outlines: list[Any] = []
    try:
        for device in recorded_pipeline(run).devices.values():
            if isinstance(device, KnowsTruth):
                outlines.extend(device.outlines)
    except PalpateError:
        return []
    return outlines
