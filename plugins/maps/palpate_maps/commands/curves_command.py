"""Curves along a sweep, of several tracks or runs, with point palpations: one picture and one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError, Floats, LogError, PalpateError
from palpate_engine import TrackName
from palpate_kit.figures import save_figure
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption, Points
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.table import console

if TYPE_CHECKING:
    from palpate_maps.map_analysis import Lump, Sites


@dataclass(frozen=True)
class TrackCurve:
    """One track's estimates along a sweep."""

    parameter: str
    unit: str
    along: Floats  # (n,) [m]
    sites: Sites
    lumps: tuple[Lump, ...]
    lags: bool = False  # its verdict says that it does not follow the changes along its path


def curves_of(
    run: Path, tracks: Sequence[str] | None = None, parameter: str | None = None, prefix: str = ""
) -> dict[str, TrackCurve]:
    """Return the curve of each track of a run with estimates along a line, by its name after a prefix."""
    from palpate_maps import map_analysis as maps

    curves = {}
    for name in tracks or maps.tracks_of(run):
        with suppress(LogError):  # a track that found nothing is not drawn
            curve = _curve_of(run, name, parameter)
            if curve is not None:
                curves[prefix + name] = curve
    return curves


def _curve_of(run: Path, track: str, parameter: str | None) -> TrackCurve | None:
    """Return a track's estimates along its line, None where it has none; raises LogError without estimates."""
    from palpate_maps import map_analysis as maps

    path = maps.read_path(run, track, parameter)
    sites = maps.sites_along(path)
    along = maps.line_coordinate(sites)
    if along is None or sites.standing.all():
        return None
    lumps: tuple[Lump, ...] = ()
    with suppress(LogError):  # too short for lumps
        lumps = maps.find_lumps(sites).lumps
    return TrackCurve(
        parameter=path.parameter,
        unit=unit_of(run, track, path.parameter),
        along=along,
        sites=sites,
        lumps=lumps,
        lags=path.lags,
    )


def points_of(points: Path, folder: Path, parameter: str | None = None) -> tuple[Any, Sites]:
    """Return coordinate (n,) [m] and sites of point palpations; run a pipeline file first, into ``points`` in a folder.

    `points` is the run folder, or the pipeline file.
    Raises LogError where they are on no line.
    """
    from palpate_maps import map_analysis as maps

    run = points
    if points.suffix == ".toml":
        from palpate_engine import load_pipeline, run_pipeline
        from palpate_kit.runs.run_folder import RunFolder

        run = folder / "points"
        if not RunFolder(run).finished:
            with progress(str(points), "s"):
                run_pipeline(load_pipeline(points), run, report_progress).demand_whole()
    sites = maps.sites_along(maps.read_path(run, None, parameter))
    sites = sites[sites.standing]
    along = maps.line_coordinate(sites) if len(sites) > 1 else None
    if along is None:
        raise LogError(f"{run}: contains no point palpations on a line")
    return along, sites


def curves(
    runs: Annotated[list[Path], typer.Argument(help="Run folders of sweeps along one line.")],
    label: Annotated[
        list[str] | None, typer.Option("--label", help="Names of the runs, in their order. [default: their folders]")
    ] = None,
    points: Points = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="The picture to draw: .png or .svg.")] = Path("sweep.png"),
    as_json: JsonOption = False,
) -> None:
    """Draw the curves of all tracks of runs along a line with the lumps in each, and print their table."""
    labels = label or [run.name if len(runs) > 1 else "" for run in runs]
    if len(labels) != len(runs):
        raise ConfigurationError(f"--label: {len(labels)} labels for {len(runs)} runs")
    curves_by_name: dict[str, TrackCurve] = {}
    accepted_runs = drop_rejected(runs)
    for run_label, run in zip(labels, runs, strict=True):
        if run in accepted_runs:
            curves_by_name |= _labelled_curves(run, run_label)
    if not curves_by_name:
        raise LogError(f"{', '.join(str(run) for run in runs)}: no sweep along a line")
    unit = next(iter(curves_by_name.values())).unit
    tell_curves(curves_by_name, points_of(points, out.parent) if points else None, unit, out, as_json)


