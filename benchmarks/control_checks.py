"""Which check finds which mistake: checks on references, simulated with mistakes of growing size.

Run: python benchmarks/control_checks.py [--labs 100] [-o FILE.csv]: some ten minutes of processor time, on all cores.

Every laboratory has a tip whose radius is 0.5 % off (standard uncertainty), a specimen whose Poisson's ratio is up to
0.02 below 0.5, a reference whose value is off by its stated uncertainty (spring 0.5 %, specimen 1.3 %), and noise:
force 50 mN, position 5 um, velocity 0.67 mm/s. It stands in air for 1 s, presses, and oscillates at 1 Hz for 2 s. The
forces are written out here. Each run is estimated by `casadi-fit`; its combined uncertainty, and what of it differs
from run to run, are the shares of the value that `palpate.fit` states of one run of the check with its defaults. E_n is
that of `palpate calibrate control`.

Four checks: a spring of 3 N/mm; a sphere of 5 mm on the specimen (112.5 kPa, 362 Pa s) at 1 to 4 mm of depth; the
ratio of that and of the value at 0.3 to 1.5 mm, against what differs from run to run; a flat tip of 5 mm, at 0.3 to
1.5 mm. For each mistake the size from which on 95 of 100 laboratories find it (|E_n| > 1) is interpolated from runs
without it and runs with one size of it, and counted with as many laboratories of other seeds. "change" is what
Shewhart's chart finds in 95 of 100 after 25 checks without the mistake: 4.64 standard deviations of repeats of one
laboratory, by the same slope.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from palpate_control.control_limits import SHEWHART, normalised_error

RATE, AIR, APPROACH, LASTS, FREQUENCY = 200.0, 1.0, 0.5, 2.0, 1.0  # [Hz], [s], [s], [s], [Hz]
FORCE_STD, HEIGHT_STD, SPEED_STD = 0.05, 5e-6, 0.67e-3
RADIUS, ELASTICITY, VISCOSITY, SPRING = 5e-3, 112.5e3, 362.0, 3000.0
DEPTHS = {"spring": (1e-3, 4e-3), "deep": (1e-3, 4e-3), "shallow": (0.3e-3, 1.5e-3), "flat": (0.3e-3, 1.5e-3)}
REFERENCE = {"spring": 0.005, "deep": 0.013, "shallow": 0.013, "flat": 0.013}  # standard uncertainty, of the value
# To begin with, and the largest that is looked for; a compliance in m/N, a tare in N, the others relative or absolute.
SIZES = {"gain": 0.05, "height": 0.05, "radius": 0.1, "compliance": 1e-5, "poisson": -0.05, "tare": 0.1}
LARGEST = {"gain": 0.5, "height": 0.5, "radius": 1.0, "compliance": 1e-3, "poisson": 0.3, "tare": 1.5}
UNITS = {"gain": ("%", 100), "height": ("%", 100), "radius": ("%", 100), "poisson": ("", -1), "tare": ("N", 1)}
CHECKS = {"spring": ("spring",), "sphere": ("deep",), "two depths": ("deep", "shallow"), "flat": ("flat",)}
ANOTHER = {"sphere of 10 mm for one of 5 mm": ("sphere", 10e-3), "flat of 5 mm for the sphere": ("flat", 5e-3)}
START = -1e-3  # [m] depth at rest in the air
_LEAST = 1e-3  # relative shift that counts as any


@dataclass(frozen=True)
class Lab:
    """A palpation as it really is."""

    seed: int
    kind: str  # key of DEPTHS
    mistakes: dict[str, float] = field(default_factory=dict)  # sizes by name
    tip: tuple[str, float] | None = None  # another one than the pipeline states
    repeat: int = 0  # of the same laboratory: other noise


def true_force(lab: Lab, depth, rate, radius: float, poisson: float):
    """What presses the tip out [N]: a linear spring; Hertz and the flat punch, each with its viscous part."""
    deep = np.maximum(depth, 0.0)
    if lab.kind == "spring":
        return SPRING * deep
    shape = lab.tip[0] if lab.tip else "flat" if lab.kind == "flat" else "sphere"
    rate = np.where(depth > 0, rate, 0.0)
    if shape == "flat":
        elastic = 2 * ELASTICITY / (1 - poisson**2) * radius * deep
        return elastic + 4 * VISCOSITY / (1 - poisson) * radius * rate * (depth > 0)
    elastic = 4 / 3 * ELASTICITY / (1 - poisson**2) * np.sqrt(radius) * deep**1.5
    return elastic + 4 * VISCOSITY / (1 - poisson) * np.sqrt(radius * deep) * rate


def record_of(lab: Lab) -> tuple[np.ndarray, ...]:
    """Time [s], reading of the force [N], height [m] and velocity [m/s], as the rig has them."""
    of_lab = np.random.default_rng([lab.seed, 1])
    radius = RADIUS * (1 + 0.005 * of_lab.standard_normal() + lab.mistakes.get("radius", 0.0))
    poisson = 0.5 - 0.02 * of_lab.uniform() + lab.mistakes.get("poisson", 0.0)
    radius = lab.tip[1] if lab.tip else radius
    noise = np.random.default_rng([lab.seed, 2, lab.repeat, sum(lab.kind.encode())])
    time = np.arange(0.0, AIR + APPROACH + LASTS, 1 / RATE)
    low, high = DEPTHS[lab.kind]
    phase = 2 * np.pi * FREQUENCY * (time - AIR - APPROACH)
    middle, swing = (low + high) / 2, (high - low) / 2
    wave, speed = middle - swing * np.cos(phase), 2 * np.pi * FREQUENCY * swing * np.sin(phase)
    slope = (low - START) / APPROACH
    moving = np.where(time < AIR + APPROACH, START + slope * np.maximum(time - AIR, 0.0), wave)
    rate = np.where(time < AIR + APPROACH, np.where(time < AIR, 0.0, slope), speed)
    depth, given = moving, lab.mistakes.get("compliance", 0.0)
    force = true_force(lab, depth, rate, radius, poisson)
    for _ in range(60 if given else 0):  # the tip gives way by F/k
        depth = 0.5 * depth + 0.5 * (moving - given * force)
        force = true_force(lab, depth, np.gradient(depth, time), radius, poisson)
    reading = force * (1 + lab.mistakes.get("gain", 0.0)) + lab.mistakes.get("tare", 0.0) * (time > AIR)
    scale = 1 + lab.mistakes.get("height", 0.0)
    reading = reading + noise.normal(0.0, FORCE_STD, len(time))
    height = -scale * moving + noise.normal(0.0, HEIGHT_STD, len(time))
    return time, reading, height, -scale * rate + noise.normal(0.0, SPEED_STD, len(time))


def model_of(lab: Lab):
    """The contact model that the pipeline states."""
    from palpate_models import DimensionalityReduction, Flat, KelvinVoigt, Sphere

    if lab.kind == "spring":
        return KelvinVoigt()
    tip = Flat(radius=RADIUS) if lab.kind == "flat" else Sphere(radius=RADIUS)
    return DimensionalityReduction(indenter=tip, thickness="half-space")


def value_of(lab: Lab) -> float:
    """Elasticity or stiffness as `casadi-fit` estimates it from the oscillation [SI], the air subtracted."""
    from palpate import Problem, Samples
    from palpate_fits import CasadiFit

    time, reading, height, velocity = record_of(lab)
    rows = time >= AIR + APPROACH
    always = np.ones(int(rows.sum()), bool)
    tared = (reading - reading[time < 0.9 * AIR].mean())[rows]
    stamps, interval = np.rint(time[rows] * 1e9).astype(np.int64), np.diff(time[rows], prepend=time[rows][0])
    samples = Samples(stamps, time[rows], interval, tared, height[rows], velocity[rows], always, always)
    return float(CasadiFit().start(Problem(model_of(lab), 0.0)).run(samples).values[-1][0])


def whole_fit(lab: Lab) -> tuple[float, float, bool]:
    """Of a run with all its diagnoses: combined standard uncertainty and that of a repeat, as shares; any doubt."""
    import palpate

    time, reading, height, velocity = record_of(lab)
    record = palpate.record(time=time, force=reading, height=height, velocity=velocity, timing="0.1 ms", tip_mass=0)
    fit = palpate.fit(record, model=model_of(lab))
    value = fit.parameters["stiffness" if lab.kind == "spring" else "elasticity"]
    doubtful = any(flag.severity in ("doubtful", "invalid") for flag in fit.flags)
    repeat = math.hypot(value.std, value.budget.get("tare", 0.0))
    return value.combined / value.value, repeat / value.value, doubtful


def doubted(lab: Lab) -> bool:
    """Whether a run's own flags doubt it."""
    return whole_fit(lab)[2]


