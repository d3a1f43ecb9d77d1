"""``palpate map search``: where to look next, and going there."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer
from palpate import ConfigurationError, duration_of
from palpate_kit.figures import save_figure
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import JsonOption, TrackOption, UnchangedOption
from palpate_kit.terminal.progress import progress, report_progress

from palpate_maps.commands.lumps_command import exclusion_lines
from palpate_maps.commands.map_command import Parameter, Run, length

if TYPE_CHECKING:
    from palpate_maps.area_search import AreaSearch, SearchSettings
    from palpate_maps.map_analysis import Findings, LumpProgress, Proposal
    from palpate_maps.search_area import Box
    from palpate_maps.search_motion import SearchMotion

_MAX_ROUNDS = 50  # after which --go stops in any case: a choice


def search(
    run: Run,
    track: TrackOption = None,
    parameter: Parameter = None,
    # A choice: more in a round save fits, fewer learn sooner from what was palpated.
    points: Annotated[int, typer.Option(help="Places in one round.", min=1)] = 3,
    aim: Annotated[str, typer.Option(help="find lumps, outline them at --contrast, or map the whole area.")] = "find",
    # Choices: the least patch is 5 % stiffer than its surroundings, and as wide as the contact of a usual tip.
    contrast: Annotated[float, typer.Option(help="Contrast that counts as a lump.")] = 0.05,
    radius: Annotated[str, typer.Option(help="Radius, at half its height, of the least patch for --risk.")] = "5 mm",
    risk: Annotated[
        float | None,
        typer.Option(help="Search on until a patch remains with at most this probability, such as 0.05."),
    ] = None,
    area: Annotated[
        str | None,
        typer.Option(help='Area to search: "-30 mm, 30 mm, -20 mm, 20 mm" (x, then y). [default: specimen, workspace]'),
    ] = None,
    go: Annotated[bool, typer.Option("--go", help="Visit the places, and continue until a stop rule is met.")] = False,
    # A choice: how long the rig moves before a person is asked again.
    budget: Annotated[float, typer.Option(help="Seconds of motion after which --go stops.")] = 120.0,
    # A choice: of 1000 places without a lump one would look certain.
    sure: Annotated[
        float, typer.Option(help="A lump is certain once points on it have a smaller p-value and leave it in place.")
    ] = 0.001,
    # A choice: four periods of a sine of 2 Hz.
    palpation: Annotated[float, typer.Option(help="Seconds of sine at each place.")] = 2.0,
    yes: UnchangedOption = False,
    as_json: JsonOption = False,
) -> None:
    """Propose the next places to palpate after a coarse sweep or raster; with --go, visit them.

    With --go it ends once every lump is certain, no other place is suspicious, and no patch remains with more than the
    risk, where one is given; or when the budget is spent. It prints how likely a patch remains, and draws where.
    """
    from palpate_kit.runs.continuation import demand_unchanged

    from palpate_maps.area_search import SearchSettings
    from palpate_maps.next_places import Aim

    if aim not in get_args(Aim):
        raise ConfigurationError(f"--aim: {aim!r} is not one of {', '.join(get_args(Aim))}")
    _demand_positive({"--budget": budget, "--palpation": palpation})
    settings = SearchSettings(
        aim=aim,  # type: ignore[arg-type]
        points=points,
        contrast=contrast,
        radius=length(radius, "--radius"),
        risk=risk,
        sure=sure,
    )
    with print_aside(as_json):
        search_rounds = _begin(run, track, parameter, settings, box=box_of(area), palpation=palpation)
        if go:
            demand_unchanged(search_rounds.state.motion.pipeline, yes)
            search_rounds.visit_all(budget)
        else:
            _show(search_rounds.propose())
        _tell_hiding(search_rounds.state, run, search_rounds.findings())
    if search_rounds.state.warning:
        typer.echo(f"warning: {search_rounds.state.warning}", err=True)
    if as_json:
        print_json(search_rounds.document)


def _demand_positive(seconds: dict[str, float]) -> None:
    """Raise ConfigurationError for an option that is not a time above 0."""
    for option, value in seconds.items():
        if not 0 < value < math.inf:
            raise ConfigurationError(f"{option}: {value:g} s is not a time above 0")


@dataclass
class _SearchRounds:
    """A search of a run, and what it has done so far."""

    run: Path
    track: str | None
    parameter: str | None
    state: AreaSearch
    rounds: list[list[Proposal]] = field(default_factory=list)  # of places
    motion: float = 0.0  # [s] of visits
    stopped: str | None = None  # why, where it visited places

    def propose(self) -> list[Proposal]:
        """Return the places of the next round."""
        self.rounds.append(self.state.next_round())
        return self.rounds[-1]

    def visit_all(self, budget: float) -> None:
        """Visit places until the search ends, or a budget of motion [s] is spent."""
        from palpate_maps import map_analysis as maps

        while (ended := self.state.ended()) is None:
            _show(places := self.propose())
            if (ended := self._why_not(budget)) is not None:
                break
            self.motion += visit(self.run, self.state.motion, places)
            sites = maps.sites_along(maps.read_path(self.run, self.track, self.parameter))
            self.state.observe(sites, visited=True)
            _report(self.state, self.motion)
        self.stopped = ended
        _end(self.state, ended)

    def _why_not(self, budget: float) -> str | None:
        """Return the reason that no place of the latest round is visited; None where one is."""
        if not self.rounds[-1]:
            return "every place that may be visited is known"
        if self.motion >= budget:
            return f"{budget:g} s of motion are spent"
        return f"{_MAX_ROUNDS} rounds are made" if len(self.rounds) > _MAX_ROUNDS else None

    def findings(self) -> Findings | None:
        """Write the lumps with what is excluded in the area, and return them; None where all sites are on one line."""
        from palpate_maps import map_analysis as maps, map_files

        path, area = maps.read_path(self.run, self.track, self.parameter), self.state.area
        sites = maps.sites_along(path)
        if maps.line_coordinate(sites) is not None or len(sites) < maps.MIN_SITES:
            return None
        sites = replace(sites, place=area.lift(sites.place))
        findings = maps.lumps_of_run(self.run, path, sites, None, area.places)
        map_files.replace_file(RunFolder(self.run).maps / "lumps.json", map_files.lumps_json(findings, path))
        return findings

    @property
    def document(self) -> dict[str, Any]:
        """For --json: what was done, what is known in the end, and the least patch that --risk is of."""
        state, patch = self.state, self.state.settings.patch
        return {
            "rounds": self.rounds,
            "motion": self.motion,
            "stopped": self.stopped,
            "lumps": state.lumps,
            "patches": state.patches,
            "risk": state.hiding.risk if state.hiding is not None else None,
            "patch": {"radius": patch.radius, "contrast": patch.contrast},
        }


def _begin(
    run: Path,
    track: str | None,
    parameter: str | None,
    settings: SearchSettings,
    box: Box | None,
    palpation: float,
) -> _SearchRounds:
    """Return a search that knows what a run palpated and moves as its motion does; raises ConfigurationError.

    `palpation` [s] is the time of sine at a place; `box` the area to search, None for the specimen or the workspace.
    """
    from palpate_kit.runs.continuation import recorded_pipeline

    from palpate_maps import map_analysis as maps
    from palpate_maps.area_search import AreaSearch
    from palpate_maps.search_motion import search_motion

    motion = search_motion(recorded_pipeline(run), run, palpation)
    sites = maps.sites_along(maps.read_path(run, track, parameter))
    state = AreaSearch(maps.area_of(motion.pipeline, motion.own, sites.place, box), motion, settings)
    state.observe(sites, visited=False)
    return _SearchRounds(run, track, parameter, state)


def box_of(text: str | None) -> Box | None:
    """Return the box (x0, x1, y0, y1) [m] that a text of four lengths names; raises ConfigurationError."""
    if text is None:
        return None
    ends = [end.strip() for end in text.split(",")]
    if len(ends) != 4:
        raise ConfigurationError(f'--area: {text!r} are {len(ends)} lengths; write four, "x from, x to, y from, y to"')
    x0, x1, y0, y1 = (length(end, "--area") for end in ends)
    return x0, x1, y0, y1


def _report(state: AreaSearch, spent: float) -> None:
    """Print the lumps so far, after a time [s] of visits, and those that go on beyond the area."""
    certain = sum(item.certain for item in state.lumps)
    remains = ""
    if state.settings.risk is not None and state.hiding is not None:
        remains = f"; a patch remains with {state.hiding.risk_text}"
    typer.echo(f"after {spent:.0f} s of visits: {len(state.lumps)} lumps, {certain} of them certain{remains}")
    for item in state.lumps:
        if item.beyond:
            typer.echo(f"  {_where(item)} is stiffest at the border of what was palpated: it continues beyond")


def _end(state: AreaSearch, why: str) -> None:
    """Print the reason of a search's end, its lumps, and the patches that may be lumps."""
    typer.echo(f"stopped: {why}")
    for item in state.lumps:
        properties = "certain" if item.certain else "not certain"
        if item.beyond:
            properties += "; stiffest at the border of what was palpated, so its middle may lie beyond"
        elif item.cut:
            properties += f"; it reaches the border of {state.area.bounded_by}, so its middle may lie beyond"
        properties += "; long enough to be two" if item.lump.may_be_two else ""
        typer.echo(f"  {_where(item)}: p = {item.lump.p:.2g}, {properties}")
    for x, y in state.patches:
        typer.echo(f"  a patch about {1e3 * x:.1f} mm, {1e3 * y:.1f} mm is likely, but not significant as a lump")
    if not state.lumps and not state.patches:
        typer.echo("  no lump was found")


