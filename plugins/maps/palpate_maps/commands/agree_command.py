"""``palpate map agree``: whether repeated lines or rasters are of the same body."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError, LogError
from palpate_kit.curves.fit_folder import is_fit_folder
from palpate_kit.figures import save_figure
from palpate_kit.numerics.group_comparison import holm
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption, TrackOption
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.table import Table, console

from palpate_maps.commands.curves_command import drop_rejected, unit_of
from palpate_maps.commands.map_command import Parameter

if TYPE_CHECKING:
    from palpate_maps.map_agreement import MapAgreement
    from palpate_maps.rig_share import RigShare
    from palpate_maps.sites import Sites


@dataclass(frozen=True)
class RunMap:
    """The sites of a run, and the uncertainties that all of them have in common."""

    name: str
    folder: Path
    parameter: str
    sites: Sites
    common: RigShare


@dataclass(frozen=True)
class RunPair:
    """Two runs, and how they agree."""

    first: str
    second: str
    agreement: MapAgreement
    differing_facts: str  # of the rig, in words; empty where both share all
    p: float  # that they are the same, corrected for the number of pairs by Holm's method

    @property
    def name(self) -> str:
        """The runs, the second less the first."""
        return f"{self.second} - {self.first}"


def agree(
    runs: Annotated[list[Path], typer.Argument(help="Run folders of lines or rasters over one body, two or more.")],
    track: TrackOption = None,
    parameter: Parameter = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="The picture to draw: .png or .svg.")] = Path("agree.png"),
    as_json: JsonOption = False,
) -> None:
    """Compare repeated lines or rasters place by place: E_n, and the probability that they are of the same body.

    E_n is by the repeatability alone where two runs share the facts of the rig, and otherwise by all uncertainty. What
    the runs do not both cover is left out.
    """
    from palpate_maps.agreement_figure import agreement_picture

    _demand_runs(runs)
    with progress("agreement of maps"):
        chosen = _common_track(runs, track)
        maps = [_run_map(run, name, chosen, parameter) for run, name in zip(runs, _names(runs), strict=True)]
        pairs = _pairs(maps)
    name = maps[0].parameter
    unit = unit_of(runs[0], chosen, name)
    series = {run_map.name: run_map.sites for run_map in maps}
    save_figure(agreement_picture(series, {pair.name: pair.agreement for pair in pairs}, name, unit), out)
    if as_json:
        print_json({"track": chosen, "parameter": name, "pairs": [_document(pair) for pair in pairs]})
        return
    console().print(_table(pairs).view(), highlight=False)
    typer.echo("\n".join([*_sentences(pairs, maps), f"picture: {out}"]))


def _demand_runs(runs: list[Path]) -> None:
    """Raise ConfigurationError for fewer than two runs, one that is given twice, or a folder of fits."""
    if len(runs) < 2:
        raise ConfigurationError("two runs or more are needed to compare them")
    if len({run.resolve() for run in runs}) < len(runs):
        raise ConfigurationError("a run is given twice: it always agrees with itself")
    for run in runs:
        if is_fit_folder(run):
            raise ConfigurationError(f"{run}: is a folder of fits; `palpate repeat` compares those")
    if len(drop_rejected(runs)) < len(runs):
        raise ConfigurationError("a rejected run is not compared")


def _names(runs: list[Path]) -> list[str]:
    """Return the names of the folders; their paths where two are alike."""
    names = [run.resolve().name for run in runs]
    return names if len(set(names)) == len(names) else [str(run) for run in runs]


def _common_track(runs: list[Path], track: str | None) -> str:
    """Return the stated track, else the best of the first run that all have; raises LogError without one."""
    from palpate_maps import map_analysis as maps

    if track is not None:
        return track
    tracks = [maps.tracks_of(run) for run in runs]
    for name in tracks[0]:
        if all(name in names for names in tracks):
            return name
    raise LogError(f"{', '.join(map(str, runs))}: have no track in common; --track chooses one of those of each")


def _run_map(run: Path, name: str, track: str, parameter: str | None) -> RunMap:
    """Return the sites of a run: those of a raster over a surface on that surface."""
    from palpate_maps import map_analysis as maps
    from palpate_maps.rig_share import rig_share

    path = maps.read_path(run, track, parameter)
    sites, skin = maps.sites_along(path), maps.surface_of_run(run, None)
    if skin is not None and (sites.standing.all() or maps.line_coordinate(sites) is None):
        sites = maps.sites_on(sites, skin)
    return RunMap(
        name=name, folder=run, parameter=path.parameter, sites=sites, common=rig_share(run, track, path.parameter)
    )


def _pairs(maps: list[RunMap]) -> list[RunPair]:
    """Return the agreement of every two runs, with p-values that are corrected for their number.

    Raises ConfigurationError for a map on a surface and one in a plane.
    """
    from palpate_maps.map_agreement import map_agreement
    from palpate_maps.rig_share import fact_differences

    # Places of a plane have two coordinates, those of a surface three.
    on_surface = [run_map.folder for run_map in maps if run_map.sites.place.shape[1] == 3]
    in_plane = [run_map.folder for run_map in maps if run_map.folder not in on_surface]
    if on_surface and in_plane:
        raise ConfigurationError(f"{on_surface[0]} lies on a surface and {in_plane[0]} in a plane: they share no place")

    pairs = []
    for first, second in combinations(maps, 2):
        differing_facts = fact_differences(first.folder, second.folder)
        # Relative standard uncertainties that all places of a run share: each run has another error of its tare; those
        # of rig and law are the same errors in both runs, and count only where the facts differ.
        common_stds = [first.common.run, second.common.run]
        if differing_facts:
            common_stds += [first.common.rig, second.common.rig]
        agreement = map_agreement(first.sites, second.sites, math.hypot(*common_stds))
        pairs.append(
            RunPair(
                first=first.name,
                second=second.name,
                agreement=agreement,
                differing_facts=differing_facts,
                p=agreement.p,
            )
        )
    corrected = holm([pair.p for pair in pairs])
    return [replace(pair, p=p) for pair, p in zip(pairs, corrected, strict=True)]


def _table(pairs: list[RunPair]) -> Table:
    """Return one row for each pair of runs."""
    import numpy as np

    rows = []
    for pair in pairs:
        agreement = pair.agreement
        # The mean difference d is of logarithms: exp(d) - 1 is relative, as the standard deviation of d is.
        mean_difference, relative_std = agreement.level
        e_n = np.abs(agreement.e_n)
        rows.append(
            (
                pair.name,
                str(len(e_n)),
                " / ".join(f"{100 * share:.0f}" for share in agreement.shares),
                f"{100 * math.expm1(mean_difference):+.2f} ± {100 * relative_std:.2f}",
                f"{e_n.max():.2f}",
                f"{100 * np.mean(e_n > 1):.0f}",
                _p_text(pair),
            )
        )
    headings = ("runs", "places", "covered\n%", "difference\n%", "|E_n|\nlargest", "above 1\n%", "p of\nthe same")
    return Table.of("agreement of maps", headings, rows, ("runs",))


def _p_text(pair: RunPair) -> str:
    """Return the p-value, or the least that can be determined."""
    return f"< {pair.p:.1g}" if pair.agreement.p <= pair.agreement.least_p else f"{pair.p:.2g}"


def _sentences(pairs: list[RunPair], maps: list[RunMap]) -> list[str]:
    """Return a line for each pair, and one for the uncertainty that all places of a run share.

    A pair's line has its largest E_n, the place, the kind of uncertainty in it, and how well a place repeats.
    """
    lines = []
    for pair in pairs:
        # The place of the largest E_n, and the scatter of one map: that of a difference over sqrt(2).
        agreement = pair.agreement
        row = int(abs(agreement.e_n).argmax())
        place = ", ".join(f"{1e3 * coordinate:.1f}" for coordinate in agreement.place[row])
        scatter = 100 * float((agreement.std**2).mean() / 2) ** 0.5
        means = "all uncertainty" if pair.differing_facts else "repeatability alone"
        lines.append(
            f"{pair.name}: largest E_n {agreement.e_n[row]:+.2f} at ({place}) mm, by {means}; a place repeats within "
            f"{scatter:.2g} %, {agreement.repeatability:.2g} of what the estimators state"
        )
        if pair.differing_facts:
            lines.append(f"  the facts of the rig differ: {pair.differing_facts}")
    return [*lines, *filter(None, (run_map.common.sentence(run_map.name) for run_map in maps))]


def _document(pair: RunPair) -> dict[str, Any]:
    """Return a pair as plain data; every difference, and its standard deviation, is of the parameter's logarithm."""
    agreement = pair.agreement
    mean_difference, mean_difference_std = agreement.level
    first_share, second_share = agreement.shares  # of each run's places, those that the other run covers as well
    return {
        "first": pair.first,
        "second": pair.second,
        "p": pair.p,
        "level": {"difference": mean_difference, "std": mean_difference_std, "p": agreement.level_p},
        "pattern_p": agreement.pattern_p,
        "covered": [first_share, second_share],
        "repeatability": agreement.repeatability,
        "differing_facts": pair.differing_facts,
        "place": agreement.place.tolist(),
        "difference": agreement.difference.tolist(),
        "std": agreement.std.tolist(),
        "common_std": agreement.common_std,
        "e_n": agreement.e_n.tolist(),
    }
