"""``palpate lumps`` and ``palpate compare-sites``: what is stiffer than its surroundings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from palpate.cli.curves import unit_of
from palpate.cli.map import Parameter, Run, Track, length
from palpate.errors import ConfigurationError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from palpate.maps import Findings


def lumps(
    run: Run,
    track: Track = None,
    parameter: Parameter = None,
    rate: Annotated[float, typer.Option(help="False-discovery rate; chance of an alarm where nothing is.")] = 0.005,
    contrast: Annotated[float, typer.Option(help="Least contrast that is reported.")] = 0.04,
    spread: Annotated[
        float, typer.Option(help="Spread of the stiffness between sites that is always believed.")
    ] = 0.005,
    width: Annotated[str, typer.Option(help="Width of a site.")] = "4 mm",
    method: Annotated[
        str, typer.Option(help="Along a sweep: prominence, or cusum, a sequential test in the order of time.")
    ] = "prominence",
    as_json: Annotated[bool, typer.Option("--json", help="Print lumps.json instead of the table.")] = False,
) -> None:
    """Find the lumps in a run: place, extent, contrast and p-value of each."""
    from palpate import maps
    from palpate.maps import export

    if not 0 < rate < 1 or contrast < 0 or spread < 0:
        raise ConfigurationError("--rate must be between 0 and 1, --contrast and --spread not below 0")
    if method not in get_args(maps.SweepMethod):
        raise ConfigurationError(f'--method: {method!r} is none of "prominence" and "cusum"')
    settings = maps.LumpSettings(rate, contrast, spread, length(width, "--width"), method)  # type: ignore[arg-type]
    path = maps.read_path(run, track, parameter)
    findings = maps.find_lumps(maps.sites_along(path), settings)
    text = export.lumps_json(findings, path.track, path.parameter)
    export.replace_file(run / "maps" / "lumps.json", text)
    typer.echo(text if as_json else _view(findings, path.track, unit_of(run, path.track, path.parameter)))


def _view(findings: Findings, track: str, unit: str) -> str:
    from palpate.units import people

    name, factor = people(unit)
    head = f"{track}: background {findings.background * factor:.4g} {name}, by {findings.method}"
    if not findings.lumps:
        return f"{head}\nno lumps"
    lines = [head, "    x mm    y mm   extent mm   contrast %         p"]
    for lump in findings.lumps:
        extent = " x ".join(f"{1e3 * size:.1f}" for size in lump.extent if size > 0)
        stiffer = f"{100 * lump.contrast:.1f} ± {100 * lump.contrast_std:.1f}"
        lines.append(f"{1e3 * lump.place[0]:8.1f}{1e3 * lump.place[1]:8.1f}{extent:>12}{stiffer:>13}{lump.p:10.2g}")
    return "\n".join(lines)


def compare(
    baseline: Annotated[list[Path], typer.Option("--baseline", help="Run at a site without a lump; repeat it.")],
    suspect: Annotated[list[Path], typer.Option("--suspect", help="Run at the suspect site; can be repeated.")],
    track: Track = None,
    parameter: Parameter = None,
    test: Annotated[str, typer.Option(help="prediction, or welch as in the paper.")] = "prediction",
) -> None:
    """Test a suspect site against baseline sites, by a prediction interval or by Welch's t-test."""
    import numpy as np

    from palpate import maps

    if test not in ("prediction", "welch"):
        raise ConfigurationError(f'--test: {test!r} is none of "prediction" and "welch"')
    groups = [np.concatenate([_site_values(run, track, parameter) for run in runs]) for runs in (baseline, suspect)]
    least = 2 if test == "welch" else 4
    if len(groups[0]) < least or len(groups[1]) < (2 if test == "welch" else 1):
        raise ConfigurationError(f"--baseline: {len(groups[0])} sites are too few for {test}; {least} are needed")
    if test == "welch":
        found = maps.welch(groups[0], groups[1])
        typer.echo("welch takes the scatter of repeats for that between sites: many false alarms where sites differ")
    else:
        found = maps.against_sites(groups[0], float(np.exp(np.log(groups[1]).mean())))
    typer.echo(f"contrast {100 * found.contrast:+.2f} %, p = {found.p:.2g} ({found.test}, {len(groups[0])} baseline)")


def _site_values(run: Path, track: str | None, parameter: str | None) -> NDArray[np.float64]:
    """The value at each site that a run palpated."""
    from palpate import maps

    sites = maps.sites_along(maps.read_path(run, track, parameter))
    return sites.value[sites.standing]
