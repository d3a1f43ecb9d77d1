"""The simulated sweep against the recorded one, and which lumps a sweep shows as often as it says.

Run it with: python benchmarks/sweep_power.py agree|power|alarms [--seeds 40] [--first 3000] [--speeds 2 4 6]. Needed by
`agree`:
the authors' sweep over S5 at 4 mm/s (../shared/data/ur3e-bota-2024/tran_4mms.csv.gz, or --file). One process.

agree: standard deviations of the channels in bands of frequency while the tip moves, of the smoother's surface in bands
of wavelength, and of what each filter says of E from millimetre to millimetre (by the median of second differences,
which lumps do not move). The rig is set as in RECORDED.
power: sweeps without a lump say what contrast a lump 10 mm wide would be seen at with a probability of 0.8; then such
lumps are put there, of this and of other contrasts, and counted.
alarms: sweeps without a lump, whose stay of 10 s shows the scatter of each filter, and whose NIS is above 1: lumps that
are found, by both methods.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from palpate import Floats
from palpate.estimation import Samples
from palpate_engine.config import Pipeline, load_pipeline
from palpate_maps.map_analysis import LumpSettings, Path2D, find_lumps, sites_along
from sweeps import METHODS, aligned, paths_of, pipeline, samples_of

FILE = Path(__file__).parents[2] / "shared" / "data" / "ur3e-bota-2024" / "tran_4mms.csv.gz"
FIGURES = Path(__file__).parents[1] / "pipelines" / "figures"
TRACKS = 'run.tracks=["dr/smoother", "dr/kinematic", "dr/afukf"]'
RECORDED = [  # what makes the simulated rig agree with the recording
    "device.rig.force_std=0.064 N",
    "device.rig.position_std=7.1 um",
    "device.rig.velocity_std=0.47 mm/s",
    "device.rig.unrest=40 um",
    "trajectory.sweep.settle=1 s",
]
RELIEF = 'device.rig.specimen.relief={{roughness="0.05 mm", length="3 mm", tilt_y="-0.9 deg", seed={}}}'
FREQUENCIES = ((0.5, 1.5), (3.0, 3.8), (5.0, 5.8), (9.0, 20.0), (20.0, 50.0), (50.0, 100.0), (100.0, 200.0))  # [Hz]
LENGTHS = ((60, 20), (20, 10), (10, 5), (5, 2))  # [mm]


def simulated(seed: int, speed: float, *more: str) -> Pipeline:
    """The sweep with the noise, the relief and the short stay of the recording."""
    return pipeline(seed, speed, *RECORDED, RELIEF.format(seed), *more)


def bands(values: Floats, rate: float, edges: Sequence[tuple[float, float]]) -> list[float]:
    """Standard deviation in bands of frequency."""
    from scipy import signal

    frequency, density = signal.welch(values - values.mean(), rate, nperseg=min(2048, len(values)))
    inside = [(frequency >= low) & (frequency < high) for low, high in edges]
    return [float(np.sqrt(np.trapezoid(density[rows], frequency[rows]))) for rows in inside]


def channels(samples: Samples) -> dict[str, list[float]]:
    """Bands of force [mN], position [um] and velocity [um/s] while the tip moves along."""
    along = samples.lateral[:, 1]
    moving = (along > along.min() + 3e-3) & (along < along.max() - 3e-3)
    scale = {
        "force mN": (samples.force, 1e3),
        "position um": (samples.position, 1e6),
        "velocity um/s": (samples.velocity, 1e6),
    }
    return {
        name: [factor * s for s in bands(values[moving], 500.0, FREQUENCIES)]
        for name, (values, factor) in scale.items()
    }


def relief(path: Path2D) -> list[float]:
    """Bands of the surface along the way [um]."""
    from scipy import signal

    assert path.surface is not None
    order = np.argsort(path.place[:, 1], kind="stable")
    grid = np.arange(path.place[:, 1].min() + 2e-3, path.place[:, 1].max() - 2e-3, 5e-4)
    height = np.interp(grid, path.place[order, 1], path.surface[order])
    frequency, density = signal.periodogram(height, 2000.0, window="hann", detrend="linear")
    inside = [(frequency >= 1e3 / long) & (frequency < 1e3 / short) for long, short in LENGTHS]
    return [1e6 * float(np.sqrt(np.trapezoid(density[rows], frequency[rows]))) for rows in inside]


def scatter(path: Path2D) -> float:
    """Standard deviation of E from site to site [%], without what lumps make of it."""
    sites = sites_along(path)
    return 100 * float(np.median(np.abs(np.diff(sites.log[~sites.standing], 2)))) / 0.6745 / np.sqrt(6)


def described(given: Pipeline, samples: Samples) -> dict[str, list[float]]:
    """Everything that is compared, in the order of the table."""
    rows = channels(samples)
    for path in paths_of(given, samples):
        if path.track == "dr/smoother":
            rows["surface um"] = relief(path)
        rows[f"{path.track}: E %, NIS"] = [scatter(path), path.nis]
    return rows


def agree(seeds: Sequence[int], file: Path) -> None:
    """The recording and the simulation, with its defaults and as set here."""
    recorded = load_pipeline(FIGURES / "recorded.toml", [f"device.log.file={file}", TRACKS])
    real = described(recorded, aligned(recorded))
    print(f"bands: {FREQUENCIES} Hz; surface: {LENGTHS} mm")
    print("| | recorded | simulated | with the defaults |\n|---|---|---|---|")
    found = [_medians([described(g, samples_of(g)) for g in group]) for group in (
        [simulated(seed, 4.0, TRACKS) for seed in seeds], [pipeline(seed, 4.0, TRACKS) for seed in seeds]
    )]  # fmt: skip
    for name, values in real.items():
        print(f"| {name} | " + " | ".join(_text(each[name]) for each in ({name: values}, *found)) + " |")


def _medians(tables: list[dict[str, list[float]]]) -> dict[str, list[float]]:
    return {name: np.median([table[name] for table in tables], axis=0).tolist() for name in tables[0]}


def _text(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def findings_of(seed: int, speed: float, peak: float) -> Iterator[tuple[str, float, bool, int]]:
    """Of each track of a sweep with one lump: the contrast with a power of 0.8, whether it is found, and false ones."""
    body = f'[{{shape="sphere", depth="3.2 mm", radius="4.2 mm", peak={peak}}}]' if peak else "[]"
    given = simulated(seed, speed, TRACKS, f"device.rig.specimen.inclusions={body}")
    for path in paths_of(given, samples_of(given)):
        found = find_lumps(sites_along(path))
        assert found.power is not None
        there = [abs(lump.along) < 5e-3 for lump in found.lumps]
        yield path.track, found.power.contrast, any(there), len(there) - sum(there)


def power(seeds: Sequence[int], speeds: Sequence[float]) -> None:
    """What sweeps say that they would see, and what they see."""
    print("| speed mm/s | track | contrast % at 0.8, said | seen at 0.7, 1, 1.3 of it | said with a lump | false |")
    print("|---|---|---|---|---|---|")
    for speed in speeds:
        plain = [list(findings_of(seed, speed, 0.0)) for seed in seeds]
        said = {row[0][0]: float(np.median([each[1] for each in row])) for row in zip(*plain, strict=True)}
        false = {row[0][0]: sum(each[3] + each[2] for each in row) for row in zip(*plain, strict=True)}
        for track, contrast in said.items():
            seen, after = [], []
            for factor in (0.7, 1.0, 1.3):
                rows = [row for seed in seeds for row in findings_of(seed, speed, factor * contrast) if row[0] == track]
                seen.append(np.mean([row[2] for row in rows]))
                after += [row[1] for row in rows]
            shares = ", ".join(f"{share:.2f}" for share in seen)
            print(
                f"| {speed:g} | {track} | {100 * contrast:.1f} | {shares} | {100 * np.median(after):.1f} "
                f"| {false[track]} of {len(seeds)} |",
                flush=True,
            )


def alarms(seeds: Sequence[int], speeds: Sequence[float]) -> None:
    """Sweeps without a lump in which one is found."""
    count: dict[tuple[str, str], int] = {}
    innovations: dict[str, list[float]] = {}
    for speed, seed in itertools.product(speeds, seeds):
        without = simulated(seed, speed, TRACKS, "trajectory.sweep.settle=10 s", "device.rig.specimen.inclusions=[]")
        for path in paths_of(without, samples_of(without)):
            innovations.setdefault(path.track, []).append(path.nis)
            for method in METHODS:
                found = find_lumps(sites_along(path), LumpSettings(method=method))  # type: ignore[arg-type]
                count[path.track, method] = count.get((path.track, method), 0) + bool(found.lumps)
    for (track, method), number in count.items():
        nis = float(np.median(innovations[track]))
        print(f"{track}, {method}: {number} of {len(seeds) * len(speeds)}, NIS {nis:.2f}", flush=True)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["agree", "power", "alarms"])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=3000)
    parser.add_argument("--speeds", type=float, nargs="+", default=[2.0, 4.0, 6.0])
    parser.add_argument("--file", type=Path, default=FILE)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    if given.what == "agree":
        agree(seeds, given.file)
    else:
        {"power": power, "alarms": alarms}[given.what](seeds, given.speeds)


if __name__ == "__main__":
    main()
