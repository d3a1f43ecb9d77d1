"""Recordings of real material, judged: E and viscosity with their ±, verdicts, and how far two tips and repeats agree.

``python benchmarks/real_records.py [FOLDER]`` prints the tables of ``benchmarks/results/real-records.md``. FOLDER, or
``$PALPATE_SHARED/data``, holds public recordings that are not part of this repository: point palpations of one silicone
by two tips (``ur3e-bota-2024``), immediate repeats of one press (``repeats``), presses of foam (``foam``). Without them
it says so and ends with 0. Everything that is known of the rigs is stated; two values agree where
E_n = |a - b| / (2 hypot(u_a, u_b)) is at most 1 (ISO 13528).
"""

from __future__ import annotations

import gzip
import math
import os
import statistics
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import palpate
from palpate_models import DimensionalityReduction, ExactSphere, Flat, Sphere

REFERENCE = 112.5e3  # [Pa] of the silicone of two tips, by a dynamometer
LAYER = {"law": "dimitriadis", "height": "22 mm", "bonded": False}  # on a plate that does not hold the specimen
# Radius of the ball [m], lateness of motion and of force, by name of a point log.
POINTS = {
    "d5mm_soft": (2.5e-3, "0 ms", "12 ms"),
    "d10mm_soft": (5e-3, "22 ms", "0 ms"),
    "d10mm_sphere": (5e-3, "22 ms", "0 ms"),
}
ZEROED = {"tare": "0 N", "alignment": {"tare_uncertainty": "50 mN"}}  # by the robot, before the record begins
REPEATS = tuple(f"test_soft_{i}" for i in (1, 2, 3))
FOAMS = tuple(f"{name}_{i}" for name in ("flat_grey", "sphere_white") for i in (1, 2, 3, 4))


@dataclass(frozen=True)
class Judgement:
    """The result of one record: values with standard uncertainties, verdicts and findings [SI]."""

    name: str
    values: dict[str, tuple[float, float, str]]  # value, u, verdict
    findings: list[str]
    prediction: float  # error of the force that is predicted from the rest of the record, in parts of the force

    def row(self) -> str:
        """A line of the table in Markdown."""
        cells = []
        for name, factor in (("elasticity", 1e-3), ("viscosity", 1.0)):
            value, u, verdict = self.values[name]
            share = 100.0 * u / abs(value) if value else math.nan
            cells.append(f"{factor * value:.4g} ± {factor * u:.2g} ({share:.1f} %) | {verdict}")
        predicted = "-" if math.isnan(self.prediction) else f"{100 * self.prediction:.1f} %"
        return f"| {self.name} | {' | '.join(cells)} | {', '.join(self.findings) or '-'} | {predicted} |"


