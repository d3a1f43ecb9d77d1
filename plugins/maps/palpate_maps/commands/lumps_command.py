"""``palpate map lumps`` and ``palpate map compare``: what is stiffer than its surroundings."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer
from palpate import ConfigurationError, Floats, LogError
from palpate_kit.runs.lump_table import LUMP_NOTE, lump_table
from palpate_kit.runs.result_file import usable_value
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.options import TrackOption
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.table import Table

from palpate_maps.commands.curves_command import drop_rejected, unit_of
from palpate_maps.commands.map_command import Parameter, Run, SurfaceName, length

if TYPE_CHECKING:
    from palpate_maps.map_analysis import Findings

_COLUMNS = (3, 13, 13, 13, 13, 13, 9)  # widths of the table of lumps
_SAME_PLACE = 2e-3  # [m]: palpations nearer to each other are one place: half of a site's width
_MIN_GROUPS = {"prediction": (4, 1), "welch": (2, 2)}  # baseline and suspect sites, or repeats, of each test


def lumps(
    run: Run,
    track: TrackOption = None,
    parameter: Parameter = None,
    # Choices, those of `LumpSettings`: without lumps one exam in 200 finds one, and less than 4 % is not reported.
    rate: Annotated[float, typer.Option(help="False-discovery rate; chance of a false alarm without lumps.")] = 0.005,
    contrast: Annotated[float, typer.Option(help="Least contrast that is reported.")] = 0.04,
    width: Annotated[str, typer.Option(help="Width of a site.")] = "4 mm",
    method: Annotated[
        str, typer.Option(help="Along a sweep: prominence, or cusum, a sequential test in time order.")
    ] = "prominence",
    surface: SurfaceName = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print lumps.json instead of the table.")] = False,
) -> None:
    """Find the lumps in a run: place, extent, contrast and p-value of each."""
    from palpate_maps import map_analysis as maps, map_files

    if not 0 < rate < 1 or contrast < 0:
        raise ConfigurationError("--rate must be between 0 and 1, --contrast not below 0")
    if method not in get_args(maps.SweepMethod):
        raise ConfigurationError(f'--method: {method!r} is not one of "prominence" and "cusum"')
    drop_rejected([run])
    with progress(f"lumps of {run.resolve().name}"):
        # Estimates along the way of the tip, and sites: means over each stay, or each millimetre of a sweep.
        path = maps.read_path(run, track, parameter)
        sites, skin = maps.sites_along(path), maps.surface_of_run(run, surface)
        # A sweep is searched along its line, an area on its surface.
        if skin is not None and (sites.standing.all() or maps.line_coordinate(sites) is None):
            sites = maps.sites_on(sites, skin)
        settings = maps.LumpSettings(
            rate,
            contrast,
            width=length(width, "--width"),
            method=method,  # type: ignore[arg-type]
        )
        findings = maps.lumps_of_run(run, path, sites, settings)
    document = map_files.lumps_json(findings, path)
    map_files.replace_file(RunFolder(run).maps / "lumps.json", document)
    if as_json:
        typer.echo(document)
    else:
        table = lump_table(json.loads(document)["lumps"])
        typer.echo(_view(findings, table, path.source, unit_of(run, path.track, path.parameter)))
    if findings.warning:
        typer.echo(f"warning: {findings.warning}", err=True)


def _view(findings: Findings, table: Table, source: str, unit: str) -> str:
    """Return the lumps as a table of the terminal, with the background above and the test's power below."""
    from palpate_engine import display_unit

    name, factor = display_unit(unit)  # the unit that is shown, and its number per SI unit
    lines = [f"{source}: background {findings.background * factor:.4g} {name}, by {findings.method}"]
    if table.rows:
        for row in (table.headings, *table.rows):
            lines.append("".join(f"{cell:>{width}}" for cell, width in zip(row, _COLUMNS, strict=True)))
        lines.append(LUMP_NOTE)
    else:
        lines.append("no lumps")
    power = findings.power
    if power is not None and findings.coordinate is not None:
        lines.append(
            f"a lump {100 * power.contrast:.2g} % stiffer and {1e3 * power.width:.0f} mm wide would be seen with a "
            f"probability of {power.probability:g}"
        )
    return "\n".join([*lines, *exclusion_lines(findings)])


def exclusion_lines(findings: Findings) -> list[str]:
    """Return the lumps that the exam excludes, by width, as lines; none where that is not known."""
    if findings.lags is not None or not findings.excluded:
        return []
    if not any(math.isfinite(power.contrast) for power in findings.excluded):
        return ["nothing is excluded: more than 5 % of the places are too far from every site"]
    where = findings.excluded_where
    lines = [f"excluded with a probability of {findings.excluded[0].probability:g}, {where}, besides these:"]
    contrasts = []
    for power in findings.excluded:
        contrasts.append(f"{100 * power.contrast:.2g}" if math.isfinite(power.contrast) else "-")
    rows = {
        "width mm": [f"{1e3 * power.width:.0f}" for power in findings.excluded],
        "stiffer by % or more": contrasts,
    }
    if findings.response is None:
        lines.insert(1, "(if the track shows lumps as they are: the run has no log to try it on)")
    for name, cells in rows.items():
        lines.append(f"  {name:<20}" + "".join(f"{cell:>8}" for cell in cells))
    return lines


