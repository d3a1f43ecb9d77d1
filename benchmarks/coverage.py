"""Coverage: how often intervals of 68 and 95 % hold the truth, over palpations drawn at random.

Run: PALPATE_KERNEL=vm python benchmarks/coverage.py [DRAWS] [--out FILE.csv] [--estimators a,b] [--first N]. Every
draw has a tip of its own, so that the virtual machine, which compiles nothing, is three times as fast. E from 1 kPa to
1.5 MPa, R from 1 to 20 mm (both log-uniform), five tips, 0.5 to 5 Hz, eta/G from 1 to 15 ms, at most 40 N; radius,
Poisson's ratio, mass,
timing and the sensor's offset are drawn by the uncertainties that are declared. Forces are written out here: nothing of
the product makes the records. One row a track and draw is appended to the file as it is found; the same command goes on
where it was stopped. Draw i is the same whoever makes it.

The tables count what is not flagged doubtful or invalid: coverage by cell of stiffness and by tip, with the exact
binomial p of each (Holm over all; the level is 99.9 %), the share that is flagged among those whose Cramer-Rao bounds
of both values are below 20 %, and the mean error in per cent with its standard uncertainty. Every record is clean, so
that the p of the lack-of-fit test should be below 1e-3 in one of a thousand at most.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ContactModel, Estimator, Floats, Indenter, Problem, Samples
from palpate.alignment_report import Tare
from palpate.registry import Registry, load
from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.result import TrackRecord, TrackResult, track_result
from palpate_engine.result.diagnoses import Diagnosable, RunEvidence, apply_diagnoses
from palpate_engine.track_name import TrackName
from palpate_filters import KinematicFilter, KinematicSmoother
from palpate_fits import CasadiFit
from palpate_models import Cone, DimensionalityReduction, ExactSphere, Flat, Power, Sphere

RATE = 500.0  # [Hz]
AIR, APPROACH, LASTS = 1.0, 1.0, 10.0  # [s]
FORCE, POSITION, VELOCITY = 0.05, 5e-6, 0.67e-3  # [N], [m], [m/s] noise
MASS, RADIUS, NU, LATE = 0.05, 0.005, 0.005, 1e-4  # relative, relative, absolute, [s]: declared uncertainties
MOST = 40.0  # [N]
LEVEL = 1e-3
TELLING = 0.2  # a bound below this share of the value, for both values, says that the record determines them
STIFFNESS = (1e3, 1e4, 1e5, 4e5, 1.5e6)  # [Pa] edges of the cells
ESTIMATORS: dict[str, Estimator] = {
    "kinematic-ekf": KinematicFilter(),
    "smoother": KinematicSmoother(),
    "casadi-fit": CasadiFit(),
}
FIELDS = (
    "draw",
    "estimator",
    "parameter",
    "tip",
    "E",
    "R",
    "f",
    "truth",
    "value",
    "std",
    "combined",
    "bound",
    "p",
    "flags",
)


@dataclass(frozen=True)
class Draw:
    """A palpation as it really is."""

    number: int
    tip: str
    elasticity: float  # [Pa]
    viscosity: float  # [Pa s]
    radius: float  # [m]
    nu: float
    mass: float  # [kg]
    late: float  # [s] of the force
    depth: float  # [m] mean
    amplitude: float  # [m]
    frequency: float  # [Hz]
    phase: float  # [rad]


TIPS = ("sphere", "exact-sphere", "flat", "cone", "quartic")
CONE = np.radians(30.0)  # to the surface
NOMINAL_NU, NOMINAL_MASS = 0.48, 0.14


def shape(tip: str, radius: float, d: Floats) -> tuple[Floats, Floats]:
    """Contact radius a(d) and area A(d) of the reduced profile (PHYSICS: MDR; Popov and Hess 2015, table 2.1)."""
    match tip:
        case "sphere":
            return np.sqrt(radius * d), 2 / 3 * np.sqrt(radius) * d**1.5
        case "flat":
            return radius * (d > 0), radius * d
        case "cone":
            a = 2 * d / (np.pi * np.tan(CONE))
            return a, a * d / 2
        case "quartic":  # c r^4 with the depth of a sphere at r = R/2; k_4 = 8/3
            c = 8 / 3 * quartic(radius)
            a = (d / c) ** 0.25
            return a, 0.8 * a * d
        case _:
            grid = radius * np.linspace(0.0, 0.9999, 20_000)
            depth = grid / 2 * np.log((radius + grid) / (radius - grid))
            a = np.interp(d, depth, grid)
            return a, (a**2 + radius**2) / 4 * np.log((radius + a) / (radius - a)) - a * radius / 2


def quartic(radius: float) -> float:
    """c [m^-3] of c r^4, which is as high as a sphere's paraboloid at half its radius."""
    return (radius / 8) / (radius / 2) ** 4


