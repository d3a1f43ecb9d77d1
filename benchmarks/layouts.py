"""Lumps on areas: random layouts of stiff patches under flat and rough skins, found and false, and p without any.

Run it with: python benchmarks/layouts.py found|null [--count 200] [--first 5000]. One process, no timing.
The example raster at 6 mm/s, its smoother, samples of 500 Hz; every number is of the simulated rig. Thresholds were
chosen on seeds below 5000.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from palpate_engine.config import Pipeline, load_pipeline
from palpate_maps.map_analysis import (
    Findings,
    LumpSettings,
    Sites,
    find_baseline,
    find_lumps,
    prediction_p,
    sites_along,
)
from palpate_maps.sites import merge_sites
from sweeps import paths

RASTER = Path(__file__).parent.parent / "pipelines" / "raster.toml"
SIZE = np.array([60.0, 40.0])  # [mm] that is palpated
SHARES = (0.05, 0.15, 0.3, 0.45, 0.6)
CONTRASTS = (0.05, 0.1, 0.2, 0.4, 0.6)
SKINS = {"flat": 0.0, "rough": 0.1}  # [mm] of relief
_GAP = 16.0  # [mm] between patches; two that are nearer are one lump


@dataclass(frozen=True)
class Patch:
    """A stiff rectangle."""

    low: np.ndarray  # [mm]
    high: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """Its middle [mm]."""
        return (self.low + self.high) / 2


def layout(dice: np.random.Generator, share: float) -> list[Patch]:
    """One or two rectangles that cover a share of the area and lie inside."""
    while True:
        parts = [1.0] if share > 0.3 or dice.random() < 0.5 else [0.5, 0.5]
        patches: list[Patch] = []
        for part in parts:
            area = part * share * SIZE.prod()
            wide = np.sqrt(area * np.exp(dice.uniform(-0.6, 0.9)))
            sides = np.array([wide, area / wide])
            if (sides > SIZE - 2).any() or (sides < 7.0).any():
                break
            low = dice.uniform(-SIZE / 2, SIZE / 2 - sides)
            patches.append(Patch(low, low + sides))
        if len(patches) == len(parts) and (len(patches) == 1 or _apart(*patches) >= _GAP):
            return patches


def _apart(a: Patch, b: Patch) -> float:
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(a.low - b.high, b.low - a.high))))


def image(patches: Sequence[Patch], contrast: float, file: Path) -> None:
    """Contrasts as a CSV file, pixels of 1 mm over 80 mm x 60 mm."""
    x, y = np.meshgrid(np.arange(80) - 39.5, np.arange(60) - 29.5)
    pixels = np.zeros_like(x)
    for patch in patches:
        pixels[(x > patch.low[0]) & (x < patch.high[0]) & (y > patch.low[1]) & (y < patch.high[1])] = contrast
    np.savetxt(file, pixels, delimiter=",", fmt="%.4g")


def rig(seed: int, roughness: float, file: Path | None) -> Pipeline:
    """The raster over an area with the patches of an image, or without any."""
    body = f'[{{shape="image", file="{file}", depth="2 mm"}}]' if file else "[]"
    settings = [f"run.seed={seed}", f"device.rig.specimen.relief.seed={seed}", 'run.tracks=["dr/smoother"]']
    settings += [f"device.rig.specimen.relief.roughness={roughness} mm", f"device.rig.specimen.inclusions={body}"]
    settings += ["trajectory.raster.speed=6 mm/s", "estimator.smoother.sweep_speed=6 mm/s"]
    return replace(load_pipeline(RASTER, [*settings, "device.rig.sensor_rate=500 Hz"]), sinks={})


def sites_of(given: Pipeline) -> Sites:
    """What the smoother says along the raster."""
    (path,) = paths(given)
    return sites_along(path)


def found(seeds: Sequence[int]) -> None:
    """How many patches are found, where and how large, and how many lumps are false."""
    rows: dict[tuple[str, float, float], list[tuple[int, int, int, list[float], list[float]]]] = {}
    for seed in seeds:
        dice = np.random.default_rng(seed)
        skin, share = list(SKINS)[seed % 2], SHARES[(seed // 2) % len(SHARES)]
        contrast = CONTRASTS[(seed // 2 // len(SHARES)) % len(CONTRASTS)]
        patches = layout(dice, share)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "image.csv"
            image(patches, contrast, file)
            given = rig(seed, SKINS[skin], file)
            sites = sites_of(given)
            told = find_lumps(sites)
            peak = given.devices["rig"].specimen  # type: ignore[attr-defined]
            row = judged(told, patches, peak)
        rows.setdefault((skin, share, contrast), []).append((len(patches), *row))
        print(
            f"seed {seed} {skin} share {share} contrast {contrast}: {len(patches)} patches, {row}, {told.method}",
            flush=True,
        )
    report(rows)


def judged(told: Findings, patches: Sequence[Patch], specimen: object) -> tuple[int, int, list[float], list[float]]:
    """Patches found, false lumps, errors of middles [mm], extents over the patches' sides."""
    hits: dict[int, tuple[float, float]] = {}
    false = 0
    for lump in told.lumps:
        at = 1e3 * np.array(lump.place)
        inside = [i for i, p in enumerate(patches) if (at > p.low - 2).all() and (at < p.high + 2).all()]
        if not inside:
            false += 1
        for i in inside:
            sides = patches[i].high - patches[i].low
            ratio = float(np.prod(1e3 * np.array(lump.extent)) / np.prod(sides)) ** 0.5
            hits.setdefault(i, (float(np.hypot(*(at - patches[i].middle))), ratio))
    return len(hits), false, [e for e, _ in hits.values()], [r for _, r in hits.values()]