def normalised(check: str, values: Sequence[float], shares: Sequence[tuple[float, float, bool]], seed: int) -> float:
    """E_n of a check; of two depths that of their ratio, against what differs from run to run."""
    if check == "two depths":
        return math.log(values[0] / values[1]) / (2 * math.hypot(shares[0][1], shares[1][1]))
    kind = CHECKS[check][0]
    truth = SPRING if kind == "spring" else ELASTICITY
    off = REFERENCE[kind] * np.random.default_rng([seed, 3]).standard_normal()
    return normalised_error(values[0], shares[0][0] * values[0], truth * (1 + off), truth * REFERENCE[kind])


class Study:
    """Runs of laboratories, each done once."""

    def __init__(self, labs: int, pool: ProcessPoolExecutor) -> None:
        self.labs, self.pool, self.fits = labs, pool, 0
        kinds = dict.fromkeys(kind for of_check in CHECKS.values() for kind in of_check)
        self.shares = dict(zip(kinds, pool.map(whole_fit, [Lab(0, kind) for kind in kinds]), strict=True))

    def values(self, check: str, seeds: Sequence[int], **changes) -> list[list[float]]:
        """The values of a check in each laboratory."""
        wanted = [replace(Lab(seed, kind), **changes) for seed in seeds for kind in CHECKS[check]]
        self.fits += len(wanted)
        found = list(self.pool.map(value_of, wanted, chunksize=5))
        step = len(CHECKS[check])
        return [found[i : i + step] for i in range(0, len(found), step)]

    def errors(self, check: str, seeds: Sequence[int], **changes) -> np.ndarray:
        """E_n of a check in each laboratory."""
        found, shares = self.values(check, seeds, **changes), [self.shares[kind] for kind in CHECKS[check]]
        return np.array([normalised(check, values, shares, seed) for values, seed in zip(found, seeds, strict=True)])

    def slope(self, check: str, mistake: str) -> float:
        """Relative shift of a check's statistic by one size of a mistake, as one laboratory has it."""
        shifted, clean = (self.values(check, [0], mistakes=mistakes)[0] for mistakes in ({mistake: SIZES[mistake]}, {}))
        logs = [math.log(a / b) for a, b in zip(shifted, clean, strict=True)]
        return (logs[0] - logs[1] if check == "two depths" else logs[0]) / SIZES[mistake]