def model_of(draw: Draw, radius: float) -> ContactModel:
    """What the estimators are given."""
    tips: dict[str, Indenter] = {
        "sphere": Sphere(radius=radius),
        "exact-sphere": ExactSphere(radius=radius),
        "flat": Flat(radius=radius),
        "cone": Cone(angle=float(CONE)),
        "quartic": Power(exponent=4.0, coefficient=quartic(radius)),
    }
    return DimensionalityReduction(indenter=tips[draw.tip], poisson=NOMINAL_NU, thickness="half-space")


def drawn(number: int) -> tuple[Draw, float]:
    """A draw, and the radius that is believed."""
    random = np.random.default_rng([7, number])
    tip = TIPS[int(random.integers(len(TIPS)))]
    elasticity = float(np.exp(random.uniform(np.log(1e3), np.log(1.5e6))))
    believed = float(np.exp(random.uniform(np.log(1e-3), np.log(20e-3))))
    frequency = float(np.exp(random.uniform(np.log(0.5), np.log(5.0))))
    viscosity = elasticity / 3 * float(random.uniform(1e-3, 15e-3))
    radius = believed * (1 + RADIUS * float(random.standard_normal())) if tip not in ("cone", "quartic") else believed
    nu = NOMINAL_NU + NU * float(random.standard_normal())
    mass = NOMINAL_MASS * (1 + MASS * float(random.standard_normal()))
    late = LATE * float(random.standard_normal())
    depth = min(4e-3, 0.6 * believed)
    while 2 * elasticity / (1 - nu**2) * float(shape(tip, radius, np.array([1.25 * depth]))[1][0]) > MOST:
        depth *= 0.9
    amplitude = depth * float(random.uniform(0.15, 0.25))
    phase = float(random.uniform(0, 2 * np.pi))
    return Draw(
        number, tip, elasticity, viscosity, radius, nu, mass, late, depth, amplitude, frequency, phase
    ), believed


def motion(draw: Draw, time: Floats) -> tuple[Floats, Floats, Floats]:
    """Depth, its rate and acceleration: at rest 2 mm above, down along a smooth step, then a sine."""
    start = draw.depth + draw.amplitude * np.sin(draw.phase)
    s, way = np.clip((time - AIR) / APPROACH, 0.0, 1.0), start + 2e-3
    depth = -2e-3 + way * s**3 * (10 - 15 * s + 6 * s**2)
    rate = way / APPROACH * 30 * s**2 * (1 - s) ** 2
    acceleration = way / APPROACH**2 * 60 * s * (1 - s) * (1 - 2 * s)
    moving, w = time >= AIR + APPROACH, 2 * np.pi * draw.frequency
    angle = (w * (time - AIR - APPROACH) + draw.phase)[moving]
    depth[moving] = draw.depth + draw.amplitude * np.sin(angle)
    rate[moving] = draw.amplitude * w * np.cos(angle)
    acceleration[moving] = -draw.amplitude * w**2 * np.sin(angle)
    return depth, rate, acceleration


def force(draw: Draw, time: Floats) -> Floats:
    """What the sensor feels [N]."""
    depth, rate, acceleration = motion(draw, time)
    a, area = shape(draw.tip, draw.radius, np.maximum(depth, 0.0))
    contact = 2 * draw.elasticity / (1 - draw.nu**2) * area + 4 * draw.viscosity / (1 - draw.nu) * a * rate * (
        depth > 0
    )
    return np.asarray(contact + draw.mass * acceleration)


