"""Bodies that are fitted: two lumps near each other, one alone, three of a field; found, false, errors and coverage.

Run it with: python benchmarks/bodies.py pairs|one|three|narrow|speed|breast [--count 50]. One process. Fields are
arrays but for `breast`, which runs pipelines/breast.toml as a user does.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
from palpate import Floats
from palpate_engine.config import load_pipeline
from palpate_maps.body_field import FWHM
from palpate_maps.map_analysis import Findings, Lump, Sites, find_lumps, make_map

BREAST = Path(__file__).parent.parent / "pipelines" / "breast.toml"
MATCH_DISTANCE = 8e-3  # [m] of a lump from the body that it is, at most: a width of one
WIDTH = 8e-3 / FWHM  # [m] standard deviation of a lump 8 mm wide at half its height
Bump = tuple[float, float, float, float]  # x, y [m], contrast, standard deviation [m]


def field(
    dice: np.random.Generator, bumps: Sequence[Bump], noise: float, size: tuple[float, float], pitch: float
) -> Sites:
    """Points of a grid over an area [m] with Gaussian lumps, and a noise of the logarithm."""
    axes = (np.arange(round(length / pitch) + 1) * pitch - length / 2 for length in size)
    x, y = np.meshgrid(*axes)
    place = np.column_stack([x.ravel(), y.ravel()])
    contrast = np.zeros(len(place))
    for bx, by, height, sigma in bumps:
        contrast += height * np.exp(-((place - [bx, by]) ** 2).sum(axis=1) / (2 * sigma**2))
    n = len(place)
    log = math.log(112e3) + np.log1p(contrast) + noise * dice.standard_normal(n)
    return Sites(place, log, np.full(n, noise), 3.0 * np.arange(n), np.ones(n, bool))


def matched(findings: Findings, bumps: Sequence[Bump]) -> list[Lump]:
    """The nearest lump of each bump."""
    return [min(findings.lumps, key=lambda lump, b=bump: math.dist(lump.place, b[:2])) for bump in bumps]


def row(lump: Lump) -> tuple[list[float], float, float, str]:
    """Place [mm], contrast, its standard deviation and p."""
    place = np.round(1e3 * np.array(lump.place), 1).tolist()
    return place, round(lump.contrast, 3), round(lump.contrast_std, 3), f"{lump.p:.1g}"


def within(lump: Lump, bump: Bump) -> Floats:
    """True for contrast, x and width that are within two standard deviations."""
    assert lump.place_std is not None
    assert lump.width_std is not None
    width = FWHM * bump[3]
    errors = (lump.contrast - bump[2], lump.place[0] - bump[0], lump.extent[0] - width)
    stds = (lump.contrast_std, lump.place_std[0], lump.width_std * lump.extent[0])
    return np.abs(errors) < 2 * np.array(stds)


def pairs(count: int) -> None:
    """Two lumps in 40 mm x 30 mm, by their distance and contrasts: two, within 1.5 mm; one; more."""
    all_contrasts = ((1.0, 1.0), (0.3, 0.3), (1.0, 0.3))
    for noise, gap, contrasts in product((0.005, 0.01), (10, 12, 14, 16, 20), all_contrasts):
        numbers, near, inside = [], 0, []
        for seed in range(count):
            dice = np.random.default_rng([seed, gap, *(int(10 * c) for c in contrasts)])
            angle, middle = dice.uniform(0, np.pi), dice.uniform(-2e-3, 2e-3, 2)
            half = gap / 2 * 1e-3 * np.array([np.cos(angle), np.sin(angle)])
            bumps = [(*(middle + way * half), c, WIDTH) for way, c in zip((1, -1), contrasts, strict=True)]
            findings = find_lumps(field(dice, bumps, noise, (0.04, 0.03), 5e-3))
            numbers.append(len(findings.lumps))
            if len(findings.lumps) == 2:
                lumps = matched(findings, bumps)
                near += all(math.dist(lump.place, b[:2]) < 1.5e-3 for lump, b in zip(lumps, bumps, strict=True))
                inside += [within(lump, b) for lump, b in zip(lumps, bumps, strict=True) if len(lump.bodies) == 1]
        print(
            f"noise {noise} gap {gap} {contrasts}: lumps {np.bincount(numbers)}, two within 1.5 mm {near} of {count}, "
            f"contrast, place, width within 2u {_share(inside)}",
            flush=True,
        )


def _share(inside: Sequence[Floats]) -> Floats | str:
    """Return the share of numbers that are within two standard deviations, by what they are of; a dash of none."""
    return np.mean(inside, axis=0).round(2) if inside else "-"


def one(count: int) -> None:
    """One lump 7 to 16 mm wide in 40 mm x 30 mm: one; may be two; more."""
    for noise in (0.005, 0.01):
        for contrast in (0.1, 0.3, 1.0):
            numbers, several, inside, errors = [], 0, [], []
            for seed in range(count):
                dice = np.random.default_rng([seed, int(100 * contrast), 7])
                place, sigma = dice.uniform([-14e-3, -9e-3], [14e-3, 9e-3]), dice.uniform(7e-3, 16e-3) / FWHM
                bump = (*place.tolist(), contrast, float(sigma))
                findings = find_lumps(field(dice, [bump], noise, (0.04, 0.03), 5e-3))
                numbers.append(len(findings.lumps))
                several += any(lump.may_be_two for lump in findings.lumps)
                if len(findings.lumps) == 1 and findings.lumps[0].place_std is not None:
                    inside.append(within(findings.lumps[0], bump))
                    errors.append(1e3 * math.dist(findings.lumps[0].place, bump[:2]))
            print(
                f"noise {noise} contrast {contrast}: lumps {np.bincount(numbers)}, may be two {several}, "
                f"contrast, place, width within 2u {_share(inside)}, "
                f"error mm {np.median(errors):.2f} / {max(errors):.2f}",
                flush=True,
            )


def three(count: int) -> None:
    """Three lumps 22 mm apart or more in 66 mm x 54 mm with a pitch of 6 mm, few sites of which are background."""
    false = missed = certain = 0
    for seed in range(count):
        dice = np.random.default_rng([seed, 3])
        bumps: list[Bump] = []
        while len(bumps) < 3:
            place = dice.uniform([-28e-3, -22e-3], [28e-3, 22e-3])
            if all(math.dist(place, b[:2]) > 22e-3 for b in bumps):
                bumps.append(
                    (*place.tolist(), float(dice.uniform(0.15, 0.6)), float(dice.uniform(10e-3, 16e-3) / FWHM))
                )
        findings = find_lumps(field(dice, bumps, 0.006, (0.066, 0.054), 6e-3))
        wrong = [lump for lump in findings.lumps if all(math.dist(lump.place, b[:2]) > MATCH_DISTANCE for b in bumps)]
        lost = sum(all(math.dist(lump.place, b[:2]) > MATCH_DISTANCE for lump in findings.lumps) for b in bumps)
        false, missed = false + bool(wrong), missed + lost
        certain += any(lump.p < 1e-3 for lump in wrong)
        if wrong or lost:
            print(seed, bumps, [row(lump) for lump in findings.lumps], flush=True)
    print(
        f"{count} fields of three lumps: {false} with a false one, {certain} with one of p < 1e-3, "
        f"{missed} of {3 * count} missed"
    )


def breast(count: int, first: int = 1) -> None:
    """Runs of pipelines/breast.toml with other seeds, by the command line: its lumps that are named, and false ones."""
    palpate = Path(sys.executable).with_name("palpate")
    inclusions = load_pipeline(BREAST).devices["rig"].specimen.inclusions  # type: ignore[attr-defined]
    true_places = np.array([inclusion.place for inclusion in inclusions])
    missed = false = within_2u = 0
    errors: list[float] = []
    for seed in range(first, first + count):
        with tempfile.TemporaryDirectory() as folder:
            run = [palpate, "run", BREAST, "--set", f"run.seed={seed}", "--out", f"{folder}/run"]
            subprocess.run(run, check=True, capture_output=True)
            answer = subprocess.run(
                [palpate, "map", "lumps", f"{folder}/run", "--json"], check=True, capture_output=True
            )
        lumps = json.loads(answer.stdout)["lumps"]
        places = np.array([(lump["x"], lump["y"]) for lump in lumps]).reshape(-1, 2)
        stds = np.array([lump["place_std"] for lump in lumps]).reshape(-1, 2)
        distance = np.linalg.norm(places[:, None] - true_places, axis=2)
        if len(lumps):
            false += int((distance.min(axis=1) > MATCH_DISTANCE).sum())
        for column, true_place in zip(distance.T, true_places, strict=True):
            if not len(column) or column.min() > MATCH_DISTANCE:
                missed += 1
                continue
            nearest = int(np.argmin(column))
            errors.append(1e3 * float(column[nearest]))
            within_2u += int((np.abs(places[nearest] - true_place) < 2 * stds[nearest]).sum())
        print(seed, np.round(1e3 * places, 1).tolist(), [f"{lump['p']:.1g}" for lump in lumps], flush=True)
    print(
        f"{count} runs: {false} false lumps, {missed} of {count * len(true_places)} missed; error mm "
        f"{np.median(errors):.2f} / {max(errors):.2f}, {within_2u} of {2 * len(errors)} coordinates within 2u"
    )


def narrow(count: int) -> None:
    """Cells on one lump in maps of 40 mm x 30 mm, pitch 5 mm: within 2u, by the field alone and with bodies."""
    for width, contrast in product((4e-3, 6e-3, 8e-3, 10e-3), (0.3, 1.0)):
        on_lump: dict[str, list[float]] = {"field alone": [], "with bodies": []}
        for seed in range(count):
            dice = np.random.default_rng([seed, int(1e4 * width)])
            place = dice.uniform([-14e-3, -9e-3], [14e-3, 9e-3])
            sites = field(dice, [(*place, contrast, width / FWHM)], 0.005, (0.04, 0.03), 5e-3)
            for shares, fit in zip(on_lump.values(), (None, find_lumps(sites).fit), strict=True):
                made = make_map(sites, fit=fit)
                x, y = np.meshgrid(made.x, made.y)
                shape = np.exp(-0.5 * ((x - place[0]) ** 2 + (y - place[1]) ** 2) / (width / FWHM) ** 2)
                inside = np.abs(made.value - 112e3 * (1 + contrast * shape)) < 2 * made.std
                shares.append(float(inside[made.covered & (shape > 0.5)].mean()))
        means = {name: round(float(np.mean(shares)), 2) for name, shares in on_lump.items()}
        print(f"width {1e3 * width:g} mm, contrast {contrast}: {means}", flush=True)


def speed(count: int) -> None:
    """Processor seconds of fields of 1000 sites with three lumps."""
    bumps: list[Bump] = [(-0.05, -0.02, 0.3, 4e-3), (0.04, 0.03, 0.5, 5e-3), (0.052, 0.03, 0.5, 4e-3)]
    for seed in range(count):
        sites = field(np.random.default_rng(seed), bumps, 0.006, (0.195, 0.12), 5e-3)
        begin = time.process_time()
        findings = find_lumps(sites)
        print(f"{len(sites)} sites, {len(findings.lumps)} lumps: {time.process_time() - begin:.2f} s", flush=True)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["pairs", "one", "three", "narrow", "speed", "breast"])
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--first", type=int, default=1, help="seed, of breast")
    given = parser.parse_args()
    if given.what == "breast":
        breast(given.count, given.first)
        return
    {"pairs": pairs, "one": one, "three": three, "narrow": narrow, "speed": speed}[given.what](given.count)


if __name__ == "__main__":
    main()