def size_found(study: Study, check: str, mistake: str, clean: np.ndarray) -> tuple[float, int] | None:
    """From which size on 95 of 100 laboratories find a mistake, and how many others do; None where none ever will."""
    slope = study.slope(check, mistake)
    if abs(slope * SIZES[mistake]) < _LEAST:
        return None
    seeds, others = range(len(clean)), range(1000, 1000 + study.labs)
    size, step = SIZES[mistake], study.errors(check, [0], mistakes={mistake: SIZES[mistake]})[0] - clean[0]
    for _ in range(2):  # the second time near the size, where all is linear
        size = size * 2.0 / abs(step)
        if abs(size) > 2 * LARGEST[mistake]:
            return None
        with_it = study.errors(check, seeds, mistakes={mistake: size})
        step = float(np.median(with_it - clean))
        if 1.2 < abs(step) < 4:
            break
    up = np.sign(step)
    shares = np.sort(np.maximum(1.0 - up * clean, 0.0) / (up * (with_it - clean)))
    needed = float(size * shares[math.ceil(0.95 * len(shares)) - 1])
    if not abs(needed) <= LARGEST[mistake]:
        return None
    count = int((np.abs(study.errors(check, others, mistakes={mistake: needed})) > 1).sum())
    return needed, count


def text_of(mistake: str, size: float) -> str:
    """A size as people state it."""
    if mistake == "compliance":
        return f"{1e-3 / size:.2g} N/mm"
    unit, factor = UNITS[mistake]
    return f"{factor * size:.2g} {unit}".strip()


