"""Curves along a sweep, of several tracks or runs, beside point palpations: one picture and one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.errors import LogError, PalpateError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from palpate.maps import Lump, Sites

Points = Annotated[
    Path | None,
    typer.Option(
        help="Point palpations on the same line, to hold the sweep against: a run, or a pipeline file to run."
    ),
]


@dataclass(frozen=True)
class Curve:
    """What one track says along a sweep."""

    parameter: str
    unit: str
    along: NDArray[np.float64]  # (n,) [m]
    sites: Sites
    lumps: tuple[Lump, ...]


def curves_of(
    run: Path, tracks: Sequence[str] | None = None, parameter: str | None = None, prefix: str = ""
) -> dict[str, Curve]:
    """The curve of each track of a run that has estimates along a line, by the track's name after a prefix."""
    from palpate import maps

    curves = {}
    for name in tracks or maps.tracks_of(run):
        with suppress(LogError):  # a track that found nothing is not drawn
            path = maps.read_path(run, name, parameter)
            sites = maps.sites_along(path)
            along = maps.line_coordinate(sites)
            if along is not None and not sites.standing.all():
                lumps: tuple[Lump, ...] = ()
                with suppress(LogError):  # too short for lumps
                    lumps = maps.find_lumps(sites).lumps
                curves[prefix + name] = Curve(path.parameter, unit_of(run, name, path.parameter), along, sites, lumps)
    return curves


def points_of(points: Path, folder: Path, parameter: str | None = None) -> tuple[Any, Sites]:
    """Coordinate and sites of point palpations; a pipeline file is run first, into ``points`` in a folder.

    Raises LogError where they are on no line.
    """
    from palpate import maps

    run = points
    if points.suffix == ".toml":
        from palpate.config import load_pipeline
        from palpate.pipeline import run_pipeline

        run = folder / "points"
        if not (run / "result.json").is_file():
            run_pipeline(load_pipeline(points), run)
    sites = maps.sites_along(maps.read_path(run, None, parameter))
    sites = sites[sites.standing]
    along = maps.line_coordinate(sites) if len(sites) > 1 else None
    if along is None:
        raise LogError(f"{run}: holds no point palpations on a line")
    return along, sites


def tell_runs(runs: Mapping[str, Path], folder: Path, points: Path | None, needed: bool = True) -> None:
    """Draw the curves of all runs, by their labels, as ``sweep.png`` in a folder, and print their table.

    Where there are none it raises LogError, or does nothing if they are not needed.
    """
    curves: dict[str, Curve] = {}
    for label, run in runs.items():
        found = curves_of(run)
        for name, curve in found.items():
            known = [part for part in (name if len(found) > 1 or not label else "", label) if part]
            curves[", ".join(known)] = curve
    if curves:
        first = next(iter(curves.values()))
        tell_curves(curves, points_of(points, folder) if points else None, first.unit, folder / "sweep.png")
    elif needed:
        raise LogError(f"{folder}: holds no sweep along a line")


def tell_curves(curves: Mapping[str, Curve], points: tuple[Any, Sites] | None, unit: str, picture_file: Path) -> None:
    """Draw the curves and print their table."""
    from rich.console import Console

    from palpate.maps import picture

    parameter = next(iter(curves.values())).parameter
    series = {name: (curve.along, curve.sites) for name, curve in curves.items()}
    picture.save(picture.sweep_picture(series, parameter, unit, None, points), picture_file)
    console = Console()
    console = console if console.is_terminal else Console(width=120)
    console.print(_table(curves, points, unit))
    typer.echo(f"picture: {picture_file}")


def _table(curves: Mapping[str, Curve], points: tuple[Any, Sites] | None, unit: str) -> Any:
    from rich.table import Table

    from palpate.units import people

    word, factor = people(unit)
    table = Table(title="along the sweep", title_justify="left")
    table.add_column("track")
    table.add_column("lumps: place (contrast)")
    if points is not None:
        table.add_column(f"against points\nRMS {word}", justify="right")
    for name, curve in curves.items():
        found = [f"{1e3 * lump.along:.1f} mm ({100 * lump.contrast:.0f} %)" for lump in curve.lumps]
        row = [name, ", ".join(found) or "none"]
        if points is not None:
            row.append(f"{factor * _distance(curve, points):.3g}")
        table.add_row(*row)
    return table


def _distance(curve: Curve, points: tuple[Any, Sites]) -> float:
    """Root mean square difference [SI] of a curve from points on it; NaN where none is."""
    import numpy as np

    moving = ~curve.sites.standing
    order = np.argsort(curve.along[moving])
    at, value = curve.along[moving][order], curve.sites.value[moving][order]
    on = (points[0] >= at[0]) & (points[0] <= at[-1])
    if not on.any():
        return float("nan")
    apart = np.interp(points[0][on], at, value) - points[1].value[on]
    return float(np.sqrt(np.mean(apart**2)))


def unit_of(run: Path, track: str, parameter: str) -> str:
    """SI unit of a track's parameter, or nothing where the run's pipeline cannot be read again."""
    from palpate.pipeline import recorded_pipeline

    with suppress(PalpateError):
        model = recorded_pipeline(run).models.get(track.partition("/")[0])
        for known in model.parameters if model else ():
            if known.name == parameter:
                return known.unit
    return ""