def record(draw: Draw) -> tuple[Samples, AlignmentReport]:
    """Samples, tared in the air before contact, and what an alignment says of them."""
    random = np.random.default_rng([8, draw.number])
    time = np.arange(round((AIR + APPROACH + LASTS) * RATE)) / RATE
    n, air = len(time), round(AIR * RATE)
    depth, rate, _ = motion(draw, time)
    felt = force(draw, time - draw.late) + FORCE * random.standard_normal(n) + 0.3 * random.standard_normal()
    offset, noise = float(felt[:air].mean()), float(felt[:air].std(ddof=1))
    begun = int(np.argmax(depth > 0))
    contact = np.arange(n) >= begun
    samples = Samples(
        np.rint(time * 1e9).astype(np.int64), time, np.diff(time, prepend=0.0), felt - offset,
        -depth + POSITION * random.standard_normal(n), -rate + VELOCITY * random.standard_normal(n), contact,
        contact & (time >= AIR + APPROACH),
    )  # fmt: skip
    tare = Tare(offset, noise / np.sqrt(air), noise, AIR)
    touch = (float(time[begun]), 0.0)
    return samples, AlignmentReport({}, tare, 0.25, touch, 1, None, n, 0, 0, float(time[-1]), None, True)


def results(
    registry: Registry, model: ContactModel, mass: float, samples: Samples, report: AlignmentReport,
    estimators: Mapping[str, Estimator], declared: Mapping[str, Any],
) -> dict[str, TrackResult]:  # fmt: skip
    """What each estimator makes of a record, judged as in a run."""
    table = {"force": {"channel": "rig.f", "uncertainty": LATE}, "position": "rig.z", "tip_mass": mass}
    settings = AlignmentSettings.model_validate(table)
    whole = {}
    for name, estimator in estimators.items():
        track = TrackName("dr", name)
        kept = TrackRecord(3.0 if estimator.online else np.inf)
        kept.add(samples, estimator.start(Problem(model, mass, LATE, AIR)).run(samples), 0.0)
        found = track_result(track, model, kept, report, settings, 1.0, estimator.online)
        whole[name] = Diagnosable(model, estimator, kept, found)
    judged = apply_diagnoses(whole, registry.diagnoses, RunEvidence(settings, report, 1.0, declared))
    return {name: found.judged(registry, ()) for name, found in judged.items()}


def bounds(draw: Draw) -> Floats:
    """Cramer-Rao bounds of E and eta, relative, for a known motion and an unknown surface."""
    time = np.arange(round(AIR + APPROACH) * RATE, (AIR + APPROACH + LASTS) * RATE) / RATE
    depth, rate, _ = motion(draw, time)

    def felt(e: float, v: float, deeper: float) -> Floats:
        a, area = shape(draw.tip, draw.radius, np.maximum(depth + deeper, 0.0))
        return np.asarray(
            2 * e * draw.elasticity / (1 - draw.nu**2) * area + 4 * v * draw.viscosity / (1 - draw.nu) * a * rate
        )

    columns = [
        felt(1.0, 0.0, 0.0), felt(0.0, 1.0, 0.0), (felt(1.0, 1.0, 1e-6) - felt(1.0, 1.0, -1e-6)) / 2e-6 * 1e-3
    ]  # fmt: skip
    slope = columns[2] / 1e-3
    design = np.column_stack(columns) / np.hypot(FORCE, slope * POSITION)[:, None]
    return np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))[:2]


def rows_of(number: int, registry: Registry, estimators: Mapping[str, Estimator]) -> Iterator[dict[str, Any]]:
    """Rows of one draw."""
    draw, believed = drawn(number)
    samples, report = record(draw)
    found = results(registry, model_of(draw, believed), NOMINAL_MASS, samples, report, estimators, {"poisson": NU})
    limits = bounds(draw)
    truth = {"elasticity": draw.elasticity, "viscosity": draw.viscosity}
    for name, result in found.items():
        for i, (parameter, true) in enumerate(truth.items()):
            value = result.parameters[parameter]
            severe = [
                flag.code
                for flag in result.flags
                if value.verdict in ("doubtful", "invalid") and flag.severity != "note" and flag.code != "undetermined"
            ]
            numbers = (
                draw.elasticity,
                believed,
                draw.frequency,
                true,
                value.value,
                value.std,
                value.combined,
                limits[i],
                result.diagnoses.get("lack-of-fit", {}).get("p", np.nan),
            )
            yield dict(zip(FIELDS, (number, name, parameter, draw.tip, *numbers, " ".join(severe)), strict=True))


