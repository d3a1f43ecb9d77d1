"""Sweeps over the simulated S5: which filters find the lumps, how far off, and how often where none exists.

Run it with: python benchmarks/sweeps.py lumps|null|relief|roc|search [--seeds 20] [--first 1000] [--speeds 2 4 6].
One process, no timing. Thresholds and settings were chosen on seeds below 1000; reported are others.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from palpate.device import Batch
from palpate.estimation import Samples, Status
from palpate_engine import TrackName
from palpate_engine.config import Pipeline, load_pipeline
from palpate_engine.pipeline import start_tracks
from palpate_engine.pipeline.planned_motion import single_trajectory
from palpate_kit.runs.run_folder import RunFolder
from palpate_maps.map_analysis import Findings, LumpSettings, Path2D, find_lumps, sites_along
from palpate_simulation.skin_under_tip import SkinUnderTip

PIPELINE = Path(__file__).parent.parent / "pipelines" / "sweep.toml"
LUMPS = (-0.014, 0.014)  # [m] where the line crosses the sphere, and the horseshoe's bow
TRACKS = ("dr/ekf", "dr/afekf", "dr/afukf", "dr/kinematic", "dr/fixed-lag", "dr/smoother")
METHODS = ("prominence", "cusum")
UNUSABLE = Status.IDLE | Status.WAITING | Status.DIVERGED


def pipeline(seed: int, speed: float, *more: str) -> Pipeline:
    """The example sweep with another seed of noise and skin, and another speed [mm/s]; nothing is recorded."""
    lagged = f'estimator.fixed-lag={{type="kinematic-smoother", lag="0.5 s", sweep_speed="{speed} mm/s"}}'
    settings = [
        f"run.seed={seed}",
        'run.tracks=["*"]',
        f"device.rig.specimen.relief.seed={seed}",
        f"trajectory.sweep.speed={speed} mm/s",
        f"estimator.kinematic.sweep_speed={speed} mm/s",
        f"estimator.smoother.sweep_speed={speed} mm/s",
        lagged,
        *more,
    ]
    return replace(load_pipeline(PIPELINE, settings), sinks={})


def samples_of(given: Pipeline) -> Samples:
    """All samples of a simulated run in one block: the same numbers as in a run, which cuts them into many."""
    ((_, rig),) = given.devices.items()
    with rig.connect(given.run.seed) as link:
        link.follow(single_trajectory(given))  # type: ignore[attr-defined]
        return _aligned(given, link.batches())


def aligned(given: Pipeline) -> Samples:
    """All samples of a recording in one block."""
    ((_, log),) = given.devices.items()
    with log.connect(given.run.seed) as link:
        return _aligned(given, link.batches())


def _aligned(given: Pipeline, arriving: Iterable[Batch]) -> Samples:
    (name,) = given.devices
    batches: dict[str, list[Batch]] = {}
    for batch in arriving:
        batches.setdefault(batch.stream, []).append(batch)
    aligner = given.new_aligner()
    for stream, group in batches.items():
        time, received, values = (
            np.concatenate([getattr(b, key) for b in group]) for key in ("time", "received", "values")
        )
        aligner.feed(name, Batch(stream, time, received, values))
    return Samples.joined([aligner.samples(), aligner.samples(final=True)])


def paths(given: Pipeline) -> Iterator[Path2D]:
    """What each track says along the way of a simulated run, from the same samples for all."""
    return paths_of(given, samples_of(given))


def paths_of(given: Pipeline, samples: Samples) -> Iterator[Path2D]:
    """What each track says along the way; as `read_path` reads it from a run.

    Every fifth sample of 500 Hz, as in a run's table of estimates.
    """
    fifth = np.arange(len(samples)) % 5 == 0
    for running in start_tracks(given):
        found = running.tracker.run(samples)
        value, std = found.values[:, 0], found.std[:, 0]
        used = fifth & ((found.status & int(UNUSABLE)) == 0) & np.isfinite(value) & (value > 0) & np.isfinite(std)
        nis = float(np.nanmean(found.nis[used]))
        place = np.nan_to_num(samples.lateral[used])  # a sweep may know one coordinate only
        told = float(found.details.get("relief_sensitivity", 0.0))
        yield Path2D(
            running.track.name, "elasticity", samples.time[used], place, value[used], std[used], nis,
            found.surface[used], told,
        )  # fmt: skip


def rmse(path: Path2D, given: Pipeline) -> float:
    """Root mean square error of E [kPa] along the path, without its first and last millimetre."""
    moving = np.abs(path.place[:, 1]) < 0.034
    error = path.value - SkinUnderTip(given.devices["rig"].specimen, np.pad(path.place, ((0, 0), (0, 1)))).theta[0]  # type: ignore[attr-defined]
    return float(np.sqrt(np.mean(error[moving] ** 2))) / 1e3


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


def lumps(seeds: Sequence[int], speeds: Sequence[float]) -> None:
    """Detection, position and RMSE by filter, speed and method."""
    print("| speed mm/s | filter | RMSE kPa, median | method | both found | false | error mm, median / largest |")
    print("|---|---|---|---|---|---|---|")
    for speed in speeds:
        rows: dict[tuple[str, str], list[tuple[list[float], int]]] = {}
        errors: dict[str, list[float]] = {}
        for seed in seeds:
            given = pipeline(seed, speed)
            for path in paths(given):
                errors.setdefault(path.track, []).append(rmse(path, given))
                sites = sites_along(path)
                for method in METHODS:
                    found = judged(find_lumps(sites, LumpSettings(method=method)))  # type: ignore[arg-type]
                    rows.setdefault((path.track, method), []).append(found)
        for track in TRACKS:
            for method in METHODS:
                found = rows[track, method]
                both, false = sum(len(e) == 2 for e, _ in found), sum(f for _, f in found)
                off = [error for e, _ in found for error in e]
                where = f"{np.median(off):.2f} / {max(off):.2f}" if off else "-"
                kilopascal = f"{np.median(errors[track]):.2f}"
                print(
                    f"| {speed:g} | {track} | {kilopascal} | {method} | {both} of {len(seeds)} | {false} | {where} |",
                    flush=True,
                )


RELIEF = 'device.rig.specimen.relief={roughness="0.3 mm", length="10 mm", tilt_y="1 deg"}'


def relief(seeds: Sequence[int], speeds: Sequence[float]) -> None:
    """The same on a skin of 0.3 mm and 1 degree: false alarms where nothing is, and what is still found of S5."""
    for body in ("device.rig.specimen.inclusions=[]", ""):
        counts = {track: [0] * len(speeds) for track in TRACKS}
        for column, speed in enumerate(speeds):
            for seed in seeds:
                settings = [RELIEF, f"device.rig.specimen.relief.seed={seed}", *([body] if body else [])]
                for path in paths(pipeline(seed, speed, *settings)):
                    errors, false = judged(find_lumps(sites_along(path)))
                    counts[path.track][column] += (len(errors) if not body else 0) + bool(false or errors) * bool(body)
        print(f"| filter | {'sweeps with an alarm' if body else 'lumps found, of 2 a sweep'}, {len(seeds)} a speed |")
        for track, found in counts.items():
            print(f"| {track} | {', '.join(map(str, found))} |", flush=True)


def null(seeds: Sequence[int], speeds: Sequence[float]) -> None:
    """False alarms on homogeneous sweeps."""
    print("| filter | method | sweeps with an alarm, of all | by speed |\n|---|---|---|---|")
    alarms = {(track, method): [0] * len(speeds) for track in TRACKS for method in METHODS}
    for column, speed in enumerate(speeds):
        for seed in seeds:
            for path in paths(pipeline(seed, speed, "device.rig.specimen.inclusions=[]")):
                sites = sites_along(path)
                for method in METHODS:
                    found = find_lumps(sites, LumpSettings(method=method))  # type: ignore[arg-type]
                    alarms[path.track, method][column] += bool(found.lumps)
    for (track, method), counts in alarms.items():
        total = len(seeds) * len(speeds)
        print(f"| {track} | {method} | {sum(counts)} of {total} | {', '.join(map(str, counts))} |", flush=True)


def roc(seeds: Sequence[int]) -> None:
    """Share of sweeps in which a sphere of 5 mm radius is found, by depth of its top and stiffness ratio, at 4 mm/s."""
    tracks = TRACKS[2:4] + TRACKS[5:]
    columns = [(track, method) for method in METHODS for track in tracks]
    print(
        "| depth mm | stiffness ratio | contrast % | "
        + " | ".join(f"{TrackName.parse(t).estimator}, {m}" for t, m in columns)
        + " |"
    )
    print("|---|---|---|" + "---|" * len(columns))
    for depth in (2, 4, 6, 8, 11):
        for ratio in (1.5, 2.0, 3.0, 5.3):
            body = f'[{{shape="sphere", depth="{depth} mm", radius="5 mm", stiffness_ratio={ratio}}}]'
            found, contrast = dict.fromkeys(columns, 0), math.nan
            for seed in seeds:
                given = pipeline(seed, 4.0, f"device.rig.specimen.inclusions={body}", f"run.tracks={_listed(tracks)}")
                contrast = given.devices["rig"].specimen.inclusions[0].contrast_above  # type: ignore[attr-defined]
                for path in paths(given):
                    sites = sites_along(path)
                    for method in METHODS:
                        lumps = find_lumps(sites, LumpSettings(method=method)).lumps  # type: ignore[arg-type]
                        found[path.track, method] += any(abs(lump.along) < 4e-3 for lump in lumps)
            shares = " | ".join(f"{found[column] / len(seeds):.2f}" for column in columns)
            print(f"| {depth} | {ratio:g} | {100 * contrast:.1f} | {shares} |", flush=True)


def _listed(tracks: Sequence[str]) -> str:
    return "[" + ", ".join(f'"{track}"' for track in tracks) + "]"


def search(seeds: Sequence[int]) -> None:
    """`palpate run` of two coarse lines, then `palpate map search --go`, as typed: one sphere of 5 mm radius, then two.

    The lines cover 60 mm x 20 mm; spheres lie anywhere in 70 mm x 50 mm, so also beyond, 20 mm or more apart.
    """
    raster = PIPELINE.with_name("raster.toml")
    whole = next(iter(load_pipeline(raster).trajectories.values())).total_duration
    for count in (1, 2):
        spent, errors, false = [], [], 0
        for seed in seeds:
            spheres = _spheres(np.random.default_rng(seed), count)
            took, found = _searched(raster, seed, spheres)
            off = [min((math.dist(sphere, at) for at in found), default=math.inf) for sphere in spheres]
            false += sum(min(math.dist(sphere, at) for sphere in spheres) > 8.0 for at in found)
            spent.append(took if max(off) < 5.0 else math.inf)
            errors += off
            print(f"seed {seed}: {took:.1f} s, {', '.join(f'{o:.1f}' for o in off)} mm off", flush=True)
        median, hits = float(np.median(spent)), [error for error in errors if error < 5.0]
        print(
            f"{count} spheres, whole raster {whole:.1f} s; search: median {median:.1f} s, {median / whole:.2f} of it;"
        )
        print(
            f"within 5 mm {len(hits)} of {len(errors)}, error {np.median(hits):.1f} / {max(hits):.1f} mm; false {false}"
        )


def _spheres(dice: np.random.Generator, count: int) -> list[tuple[float, float]]:
    while True:
        places = [tuple(dice.uniform((-33.0, -23.0), (33.0, 23.0)).tolist()) for _ in range(count)]
        if all(math.dist(a, b) >= 20.0 for i, a in enumerate(places) for b in places[:i]):
            return places


def _searched(raster: Path, seed: int, spheres: list[tuple[float, float]]) -> tuple[float, list[tuple[float, float]]]:
    """Seconds of motion, and the places [mm] of the lumps that the command says are certain."""
    from palpate_engine.cli import call

    bodies = ",".join(f'{{shape="sphere", place=["{x} mm","{y} mm"], depth="4 mm", radius="5 mm"}}' for x, y in spheres)
    settings = [f"run.seed={seed}", f"device.rig.specimen.relief.seed={seed}", 'run.tracks=["dr/smoother"]']
    settings += [f"device.rig.specimen.inclusions=[{bodies}]", "trajectory.raster.speed=6 mm/s"]
    settings += ['trajectory.raster.size=["60 mm", "20 mm"]', "trajectory.raster.pitch=20 mm"]
    settings += ["trajectory.raster.settle=1 s", "estimator.smoother.sweep_speed=6 mm/s"]
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as said:
        run = str(Path(folder) / "run")
        call(["run", str(raster), "--out", run, *(part for text in settings for part in ("--set", text))])
        call(["map", "search", run, "--go"])
        lines = [load_pipeline(part.pipeline).trajectories for part in RunFolder(Path(run)).parts]
    took = sum(motion.total_duration for motions in lines for motion in motions.values())
    certain = re.findall(r"lump at (-?[\d.]+) mm, (-?[\d.]+) mm: p = \S+, certain", said.getvalue())
    return took, [(float(x), float(y)) for x, y in certain]


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["lumps", "null", "relief", "roc", "search"])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--speeds", type=float, nargs="+", default=[2.0, 4.0, 6.0])
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    if given.what in ("roc", "search"):
        {"roc": roc, "search": search}[given.what](seeds)
    else:
        {"lumps": lumps, "null": null, "relief": relief}[given.what](seeds, given.speeds)


if __name__ == "__main__":
    main()