def main() -> None:
    """Print both tables."""
    options = argparse.ArgumentParser()
    options.add_argument("--labs", type=int, default=100)
    options.add_argument("-o", "--out", type=Path)
    asked = options.parse_args()
    warnings.simplefilter("ignore")
    rows, slopes = [], {}
    with ProcessPoolExecutor() as pool:
        study = Study(asked.labs, pool)
        seeds = range(asked.labs)
        for check in CHECKS:
            clean = study.errors(check, seeds)
            repeats = [study.values(check, [0], repeat=i)[0] for i in range(1, 26)]
            logs = [math.log(v[0] / (v[1] if check == "two depths" else 1.0)) for v in repeats]
            scatter = float(np.std(logs, ddof=1))
            alarms = int((np.abs(clean) > 1).sum())
            print(
                f"{check}: {alarms} of {len(seeds)} beyond 1 by nothing; repeats scatter {100 * scatter:.2g} %",
                flush=True,
            )
            for mistake in SIZES:
                slopes[check, mistake] = study.slope(check, mistake)
                found = size_found(study, check, mistake, clean)
                change = (SHEWHART + 1.645) * scatter / abs(slopes[check, mistake]) if found else None
                rows.append((check, mistake, found, change))
                shown = "never" if found is None else f"{text_of(mistake, found[0])} ({found[1]} of {asked.labs})"
                later = "" if change is None else text_of(mistake, math.copysign(change, SIZES[mistake]))
                print(f"  {mistake}: {shown}; change {later}", flush=True)
            for name, tip in ANOTHER.items() if check in ("sphere", "two depths") else ():
                count = int((np.abs(study.errors(check, seeds, tip=tip)) > 1).sum())
                doubtful = sum(pool.map(doubted, [Lab(seed, "deep", tip=tip) for seed in range(10)]))
                print(
                    f"  {name}: {count} of {len(seeds)}; {doubtful} of 10 runs doubtful by their own flags", flush=True
                )
    alike(slopes)
    print(f"{study.fits} fits")
    if asked.out:
        with asked.out.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("check", "mistake", "size", "others", "change"))
            writer.writerows((check, mistake, *(found or ("", "")), change) for check, mistake, found, change in rows)


def alike(slopes: dict[tuple[str, str], float]) -> None:
    """Shift of every check by each mistake, relative to the largest: mistakes of one row look alike."""
    print("shift of each check, the largest as 1:", ", ".join(CHECKS))
    for mistake in SIZES:
        shifts = np.array([slopes[check, mistake] * SIZES[mistake] for check in CHECKS])
        print(f"  {mistake}:", " ".join(f"{s:+.2f}" for s in shifts / np.abs(shifts).max()))


if __name__ == "__main__":
    sys.exit(main())
