"""Coverage of `casadi-fit` for materials with memory: how often its intervals of 95 % hold the truth.

Run: python benchmarks/coverage_memory.py [DRAWS] [--out FILE.csv] [--models a,b] [--forces 0.01,0.05,0.2] [--first N].
One motion (air, a press to 3 mm, a hold, sines of 1 and 5 Hz; 8 s at 250 Hz), one material a model, noise of the force
at each level and 5 um of the height, drawn again for each record. Forces are hereditary integrals written out here,
summed over twenty steps a sample: nothing of the product makes the records, but for `poroelastic`, whose contact radius
sets its own pace. One row a parameter and record is appended to the file as it is found; the same command goes on
where it was stopped.

Counted is |value - truth| < 1.96 std; 200 honest intervals of 95 % hold the truth in 182 to 197 of 99.8 % of all cases.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from palpate import ContactModel, Floats, Problem, Samples, force_over_time
from palpate_fits import CasadiFit
from palpate_models import (
    Burgers,
    DimensionalityReductionMaxwell,
    FractionalKelvinVoigt,
    GeneralisedMaxwell2,
    GeneralisedMaxwell3,
    Maxwell,
    Poroelastic,
    PowerLaw,
    Sphere,
    StandardLinearSolid,
)

RADIUS, NU = 5e-3, 0.5
INTERVAL, LASTS, FINE = 4e-3, 8.0, 20  # [s], [s], steps of the integral in a sample
POSITION, SURFACE = 5e-6, 1e-4  # [m] noise of the height, height of the skin
FIELDS = ("model", "force", "draw", "parameter", "truth", "value", "std", "flags")


def smooth_step(x: Floats) -> Floats:
    """From 0 to 1 (n,), at rest at both ends."""
    s = np.clip(x, 0, 1)
    return np.asarray(s**2 * (3 - 2 * s))


def depth_of(time: Floats) -> Floats:
    """The motion (n,) [m]."""
    swing = 0.5e-3 * np.sin(2 * np.pi * (time - 4)) + 0.3e-3 * np.sin(10 * np.pi * (time - 4))
    return np.asarray(-0.5e-3 + 3.5e-3 * smooth_step(time / 0.4) + smooth_step((time - 4) / 0.5) * swing)


def prony(lasting: float, *arms: tuple[float, float]) -> Callable[[Floats], Floats]:
    """Integral of E(t) = E + sum of E_k exp(-t/tau_k) from 0 to t."""
    return lambda t: np.asarray(lasting * t + sum(e * tau * -np.expm1(-t / tau) for e, tau in arms))


def burgers(instant: float, flow: float, delayed: float, delaying: float) -> Callable[[Floats], Floats]:
    """Integral of E(t) of a Maxwell and a Kelvin-Voigt element in series, by partial fractions of E*(s)."""
    n, m = 3 * flow, 3 * delaying  # in tension, nu = 0.5
    above = np.array([n * m, n * delayed, 0.0])  # E*(s)/s of 1/(1/E + 1/(n s) + 1/(E_K + m s))
    below = np.array([n * m / instant, n * delayed / instant + n + m, delayed])
    poles = np.roots(below)
    strengths = [np.polyval(above, p) / p / np.polyval(np.polyder(below), p) for p in poles]
    return prony(0.0, *((float(e), float(-1 / p)) for e, p in zip(strengths, poles, strict=True)))


@dataclass(frozen=True)
class Material:
    """A model, its true parameters [SI], and the modulus that makes its forces."""

    model: ContactModel
    theta: tuple[float, ...]
    modulus: Callable[[Floats], Floats] | None  # its integral; None: the model's own force
    viscosity: float = 0.0  # [Pa s] of a damper in parallel


def of_springpot(model: PowerLaw | FractionalKelvinVoigt, theta: tuple[float, ...]) -> Material:
    """A power of time as the model declares it: a spring, a damper and ten arms."""
    law = model.spectrum(theta)
    arms = prony(law.lasting, *((strength, 1 / rate) for strength, rate in law.arms))
    return Material(model, theta, arms, law.damper)


TIP = Sphere(radius=RADIUS)
MATERIALS = {
    "standard-linear-solid": Material(
        StandardLinearSolid(indenter=TIP), (100e3, 40e3, 0.2), prony(100e3, (40e3, 0.2))
    ),
    "generalised-maxwell-2": Material(
        GeneralisedMaxwell2(indenter=TIP), (100e3, 30e3, 0.05, 20e3, 1.0), prony(100e3, (30e3, 0.05), (20e3, 1.0))
    ),
    "generalised-maxwell-3": Material(
        GeneralisedMaxwell3(indenter=TIP), (100e3, 30e3, 0.02, 30e3, 0.15, 20e3, 1.0),
        prony(100e3, (30e3, 0.02), (30e3, 0.15), (20e3, 1.0)),
    ),
    "dimensionality-reduction-maxwell": Material(
        DimensionalityReductionMaxwell(indenter=TIP), (100e3, 300.0, 30e3, 0.3), prony(100e3, (30e3, 0.3)), 300.0
    ),
    "maxwell": Material(Maxwell(indenter=TIP), (100e3, 300e3), prony(0.0, (100e3, 9.0))),
    "burgers": Material(Burgers(indenter=TIP), (100e3, 400e3, 200e3, 10e3), burgers(100e3, 400e3, 200e3, 10e3)),
    "power-law": of_springpot(PowerLaw(indenter=TIP), (100e3, 0.1)),
    "fractional-kelvin-voigt": of_springpot(FractionalKelvinVoigt(indenter=TIP), (60e3, 40e3, 0.3)),
    "poroelastic": Material(Poroelastic(indenter=TIP), (100e3, 0.2, 5e-6), None),
}  # fmt: skip


def force_of(material: Material) -> Floats:
    """Contact force (n,) [N] without noise: 4 sqrt(R)/(3 (1 - nu^2)) int E(t - s) d(d^1.5), and a damper's."""
    n = round(LASTS / INTERVAL)
    step = INTERVAL / FINE
    time = step * np.arange(n * FINE)
    depth = depth_of(time)
    if material.modulus is None:
        return force_over_time(material.model, time, depth, np.gradient(depth, time), material.theta)[::FINE]
    inside = np.maximum(depth, 0.0)
    whole = material.modulus(step * np.arange(n * FINE + 1))
    mean = np.diff(whole) / step  # of E(t) over each step, which a rate that is constant there feels
    size = 2 * len(mean)
    moved = np.diff(inside**1.5, prepend=0.0)
    felt = np.fft.irfft(np.fft.rfft(mean, size) * np.fft.rfft(moved, size), size)[: len(mean)]
    force = 4 * np.sqrt(RADIUS) / (3 * (1 - NU**2)) * felt
    force += 4 * material.viscosity / (1 - NU) * np.sqrt(RADIUS * inside) * np.gradient(depth, time)
    return np.asarray(force[::FINE])