def compare(
    baseline: Annotated[list[Path], typer.Option("--baseline", help="Run at a site without a lump; repeat it.")],
    suspect: Annotated[list[Path], typer.Option("--suspect", help="Run at the suspect site; can be repeated.")],
    track: TrackOption = None,
    parameter: Parameter = None,
    test: Annotated[str, typer.Option(help="prediction, or welch as in the paper.")] = "prediction",
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
) -> None:
    """Test a suspect site against baseline sites, by a prediction interval or by Welch's t-test."""
    import numpy as np

    from palpate_maps import map_analysis as maps

    if test not in ("prediction", "welch"):
        raise ConfigurationError(f'--test: {test!r} is not one of "prediction" and "welch"')
    _refuse_both(baseline, suspect)
    # Of a prediction each place is one value, of Welch's test each repeat.
    groups = []
    for runs in (baseline, suspect):
        sites = sites_of(drop_rejected(runs), track, parameter)  # place and value of each palpation
        groups.append(by_place(sites) if test == "prediction" else np.array([value for _, value in sites]))
    baseline_values, suspect_values = groups
    min_baselines, min_suspects = _MIN_GROUPS[test]
    if len(baseline_values) < min_baselines or len(suspect_values) < min_suspects:
        raise ConfigurationError(
            f"--baseline: {len(baseline_values)} sites are too few for {test}; {min_baselines} are needed"
        )
    if test == "welch":
        comparison = maps.welch(baseline_values, suspect_values)
        typer.echo(
            "welch takes the scatter of repeats for the scatter between sites: many false alarms where sites differ",
            err=as_json,
        )
    else:
        # Several suspect sites are one value, their geometric mean.
        comparison = maps.against_sites(baseline_values, float(np.exp(np.log(suspect_values).mean())))
    if as_json:
        answer = {"contrast": comparison.contrast, "p": comparison.p, "test": comparison.test}
        typer.echo(json.dumps({**answer, "baseline": len(baseline_values)}, indent=2))
        return
    contrast = f"contrast {100 * comparison.contrast:+.2f} %, p = {comparison.p:.2g}"
    typer.echo(f"{contrast} ({comparison.test}, {len(baseline_values)} baseline)")


def _refuse_both(baseline: list[Path], suspect: list[Path]) -> None:
    """Raise ConfigurationError where a run is given twice, or both as a baseline and as a suspect."""
    baseline_runs = [run.resolve() for run in baseline]
    for run in suspect:
        if run.resolve() in baseline_runs:
            raise ConfigurationError(f"--suspect: {run} is also a --baseline: it cannot be tested against itself")
    for option, runs in (("--baseline", baseline), ("--suspect", suspect)):
        for i, run in enumerate(runs):
            if run.resolve() in [other.resolve() for other in runs[:i]]:
                raise ConfigurationError(f"{option}: {run} is given twice; it counts once")


Site = tuple[tuple[float, float] | Path, float]  # where, or the run where that is not recorded; value [SI]


def sites_of(runs: list[Path], track: str | None, parameter: str | None) -> list[Site]:
    """Return each palpation at rest of runs, its place [m] and value; a run without places is one site."""
    from palpate_maps import map_analysis as maps

    palpations: list[Site] = []
    for run in runs:
        try:
            sites = maps.sites_along(maps.read_path(run, track, parameter))
        except LogError:
            palpations.append((run.resolve(), _single_value(run, track, parameter)))
            continue
        for (x, y), value in zip(sites.place[sites.standing], sites.value[sites.standing], strict=True):
            palpations.append(((float(x), float(y)), float(value)))
    return palpations


def _single_value(run: Path, track: str | None, parameter: str | None) -> float:
    """Return the value of a run without places; raises LogError without a usable one."""
    tracks = RunFolder(run).result["tracks"]
    name = track or next((key for key, result in tracks.items() if result["verdict"] != "invalid"), None)
    if name is None or name not in tracks:
        raise LogError(f"{run}: has no usable track {track or ''}".rstrip())
    chosen = parameter or next(iter(tracks[name]["parameters"]))
    value = usable_value(tracks[name], chosen)
    if value is None:
        raise LogError(f"{run}: {name} has no usable {chosen}")
    return float(value["value"])


def by_place(sites: list[Site]) -> Floats:
    """Return one value for each place, the geometric mean of its repeats: repeats at one place are one site."""
    import numpy as np

    places: list[tuple[tuple[float, float] | Path, list[float]]] = []
    for where, value in sites:
        for known_place, values in places:
            if _is_same_place(known_place, where):
                values.append(value)
                break
        else:
            places.append((where, [value]))
    return np.array([np.exp(np.log(values).mean()) for _, values in places])


def _is_same_place(a: tuple[float, float] | Path, b: tuple[float, float] | Path) -> bool:
    """Return True for places near each other, and for the same run without a place."""
    if isinstance(a, Path) or isinstance(b, Path):
        return a == b
    return math.dist(a, b) < _SAME_PLACE