def report(rows: dict) -> None:
    """Tables by contrast and by share."""
    for title, key in (("skin, contrast %", 2), ("skin, share %", 1)):
        print(
            f"\n| {title} | layouts | found, of patches | false | error mm, median / largest | extent, median |\n"
            + "|---|---|---|---|---|---|"
        )
        groups = sorted({(k[0], k[key]) for k in rows})
        for skin, value in groups:
            cases = [case for k, v in rows.items() if (k[0], k[key]) == (skin, value) for case in v]
            off, size = ([x for case in cases for x in case[i]] for i in (3, 4))
            where = f"{np.median(off):.1f} / {max(off):.1f} | {np.median(size):.2f}" if off else "- | -"
            hits, all_, false = (sum(case[i] for case in cases) for i in (1, 0, 2))
            print(f"| {skin}, {100 * value:.0f} | {len(cases)} | {hits} of {all_} | {false} | {where} |")


def null(seeds: Sequence[int]) -> None:
    """Alarms on areas without a lump, and the p-values of their sites."""
    for skin, roughness in SKINS.items():
        p, alarms, several = [], 0, 0
        for seed in seeds:
            sites = sites_of(rig(seed, roughness, None))
            coarse = merge_sites(sites, LumpSettings().width)
            baseline = find_baseline(coarse.log, floor=0.0)
            p.append(prediction_p(coarse.log, baseline))
            several += not find_baseline(coarse.log, floor=LumpSettings().spread).single
            alarms += bool(find_lumps(sites).lumps)
        quantiles = np.quantile(np.concatenate(p), [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99])
        print(
            f"{skin}: {alarms} of {len(seeds)} with an alarm, {several} taken for several populations; quantiles of p "
            f"at 0.01 0.05 0.25 0.5 0.75 0.95 0.99: {' '.join(f'{q:.3f}' for q in quantiles)}",
            flush=True,
        )


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["found", "null"])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=5000)
    given = parser.parse_args()
    {"found": found, "null": null}[given.what](range(given.first, given.first + given.count))


if __name__ == "__main__":
    main()
