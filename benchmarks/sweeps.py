"""Sweeps over the simulated S5: which filters find the lumps, how far off, and how often where there is none.

Run it with: python benchmarks/sweeps.py lumps|null|roc|search [--seeds 20] [--speeds 2 4 6]. One process, no timing.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from palpate.config import Pipeline, load_pipeline
from palpate.maps import Findings, find_lumps, read_path, sites_along, tracks_of
from palpate.pipeline import run_pipeline

PIPELINE = Path(__file__).parent.parent / "pipelines" / "sweep.toml"
LUMPS = (-0.014, 0.014)  # [m] where the line crosses the sphere, and the horseshoe's bow
TRACKS = ("dr/ekf", "dr/afekf", "dr/afukf", "dr/kinematic", "dr/smoother")
FINDING = 'run.tracks=["dr/afukf", "dr/kinematic", "dr/smoother"]'


def pipeline(seed: int, speed: float, settle: float, *more: str) -> Pipeline:
    """The example sweep with another seed of noise and skin, and another speed [mm/s]; nothing is recorded."""
    settings = [
        f"run.seed={seed}",
        'run.tracks=["*"]',
        f"device.rig.specimen.relief.seed={seed}",
        f"trajectory.sweep.speed={speed} mm/s",
        f"trajectory.sweep.settle={settle} s",
        f"estimator.kinematic.sweep_speed={speed} mm/s",
        f"estimator.smoother.sweep_speed={speed} mm/s",
        *more,
    ]
    return replace(load_pipeline(PIPELINE, settings), sinks={})


def sweep(given: Pipeline) -> Iterator[tuple[str, Findings, float]]:
    """Track, what it found, and the RMSE of E [kPa] along the path; from the same samples for all tracks."""
    specimen = given.devices["rig"].specimen  # type: ignore[attr-defined]
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        run_pipeline(given, run)
        for track in tracks_of(run):
            path = read_path(run, track)
            moving = np.abs(path.place[:, 1]) < 0.034
            error = path.value - specimen.theta(*path.place.T)[0]
            rmse = float(np.sqrt(np.mean(error[moving] ** 2))) / 1e3
            yield track, find_lumps(sites_along(path)), rmse


def judged(findings: Findings) -> tuple[list[float], int]:
    """Errors of position [mm] of the lumps that were found, and the number of false ones."""
    errors, false = [], 0
    for lump in findings.lumps:
        off = min(abs(lump.along - place) for place in LUMPS)
        if off < 6e-3:
            errors.append(1e3 * off)
        else:
            false += 1
    return errors, false


def lumps(seeds: int, speeds: Sequence[float]) -> None:
    """Detection, position and RMSE by filter and speed."""
    print("| speed mm/s | filter | both found | false | position error mm, median / largest | RMSE kPa, median |")
    print("|---|---|---|---|---|---|")
    for speed in speeds:
        rows: dict[str, list[tuple[list[float], int, float]]] = {}
        for seed in range(seeds):
            for track, findings, rmse in sweep(pipeline(seed, speed, 10.0)):
                rows.setdefault(track, []).append((*judged(findings), rmse))
        for track, found in sorted(rows.items(), key=lambda row: TRACKS.index(row[0])):
            both = sum(len(errors) == 2 for errors, _, _ in found)
            off = [error for errors, _, _ in found for error in errors]
            where = f"{np.median(off):.2f} / {max(off):.2f}" if off else "-"
            false, rmse = sum(f for _, f, _ in found), float(np.median([r for _, _, r in found]))
            print(f"| {speed:g} | {track} | {both} of {seeds} | {false} | {where} | {rmse:.2f} |", flush=True)


def null(seeds: int, speeds: Sequence[float]) -> None:
    """False alarms on homogeneous sweeps."""
    print("| speed mm/s | filter | sweeps | false alarms |\n|---|---|---|---|")
    for speed in speeds:
        alarms: dict[str, int] = {}
        for seed in range(seeds):
            empty = pipeline(1000 + seed, speed, 3.0, FINDING, "device.rig.specimen.inclusions=[]")
            for track, findings, _ in sweep(empty):
                alarms[track] = alarms.get(track, 0) + bool(findings.lumps)
            print(f"after {seed + 1} sweeps: {alarms}", file=sys.stderr, flush=True)
        for track, count in sorted(alarms.items(), key=lambda row: TRACKS.index(row[0])):
            print(f"| {speed:g} | {track} | {seeds} | {count} |", flush=True)


def roc(seeds: int) -> None:
    """Share of sweeps in which a sphere of 5 mm radius is found, by depth of its top and stiffness ratio, at 4 mm/s."""
    print("| depth mm | stiffness ratio | contrast % | kinematic | smoother | AFUKF |\n|---|---|---|---|---|---|")
    for depth in (4, 6, 8, 11):
        for ratio in (2.0, 5.3):
            body = f'[{{shape="sphere", depth="{depth} mm", radius="5 mm", stiffness_ratio={ratio}}}]'
            found, contrast = dict.fromkeys(("dr/kinematic", "dr/smoother", "dr/afukf"), 0), math.nan
            for seed in range(seeds):
                given = pipeline(seed, 4.0, 3.0, FINDING, f"device.rig.specimen.inclusions={body}")
                contrast = given.devices["rig"].specimen.inclusions[0].contrast_above  # type: ignore[attr-defined]
                for track, findings, _ in sweep(given):
                    if track in found:
                        found[track] += any(abs(lump.along) < 4e-3 for lump in findings.lumps)
            shares = " | ".join(f"{count / seeds:.2f}" for count in found.values())
            print(f"| {depth} | {ratio:g} | {100 * contrast:.1f} | {shares} |", flush=True)


def search(seeds: int) -> None:
    """Time to a checked sphere of 5 mm radius anywhere in 60 mm x 40 mm: two coarse lines, then points by suspicion."""
    from palpate.cli.search import visit
    from palpate.maps import propose

    raster = PIPELINE.with_name("raster.toml")
    whole = next(iter(load_pipeline(raster).trajectories.values())).total_duration
    times, errors = [], []
    for seed in range(seeds):
        x, y = np.random.default_rng(seed).uniform((-25.0, -17.0), (25.0, 17.0))
        body = f'[{{shape="sphere", place=["{x} mm","{y} mm"], depth="4 mm", radius="5 mm"}}]'
        settings = [f"run.seed={seed}", f"device.rig.specimen.relief.seed={seed}", 'run.tracks=["dr/smoother"]']
        settings += [f"device.rig.specimen.inclusions={body}", "trajectory.raster.speed=6 mm/s"]
        settings += ['trajectory.raster.size=["60 mm", "20 mm"]', "trajectory.raster.pitch=20 mm"]
        settings += ["trajectory.raster.settle=1 s", "estimator.smoother.sweep_speed=6 mm/s"]
        given = replace(load_pipeline(raster, settings), sinks={})
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            run_pipeline(given, run)
            spent, found = next(iter(given.trajectories.values())).total_duration, None
            while found is None and spent < whole:
                places = propose(sites_along(read_path(run)), 2, area=(-0.03, 0.03, -0.02, 0.02))
                spent += visit(run, [place.place for place in places], 2.0)
                lumps = find_lumps(sites_along(read_path(run))).lumps
                found = next((lump for lump in lumps if lump.checked and lump.p < 1e-3), None)
        off = math.hypot(1e3 * found.place[0] - x, 1e3 * found.place[1] - y) if found else math.inf
        times.append(spent if off < 5.0 else math.inf)
        errors.append(off)
        print(f"seed {seed}: {spent:.1f} s, {off:.1f} mm off", flush=True)
    median = float(np.median(times))
    print(f"whole raster {whole:.1f} s; search: median {median:.1f} s, {median / whole:.2f} of it; ", end="")
    print(f"found within 5 mm in {np.isfinite(times).sum()} of {seeds}, median error {np.median(errors):.1f} mm")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["lumps", "null", "roc", "search"])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--speeds", type=float, nargs="+", default=[2.0, 4.0, 6.0])
    given = parser.parse_args()
    if given.what in ("roc", "search"):
        {"roc": roc, "search": search}[given.what](given.seeds)
    else:
        {"lumps": lumps, "null": null}[given.what](given.seeds, given.speeds)


if __name__ == "__main__":
    main()
