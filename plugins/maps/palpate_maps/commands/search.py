"""``palpate search``: where to look next, and going there."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError
from palpate.host import TrackOption

from palpate_maps.commands.map import Parameter, Run

if TYPE_CHECKING:
    from palpate_maps.analysis import Proposal

_ROUNDS = 20


def search(
    run: Run,
    track: TrackOption = None,
    parameter: Parameter = None,
    points: Annotated[int, typer.Option(help="Places in one round.", min=1)] = 5,
    aim: Annotated[str, typer.Option(help="suspicion or uncertainty.")] = "suspicion",
    contrast: Annotated[float, typer.Option(help="Contrast that counts as a lump.")] = 0.05,
    go: Annotated[bool, typer.Option("--go", help="Visit the places, and go on until a stop rule holds.")] = False,
    budget: Annotated[float, typer.Option(help="Seconds of motion after which --go stops.")] = 120.0,
    sure: Annotated[
        float, typer.Option(help="--go stops once a lump checked by points has a smaller p-value and stays in place.")
    ] = 0.001,
    palpation: Annotated[float, typer.Option(help="Seconds of sine at each place.")] = 2.0,
) -> None:
    """Propose the next places to palpate after a coarse sweep or raster; with --go, visit them."""
    from palpate_maps import analysis as maps

    if aim not in ("suspicion", "uncertainty"):
        raise ConfigurationError(f'--aim: {aim!r} is none of "suspicion" and "uncertainty"')
    spent, before = 0.0, None
    for _ in range(_ROUNDS):
        sites = maps.sites_along(maps.read_path(run, track, parameter))
        places = maps.propose(sites, points, aim, contrast)  # type: ignore[arg-type]
        _show(places)
        if not go or not places:
            return
        spent += visit(run, [place.place for place in places], palpation)
        found = maps.find_lumps(maps.sites_along(maps.read_path(run, track, parameter)))
        best = maps.surest(found)
        told = "none is checked" if best is None else f"the surest checked one has p = {best.p:.2g}"
        typer.echo(f"after {spent:.0f} s of visits: {len(found.lumps)} lumps; {told}")
        if best is not None and maps.settled(before, best, sure):
            x, y = (1e3 * value for value in best.place)
            typer.echo(f"stopped: the lump at {x:.1f} mm, {y:.1f} mm is significant at {sure:g} and stays in place")
            return
        before = best
        if spent >= budget:
            typer.echo(f"stopped: {budget:g} s of motion are spent")
            return


def visit(run: Path, places: list[tuple[float, float]], duration: float) -> float:
    """Palpate places with the rig and the press of a run, as a part of it; how long the motion takes [s]."""
    from palpate.host import RunFolder, continued, recorded_pipeline, run_pipeline

    folder = RunFolder(run)

    pipeline = recorded_pipeline(run)
    if len(pipeline.trajectories) != 1:
        raise ConfigurationError(f"{run}: moves nothing, so it cannot go anywhere")
    ((name, before),) = pipeline.trajectories.items()
    known: dict[str, Any] = {key: getattr(before, key) for key in ("press", "surface") if hasattr(before, key)}
    if "press" not in known:
        raise ConfigurationError(f"{run}: [trajectory.{name}] has no press = {{...}} to palpate points with")
    part: Any = pipeline.registry.find("trajectory", "grid-points")
    try:
        motion = part(places=tuple(places), duration=duration, **known)
    except ValueError as error:
        raise ConfigurationError(f"{run}: the places cannot be visited: {error}") from error
    result = run_pipeline(continued(pipeline, motion, len(folder.parts)), folder.next_part)
    result.demand_whole()
    return float(motion.total_duration)


def _show(places: list[Proposal]) -> None:
    typer.echo("    x mm    y mm   expected contrast %   suspicion")
    for place in places:
        expected = f"{100 * place.contrast:.1f} ± {100 * place.std:.1f}"
        typer.echo(f"{1e3 * place.place[0]:8.1f}{1e3 * place.place[1]:8.1f}{expected:>22}{place.suspicion:12.3f}")