def _labelled_curves(run: Path, run_label: str) -> dict[str, TrackCurve]:
    """Return the curves of a run's tracks, by "track, label"; a single track has the label alone, if there is one."""
    curves_by_track = curves_of(run)
    curves_by_name = {}
    for track, curve in curves_by_track.items():
        if not run_label:
            name = track
        elif len(curves_by_track) == 1:
            name = run_label
        else:
            name = f"{track}, {run_label}"
        curves_by_name[name] = curve
    return curves_by_name


def tell_curves(
    curves: Mapping[str, TrackCurve], points: tuple[Any, Sites] | None, unit: str, picture_file: Path, as_json: bool
) -> None:
    """Draw the curves and print their table; `points` are coordinate and sites of point palpations on the line."""
    from palpate_maps import map_figures

    parameter = next(iter(curves.values())).parameter
    series = {name: (curve.along, curve.sites) for name, curve in curves.items()}
    save_figure(map_figures.sweep_picture(series, parameter, unit, None, points), picture_file)
    if as_json:
        print_json(
            {
                name: {
                    **{"parameter": curve.parameter, "unit": curve.unit, "along": curve.along},
                    **{"value": curve.sites.value, "std": curve.sites.value * curve.sites.std, "lumps": curve.lumps},
                    "lags": curve.lags,
                    "against_points": _distance(curve, points) if points is not None else None,
                }
                for name, curve in curves.items()
            }
        )
        return
    console().print(_table(curves, points, unit))
    typer.echo(f"picture: {picture_file}")


def _table(curves: Mapping[str, TrackCurve], points: tuple[Any, Sites] | None, unit: str) -> Any:
    """Return the table of tracks: their lumps, and the distance from the point palpations [unit]."""
    from palpate_engine import display_unit
    from rich.table import Table

    unit_name, factor = display_unit(unit)  # the unit that is shown, and its number per SI unit
    table = Table(title="along the sweep", title_justify="left")
    table.add_column("track")
    table.add_column("lumps: place (contrast)")
    if points is not None:
        table.add_column(f"against points\nRMS {unit_name}", justify="right")
    for name, curve in curves.items():
        lump_texts = [f"{1e3 * lump.along:.1f} mm ({100 * lump.contrast:.0f} %)" for lump in curve.lumps]
        doubt = "; doubtful: it does not follow the changes" if curve.lags else ""
        row = [name, (", ".join(lump_texts) or "none") + doubt]
        if points is not None:
            row.append(f"{factor * _distance(curve, points):.3g}")
        table.add_row(*row)
    return table


def _distance(curve: TrackCurve, points: tuple[Any, Sites]) -> float:
    """Return the root mean square difference [SI] of a curve from points on it; NaN without any."""
    import numpy as np

    moving = ~curve.sites.standing
    order = np.argsort(curve.along[moving])
    coordinate, value = curve.along[moving][order], curve.sites.value[moving][order]
    is_on_curve = (points[0] >= coordinate[0]) & (points[0] <= coordinate[-1])
    if not is_on_curve.any():
        return float("nan")
    difference = np.interp(points[0][is_on_curve], coordinate, value) - points[1].value[is_on_curve]
    return float(np.sqrt(np.mean(difference**2)))


def drop_rejected(runs: list[Path]) -> list[Path]:
    """Return the runs that no review has rejected, continuations included; print the rejected ones."""
    from palpate_maps import map_analysis as maps

    reason_by_run: dict[Path, str] = {}
    for run in runs:
        reason_by_run |= maps.rejected_runs(run)
    for path, reason in reason_by_run.items():
        typer.echo(f"{path} was rejected and is left out: {reason}", err=True)
    return [run for run in runs if run not in reason_by_run]


def unit_of(run: Path, track: str, parameter: str) -> str:
    """Return the SI unit of a track's parameter; empty if the pipeline cannot be read or has no such parameter."""
    from palpate_kit.runs.continuation import recorded_pipeline

    with suppress(PalpateError):
        model = recorded_pipeline(run).models.get(TrackName.parse(track).model)
        for candidate in model.parameters if model else ():
            if candidate.name == parameter:
                return candidate.unit
    return ""