def _tell_hiding(state: AreaSearch, run: Path, findings: Findings | None) -> None:
    """Print what may remain and what is excluded, and draw the map of where; `findings` are None on one line."""
    from palpate_maps import map_files
    from palpate_maps.hidden_patches import EXPECTED
    from palpate_maps.map_figures import hiding_picture

    # The expected number of patches by place, the least patch that counts, and the folder of the run's maps.
    hiding, patch, folder = state.hiding, state.settings.patch, RunFolder(run).maps
    assert hiding is not None
    map_files.replace_file(folder / "hidden.csv", map_files.hiding_csv(hiding))
    excluded = map_files.exclusion_table(findings) if findings is not None else []
    picture = hiding_picture(hiding, state.cells, [item.lump for item in state.lumps], excluded)
    save_figure(picture, folder / "hidden.png")
    least_patch = f"of radius {1e3 * patch.radius:.3g} mm, {100 * patch.contrast:.3g} % stiffer than its surroundings"
    besides = "besides these" if state.lumps or state.patches else "in the area"
    typer.echo(
        f"a patch {least_patch}, or more, remains {besides} with a probability of {hiding.risk_text}, if {EXPECTED:g} "
        f"such patches were expected beforehand; where: {folder / 'hidden.png'}"
    )
    if state.area.share < 1:
        typer.echo(f"  {100 * (1 - state.area.share):.2g} % of {state.area.bounded_by} cannot be visited; not included")
    lines = exclusion_lines(findings) if findings is not None else ["nothing is excluded: the sites are on one line"]
    for line in lines:
        typer.echo(line)


