"""``palpate map search``: where to look next, and going there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import JsonOption, TrackOption
from palpate_kit.terminal.progress import progress, report_progress

from palpate_maps.commands.map_command import Parameter, Run, length

if TYPE_CHECKING:
    from palpate.host import Pipeline

    from palpate_maps.map_analysis import Area, LumpProgress, Proposal
    from palpate_maps.search_area import Box

_APART = 4e-3  # [m] between places
_ROUNDS = 50


def search(
    run: Run,
    track: TrackOption = None,
    parameter: Parameter = None,
    points: Annotated[int, typer.Option(help="Places in one round.", min=1)] = 3,
    aim: Annotated[str, typer.Option(help="suspicion or uncertainty.")] = "suspicion",
    contrast: Annotated[float, typer.Option(help="Contrast that counts as a lump.")] = 0.05,
    area: Annotated[
        str | None,
        typer.Option(help='Area to search: "-30 mm, 30 mm, -20 mm, 20 mm" (x, then y). [default: specimen, workspace]'),
    ] = None,
    go: Annotated[bool, typer.Option("--go", help="Visit the places, and continue until a stop rule is met.")] = False,
    budget: Annotated[float, typer.Option(help="Seconds of motion after which --go stops.")] = 120.0,
    sure: Annotated[
        float, typer.Option(help="A lump is certain once points on it have a smaller p-value and leave it in place.")
    ] = 0.001,
    palpation: Annotated[float, typer.Option(help="Seconds of sine at each place.")] = 2.0,
    as_json: JsonOption = False,
) -> None:
    """Propose the next places to palpate after a coarse sweep or raster; with --go, visit them.

    With --go it ends once every lump is certain and no other place is suspicious, or the budget is spent.
    """
    from palpate_kit.runs.continuation import recorded_pipeline

    from palpate_maps import map_analysis as maps

    if aim not in ("suspicion", "uncertainty"):
        raise ConfigurationError(f'--aim: {aim!r} is not one of "suspicion" and "uncertainty"')
    pipeline = recorded_pipeline(run)
    motion = _press(pipeline, run)
    sites = maps.sites_along(maps.read_path(run, track, parameter))
    allowed = maps.area_of(pipeline, motion, sites.place, box_of(area))
    found = _SearchRounds()

    def proposed() -> list[Proposal]:
        done = maps.off_limits(allowed.nodes, found.lumps, contrast, _APART)
        return maps.propose(sites, points, aim, contrast, allowed.nodes, taken=done)  # type: ignore[arg-type]

    with print_aside(as_json):
        places = proposed()
        while not (go and maps.search_ended(found.lumps, places)):
            found.rounds.append(places)
            _show(places)
            found.stopped = found.over(budget) if go else None
            if not go or found.stopped is not None:
                break
            found.motion += visit(run, [place.place for place in places], palpation)
            sites = maps.sites_along(maps.read_path(run, track, parameter))
            found.lumps = maps.update_progress(maps.find_lumps(sites), found.lumps, sites, allowed, sure)
            _report(found.lumps, found.motion)
            places = proposed()
        else:
            found.stopped = f"every lump is certain at {sure:g}, and nothing else is suspicious"
        if found.stopped is not None:
            _end(found.lumps, allowed, found.stopped)
    if as_json:
        print_json(vars(found))


@dataclass
class _SearchRounds:
    """What a search has done and found so far."""

    rounds: list[list[Proposal]] = field(default_factory=list)  # of places
    motion: float = 0.0  # [s] of visits
    stopped: str | None = None  # why, where --go has come to an end
    lumps: list[LumpProgress] = field(default_factory=list)

    def over(self, budget: float) -> str | None:
        """Why no place of the latest round is visited; None where one is."""
        if not self.rounds[-1]:
            return "every place that may be visited is known"
        if self.motion >= budget:
            return f"{budget:g} s of motion are spent"
        return f"{_ROUNDS} rounds are made" if len(self.rounds) > _ROUNDS else None


def box_of(text: str | None) -> Box | None:
    """The box (x0, x1, y0, y1) [m] that a text of four lengths names; raises ConfigurationError."""
    if text is None:
        return None
    words = [word.strip() for word in text.split(",")]
    if len(words) != 4:
        raise ConfigurationError(f'--area: {text!r} are {len(words)} lengths; write four, "x from, x to, y from, y to"')
    x0, x1, y0, y1 = (length(word, "--area") for word in words)
    return x0, x1, y0, y1


def _report(lumps: Sequence[LumpProgress], spent: float) -> None:
    certain = sum(item.certain for item in lumps)
    typer.echo(f"after {spent:.0f} s of visits: {len(lumps)} lumps, {certain} of them certain")
    for item in lumps:
        if item.beyond:
            typer.echo(f"  {_where(item)} is stiffest at the border of what was palpated: it continues beyond")


def _end(lumps: Sequence[LumpProgress], area: Area, why: str) -> None:
    typer.echo(f"stopped: {why}")
    for item in lumps:
        words = "certain" if item.certain else "not certain"
        if item.beyond:
            words += "; stiffest at the border of what was palpated, so its middle may lie beyond"
        elif item.cut:
            words += f"; it reaches the border of {area.bounded_by}, so its middle may lie beyond"
        typer.echo(f"  {_where(item)}: p = {item.lump.p:.2g}, {words}")
    if not lumps:
        typer.echo("  no lump was found")


def _where(item: LumpProgress) -> str:
    x, y = (1e3 * value for value in item.lump.place)
    return f"the lump at {x:.1f} mm, {y:.1f} mm"


def _press(pipeline: Pipeline, run: Path) -> Any:
    """The motion of a run, with a press to palpate points with; raises ConfigurationError."""
    if len(pipeline.trajectories) != 1:
        raise ConfigurationError(f"{run}: moves nothing, so it cannot visit places")
    ((name, motion),) = pipeline.trajectories.items()
    if not hasattr(motion, "press") or not hasattr(motion, "surface"):
        raise ConfigurationError(f"{run}: [trajectory.{name}] has no press = {{...}} to palpate points with")
    return motion


def visit(run: Path, places: list[tuple[float, float]], duration: float) -> float:
    """Palpate places with the rig and the press of a run, as a part of it; how long the motion takes [s]."""
    from palpate.host import run_pipeline
    from palpate_kit.runs.continuation import continue_pipeline, recorded_pipeline
    from palpate_kit.runs.run_folder import RunFolder

    folder = RunFolder(run)
    pipeline = recorded_pipeline(run)
    before = _press(pipeline, run)
    part: Any = pipeline.registry.find("trajectory", "grid-points")
    try:
        motion = part(places=tuple(places), duration=duration, press=before.press, surface=before.surface)
    except ValueError as error:
        raise ConfigurationError(f"{run}: the places cannot be visited: {error}") from error
    with progress(f"visit of {len(places)} places", "s"):
        result = run_pipeline(continue_pipeline(pipeline, motion, len(folder.parts)), folder.next_part, report_progress)
    result.demand_whole()
    return float(motion.total_duration)


def _show(places: list[Proposal]) -> None:
    typer.echo("    x mm    y mm   expected contrast %   suspicion")
    for place in places:
        expected = f"{100 * place.contrast:.1f} ± {100 * place.std:.1f}"
        typer.echo(f"{1e3 * place.place[0]:8.1f}{1e3 * place.place[1]:8.1f}{expected:>22}{place.suspicion:12.3f}")
