"""Coverage of values with a known bias, and of those corrected for it: the paper's filter, over palpations at random.

Run: python benchmarks/noise_bias.py [DRAWS] [--first N] [--out FILE.csv] [--start guess|fit]. Records are those of
coverage.py (forces written out there, nuisances drawn by their declared uncertainties) with a sphere of 5 mm, 100 to
300 kPa, 1.5 to 4 Hz, where the first order holds. One row a draw; the same command goes on where it was stopped. The
table counts every draw that has a corrected value, flagged or not: how often intervals of 68 and 95 % hold the truth
with the exact binomial p, the mean of what is stated over what is off (RMS), and how many carry the filter's distance.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from coverage import NOMINAL_MASS, NU, Draw, drawn, model_of, record, results
from palpate.registry import load
from palpate_filters import ExtendedKalmanFilter

RADIUS = 5e-3  # [m] believed
FIELDS = ("draw", "truth", "value", "combined", "corrected", "corrected_combined", "distance", "left", "f")


def palpation(number: int) -> Draw:
    """A draw of coverage.py, made one at which the bias is known."""
    draw, believed = drawn(number)
    random = np.random.default_rng([9, number])
    elasticity, frequency = float(random.uniform(1e5, 3e5)), float(random.uniform(1.5, 4.0))
    viscosity = elasticity / 3 * float(random.uniform(5e-3, 12e-3))
    radius = RADIUS * draw.radius / believed if draw.tip in ("sphere", "exact-sphere", "flat") else RADIUS
    amplitude = float(random.uniform(0.8e-3, 1.0e-3))
    return replace(
        draw, tip="sphere", elasticity=elasticity, viscosity=viscosity, radius=radius, frequency=frequency,
        depth=3e-3, amplitude=amplitude,
    )  # fmt: skip


def row(number: int, start: str) -> dict[str, float] | None:
    """What one draw says; None where it has no corrected value."""
    draw = palpation(number)
    samples, report = record(draw)
    estimators = {"ekf": ExtendedKalmanFilter(start_from=start)}  # type: ignore[arg-type]
    result = results(load(), model_of(draw, RADIUS), NOMINAL_MASS, samples, report, estimators, {"poisson": NU})["ekf"]
    found = result.parameters["viscosity"]
    corrected = found.corrected
    if corrected is None:
        return None
    distances = (found.budget.get("identifiability", 0.0), corrected.budget.get("identifiability", 0.0))
    numbers = (draw.viscosity, found.value, found.combined, corrected.value, corrected.combined, *distances)
    return dict(zip(FIELDS, (number, *numbers, draw.frequency), strict=True))


def table(rows: list[Mapping[str, float]]) -> str:
    """Coverage of both values."""
    from scipy.stats import binomtest

    lines = []
    for value, stated, distance in (("value", "combined", "distance"), ("corrected", "corrected_combined", "left")):
        off = np.array([one[value] - one["truth"] for one in rows])
        std = np.array([one[stated] for one in rows])
        shares = []
        for level, wide in ((0.6827, 1.0), (0.95, 1.96)):
            inside = int(np.count_nonzero(np.abs(off) < wide * std))
            p = float(binomtest(inside, len(rows), level).pvalue)
            shares.append(f"{inside} of {len(rows)} within {100 * level:.0f} % (p {p:.2g})")
        sharp = float(np.sqrt(np.mean(std**2) / np.mean(off**2)))
        counted = sum(one[distance] > 0 for one in rows)
        mean = float(np.mean(off / np.array([one["truth"] for one in rows])))
        lines.append(f"{value}: {'; '.join(shares)}; off {100 * mean:+.1f} %; u/rms {sharp:.2f}; distance in {counted}")
    return "\n".join(lines)


def main() -> None:
    """Draw, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("draws", nargs="?", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("noise_bias.csv"))
    parser.add_argument("--start", choices=("guess", "fit"), default="guess")
    chosen = parser.parse_args()
    done = set()
    if chosen.out.exists():
        with chosen.out.open() as file:
            done = {int(float(one["draw"])) for one in csv.DictReader(file)}
    with chosen.out.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if not done:
            writer.writeheader()
        for number in range(chosen.first, chosen.first + chosen.draws):
            found = None if number in done else row(number, chosen.start)
            if found is not None:
                writer.writerow(found)
                file.flush()
    with chosen.out.open() as file:
        rows = [{key: float(value) for key, value in one.items()} for one in csv.DictReader(file)]
    print(table(rows))


if __name__ == "__main__":
    main()
