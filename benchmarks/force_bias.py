"""Error of E with an unknown force bias: python benchmarks/force_bias.py [runs]. Some minutes for 40."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from palpate import Floats, Problem, Samples
from palpate_filters import palpate_estimators
from palpate_models import DimensionalityReduction, Sphere

RADIUS, MASS, HOUR = 5e-3, 0.14, 3600.0
PROBLEM = Problem(DimensionalityReduction(indenter=Sphere(radius=RADIUS)), MASS)
S1, S2 = (282.1e3, 860.0), (112.5e3, 362.0)


def palpation(
    random: np.random.Generator, material: tuple[float, float], bias: float, drift: float, duration: float
) -> Samples:
    """A sine of 2 Hz, 0.8 mm around 4 mm; the force of a paraboloid, nu = 0.5, written out."""
    time = np.arange(round(500 * duration)) / 500.0
    omega, phase = 4 * np.pi, random.uniform(0, 2 * np.pi)
    depth, rate = 4e-3 + 8e-4 * np.sin(omega * time + phase), 8e-4 * omega * np.cos(omega * time + phase)
    inertia = -MASS * 8e-4 * omega**2 * np.sin(omega * time + phase)
    contact = 16 / 9 * material[0] * RADIUS**0.5 * depth**1.5 + 8 * material[1] * (RADIUS * depth) ** 0.5 * rate
    force = contact + inertia + bias + drift * time + 0.05 * random.standard_normal(len(time))
    height, speed = np.array([[5e-6], [0.67e-3]]) * random.standard_normal((2, len(time)))
    always = np.ones(len(time), bool)
    stamp = np.rint(time * 1e9).astype(np.int64)
    return Samples(stamp, time, np.diff(time, prepend=0.0), force, height - depth, speed - rate, always, always.copy())


def row(label: str, runs: int, material: tuple[float, float], bias: float, slope: float, **settings: Any) -> None:
    """Print mean and scatter of the error of E, what is stated, and how often it holds."""
    found: list[Floats] = []
    for seed in range(runs):
        random = np.random.default_rng(seed)
        duration = 20.0 if slope else 10.0
        samples = palpation(
            random, material, bias * random.standard_normal(), slope * random.standard_normal(), duration
        )
        estimates = palpate_estimators()["kinematic-ekf"](bias_std=bias, **settings).start(PROBLEM).run(samples)
        found.append(np.array([estimates.values[-1, 0] / material[0] - 1.0, estimates.std[-1, 0] / material[0]]))
    error, std = 100 * np.array(found).T
    inside = np.mean(np.abs(error) < 1.96 * std)
    print(f"| {label} | {error.mean():+.2f} +- {error.std(ddof=1):.2f} | {std.mean():.2f} | {100 * inside:.0f} % |")


if __name__ == "__main__":
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    row("S2, 0.5 N", runs, S2, 0.5, 0.0)
    row("S2, 1 N", runs, S2, 1.0, 0.0)
    row("S1, 0.5 N", runs, S1, 0.5, 0.0)
    row("S2, 0.1 N, drift 150 N/h", runs, S2, 0.1, 150 / HOUR, drift=150 / HOUR)
    row("S2, 0.1 N, drift 36 N/h not stated", runs, S2, 0.1, 36 / HOUR)