def main() -> None:
    """Draws what is not there yet, and shows all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("draws", type=int, nargs="?", default=200)
    parser.add_argument("--out", type=Path, default=Path("coverage.csv"))
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--estimators", default=",".join(ESTIMATORS))
    chosen = parser.parse_args()
    estimators = {name: ESTIMATORS[name] for name in chosen.estimators.split(",")}
    done = {int(row["draw"]) for row in csv.DictReader(chosen.out.open())} if chosen.out.exists() else set()
    registry, new = load(), not chosen.out.exists()
    with chosen.out.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if new:
            writer.writeheader()
        for number in range(chosen.first, chosen.first + chosen.draws):
            if number in done:
                continue
            writer.writerows(rows_of(number, registry, estimators))
            file.flush()
            if sys.stderr.isatty():
                print(f"\r{number + 1 - chosen.first} of {chosen.draws}", end="", file=sys.stderr)
    show(list(csv.DictReader(chosen.out.open())))


def show(rows: list[dict[str, str]]) -> None:
    """The tables."""
    cells = [cell for cell in _cells(rows) if len(cell[1])]
    judged = [(label, of, _p(of, 1.0, 0.6827), _p(of, 1.96, 0.95)) for label, of in cells]
    order = sorted(p for _, _, *pair in judged for p in pair)
    limit = max((p for i, p in enumerate(order) if p * (len(order) - i) < LEVEL), default=-1.0)
    told = {row["draw"] for row in rows} - {row["draw"] for row in rows if float(row["bound"]) >= TELLING}
    print(f"{len({row['draw'] for row in rows})} draws, of which {len(told)} can be determined")
    print(f"{'':42}{'n':>6}{'flagged %':>11}{'bias %':>16}{'68 %':>8}{'95 %':>8}")
    for label, of, low, high in judged:
        telling = [row for row in of if row["draw"] in told]
        flagged = 100 * np.mean([bool(row["flags"]) for row in telling]) if telling else np.nan
        errors = np.array([100 * (float(row["value"]) / float(row["truth"]) - 1) for row in of if not row["flags"]])
        bias = f"{errors.mean():+.2f} +- {errors.std() / np.sqrt(len(errors)):.2f}" if len(errors) else ""
        marks = ["!" if p <= limit else " " for p in (low, high)]
        covered = [100 * np.mean(_within(of, k)) if len(errors) else np.nan for k in (1.0, 1.96)]
        ends = "".join(f"{share:7.1f}{mark}" for share, mark in zip(covered, marks, strict=True))
        print(f"{label:42}{len(errors):6}{flagged:11.1f}{bias:>16}{ends}")
    tested = [row for row in rows if row["parameter"] == "elasticity" and np.isfinite(float(row["p"]))]
    for name in sorted({row["estimator"] for row in tested}):
        p = [float(row["p"]) for row in tested if row["estimator"] == name]
        print(f"lack of fit, {name}: {sum(one < LEVEL for one in p)} of {len(p)} clean records below {LEVEL:g}")
    print("! rejected at 99.9 % (exact binomial, Holm)")


def _cells(rows: list[dict[str, str]]) -> Iterator[tuple[str, list[dict[str, str]]]]:
    kinds = sorted({(row["estimator"], row["parameter"]) for row in rows})
    for estimator, parameter in kinds:
        of = [row for row in rows if (row["estimator"], row["parameter"]) == (estimator, parameter)]
        yield f"{estimator} {parameter}", of
        for low, high in pairwise(STIFFNESS):
            cell = [row for row in of if low <= float(row["E"]) < high]
            yield f"  {low / 1e3:g} to {high / 1e3:g} kPa", cell
        for tip in TIPS:
            yield f"  {tip}", [row for row in of if row["tip"] == tip]


def _within(of: list[dict[str, str]], k: float) -> list[bool]:
    return [
        abs(float(row["value"]) - float(row["truth"])) <= k * float(row["combined"]) for row in of if not row["flags"]
    ]


def _p(of: list[dict[str, str]], k: float, level: float) -> float:
    """Two-sided exact binomial p of a cell's coverage."""
    from scipy.stats import binomtest

    inside = _within(of, k)
    return float(binomtest(sum(inside), len(inside), level).pvalue) if inside else 1.0


if __name__ == "__main__":
    main()