def record(force: Floats, noise: float, draw: int) -> Samples:
    """What a rig says of it."""
    random = np.random.default_rng([11, draw, round(1e6 * noise)])
    time = INTERVAL * np.arange(len(force))
    depth = depth_of(time)
    reading = force + noise * random.standard_normal(len(time))
    height = SURFACE - depth + POSITION * random.standard_normal(len(time))
    contact = depth > 0
    return Samples(
        np.rint(1e9 * time).astype(np.int64), time, np.diff(time, prepend=0.0), reading, height,
        np.gradient(height, time), contact, contact,
    )  # fmt: skip


def rows_of(name: str, force: Floats, noise: float, draw: int) -> list[dict[str, object]]:
    """Rows of one record."""
    material = MATERIALS[name]
    fit = CasadiFit(profile=False, segment="contact")
    found = fit.start(Problem(material.model, 0.0)).run(record(force, noise, draw))
    row = np.flatnonzero(np.isfinite(found.values).all(axis=1))[-1]
    flags = " ".join(sorted({flag.code for flag in found.flags}))
    names = [parameter.name for parameter in material.model.parameters]
    numbers = zip(names, material.theta, found.values[row].tolist(), found.std[row].tolist(), strict=True)
    return [dict(zip(FIELDS, (name, noise, draw, *four, flags), strict=True)) for four in numbers]


def main() -> None:
    """Draws what is not there yet, and shows all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("draws", type=int, nargs="?", default=200)
    parser.add_argument("--out", type=Path, default=Path("coverage_memory.csv"))
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--models", default=",".join(MATERIALS))
    parser.add_argument("--forces", default="0.01,0.05,0.2", help="[N] noise of the force")
    chosen = parser.parse_args()
    cases = [(name, float(noise)) for name in chosen.models.split(",") for noise in chosen.forces.split(",")]
    done = set()
    if chosen.out.exists():
        with chosen.out.open(newline="") as file:
            done = {(row["model"], float(row["force"]), int(row["draw"])) for row in csv.DictReader(file)}
    new = not chosen.out.exists()
    with chosen.out.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if new:
            writer.writeheader()
        for name, noise in cases:
            force = force_of(MATERIALS[name])
            for draw in range(chosen.first, chosen.first + chosen.draws):
                if (name, noise, draw) not in done:
                    writer.writerows(rows_of(name, force, noise, draw))
                    file.flush()
    with chosen.out.open(newline="") as file:
        show(list(csv.DictReader(file)))


def show(rows: list[dict[str, str]]) -> None:
    """The table: coverage of each parameter, its mean error over its std, and the spread of that."""
    print(
        f"{'model':34}{'N':>6} {'parameter':22}{'n':>5}{'within 95 %':>12}{'error/std':>11}{'spread':>8}  std %  flags"
    )
    kinds = list(dict.fromkeys((row["model"], row["force"], row["parameter"]) for row in rows))
    for kind in kinds:
        of = [row for row in rows if (row["model"], row["force"], row["parameter"]) == kind]
        value, std, truth = (np.array([float(row[key]) for row in of]) for key in ("value", "std", "truth"))
        score = (value - truth) / std
        within, relative = int(np.sum(np.abs(score) < 1.96)), 100 * float(np.median(std / truth))
        flags: dict[str, int] = {}
        for row in of:
            for code in row["flags"].split():
                flags[code] = flags.get(code, 0) + 1
        said = " ".join(f"{code}:{count}" for code, count in flags.items())
        print(
            f"{kind[0]:34}{kind[1]:>6} {kind[2]:22}{len(of):5}{within:12}{score.mean():11.2f}{score.std():8.2f}"
            f"{relative:7.2f}  {said}"
        )


if __name__ == "__main__":
    main()