def judge(name: str, record: Any, model: Any) -> Judgement:
    """Fit a record and read what the product says of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        track = palpate.fit(record, model=model).track.document
    values = {}
    for quantity in ("elasticity", "viscosity"):
        value = track["parameters"][quantity]
        number = value["value"] if value["value"] is not None else value.get("estimate")
        u = value["combined"]
        values[quantity] = (
            math.nan if number is None else number,
            math.inf if u is None else u,
            value["verdict"],
        )
    findings = [flag["code"] for flag in track["flags"] if flag["severity"] in ("doubtful", "invalid")]
    prediction = track.get("diagnoses", {}).get("model-discrepancy", {}).get("prediction", {}).get("error", math.nan)
    return Judgement(name, values, findings, prediction)


def point(folder: Path, name: str) -> Judgement:
    """A point palpation: a ball on 22 mm of silicone, 2 Hz, 10 s."""
    radius, motion, force = POINTS[name]
    table = columns(folder / "ur3e-bota-2024" / f"{name}.csv.gz", 0)
    record = palpate.record(
        rate="500 Hz", height=1e-3 * table[:, 0], velocity=-1e-3 * table[:, 3], force=table[:, 4],
        delay={"height": motion, "velocity": motion, "force": force}, timing="0.5 ms", tip_mass="140 g", **ZEROED,
    )  # fmt: skip
    return judge(name, record, DimensionalityReduction(indenter=ExactSphere(radius=radius), thickness=LAYER))


def press(path: Path, tip: Any, zero: dict[str, Any]) -> Judgement:
    """One press of a thick specimen; `zero` says where the force is zero."""
    table = columns(path, 1)
    record = palpate.record(
        time=table[:, 0], force=table[:, 1], height=1e-3 * table[:, 2], delay={"height": "0 ms", "force": "0 ms"},
        timing="0.5 ms", tip_mass="140 g", **zero,
    )  # fmt: skip
    model = DimensionalityReduction(indenter=tip, thickness="half-space")
    return judge(path.name.removesuffix(".csv.gz"), record, model)


def columns(path: Path, header: int) -> Any:
    """Numbers (n, m) of a packed table behind some lines of header."""
    with gzip.open(path) as file:
        return np.loadtxt(file, delimiter=",", skiprows=header)


def normalised_error(one: tuple[float, float, str], other: tuple[float, float, str]) -> float:
    """E_n of two values with their standard uncertainties; at most 1 where they agree."""
    return abs(one[0] - other[0]) / (2.0 * math.hypot(one[1], other[1]))


def table(title: str, rows: Sequence[Judgement]) -> None:
    """Print one table and what its records have in common."""
    print(f"\n## {title}\n\n| record | E kPa | verdict | eta Pa s | verdict | findings | predicted within |")
    print("|---|---|---|---|---|---|---|")
    for row in rows:
        print(row.row())
    values = [row.values["elasticity"] for row in rows]
    median = statistics.median(u / abs(value) if value else math.inf for value, u, _ in values)
    good = sum(verdict == "good" for *_, verdict in values)
    numbers = sum(math.isfinite(u) and verdict != "not determined" for _, u, verdict in values)
    print(f"\nE: {good} of {len(rows)} good, {numbers} with a number; median u {100 * median:.1f} %")


def agreement(rows: Sequence[Judgement]) -> None:
    """Print the largest E_n of all pairs of some records."""
    for quantity in ("elasticity", "viscosity"):
        pairs = combinations((row.values[quantity] for row in rows), 2)
        print(f"{quantity}: largest E_n of pairs {max(normalised_error(a, b) for a, b in pairs):.2f}")


def main() -> None:
    """Print the tables, or that the recordings are not here."""
    shared = Path(os.environ.get("PALPATE_SHARED", Path(__file__).parents[2] / "shared"))
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else shared / "data"
    if not (folder / "repeats").is_dir():
        print(f"{folder} has no recordings of real material (ur3e-bota-2024, repeats, foam): nothing is judged")
        return
    points = [point(folder, name) for name in POINTS]
    table("Point palpations, base stated as sliding, a ball", points)
    agreement(points[:2])
    for row in points[:2]:
        print(f"{row.name}: {100 * (row.values['elasticity'][0] / REFERENCE - 1):+.1f} % of the reference press")
    # 15 mm deep by a ball of 5 mm: beyond any law of a ball, and taken as the paraboloid that its sources take it for.
    repeats = [press(folder / "repeats" / f"{name}.csv.gz", Sphere(radius=5e-3), ZEROED) for name in REPEATS]
    table("Immediate repeats of one press", repeats)
    agreement(repeats)
    scatter = statistics.stdev(row.values["elasticity"][0] for row in repeats)
    mean = statistics.mean(row.values["elasticity"][0] for row in repeats)
    print(f"E of {len(repeats)} repeats scatters by {100 * scatter / mean:.2f} %")
    foams = []
    for name in FOAMS:
        tip = Flat(radius=1e-2) if name.startswith("flat") else ExactSphere(radius=1e-2)
        foams.append(press(folder / "foam" / f"{name}.csv.gz", tip, {"tare": "free-air"}))
    table("Presses of foam", foams)


if __name__ == "__main__":
    main()