def _where(item: LumpProgress) -> str:
    x, y = (1e3 * value for value in item.lump.place)
    return f"the lump at {x:.1f} mm, {y:.1f} mm"


def visit(run: Path, motion: SearchMotion, places: list[Proposal]) -> float:
    """Palpate places, or a line, as a part of a run; how long the motion takes [s]."""
    from palpate_engine import run_pipeline
    from palpate_kit.runs.continuation import continue_pipeline

    folder = RunFolder(run)
    trajectory = motion.along(places)
    goal = f"{len(places)} places" if places[0].end is None else "a line"
    with progress(f"visit of {goal}", "s"):
        part = continue_pipeline(motion.pipeline, trajectory, len(folder.parts))
        result = run_pipeline(part, folder.next_part, report_progress)
    result.demand_whole()
    return duration_of(trajectory)


def _show(places: list[Proposal]) -> None:
    typer.echo("    x mm    y mm   expected contrast %   suspicion")
    for place in places:
        expected = f"{100 * place.contrast:.1f} ± {100 * place.std:.1f}"
        line = "" if place.end is None else "   line to {:.1f}, {:.1f}".format(*(1e3 * value for value in place.end))
        x, y = (1e3 * value for value in place.place)
        typer.echo(f"{x:8.1f}{y:8.1f}{expected:>22}{place.suspicion:12.3f}{line}")
