"""How accurate the filters are in simulation: point palpations against the Cramer-Rao bound, and sweeps over lumps.

Run it with: python benchmarks/filters_accuracy.py [runs]. Seeds are fixed. It prints the tables of results/filters.md.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from palpate import ContactModel, Estimates, Estimator, Problem, Samples, contact_force
from palpate_filters.ekf import AdaptiveFadingEkf, ExtendedKalmanFilter
from palpate_filters.kinematic_filter import KinematicFilter
from palpate_filters.smoother import KinematicSmoother
from palpate_filters.ukf import AdaptiveFadingUkf
from palpate_models import DimensionalityReduction, Sphere

MATERIALS = {"S1 R5": (282.1e3, 860.0, 5e-3), "S2 R5": (112.5e3, 362.0, 5e-3), "S2 R2.5": (112.5e3, 362.0, 2.5e-3)}
MASS = 0.14  # [kg]
SURFACE = 0.3e-3  # [m]
STANDSTILL = 10.0  # [s] at a point before a sweep begins


def palpation(elasticity: float, viscosity: float, radius: float, seed: int) -> Samples:
    """Ten seconds of 0.8 mm at 2 Hz around a depth of 4 mm: what is left of the paper's protocol behind a PD loop.

    The motion is exact. (The simulated rig moves in steps of its control period; sampled in step with it, its
    acceleration is 10 % above the mean, which shifts E by 0.08 %.)
    """
    random = np.random.default_rng(seed)
    time = np.arange(5000) / 500.0
    model = DimensionalityReduction(indenter=Sphere(radius=radius))
    return measured(model, [elasticity, viscosity], SURFACE, 0.0 * time, time, 0.8e-3, -3.7e-3, random)


def measured(
    model: ContactModel,
    theta: Any,
    surface: Any,
    slope: Any,
    time: np.ndarray,
    amplitude: float,
    mean: float,
    random: Any,
) -> Samples:
    """Samples of a sine of 2 Hz with the paper's noise, and 5 um on the position."""
    n, omega = len(time), 2 * np.pi * 2.0
    height = mean - amplitude * np.sin(omega * time)
    velocity = -amplitude * omega * np.cos(omega * time)
    acceleration = amplitude * omega**2 * np.sin(omega * time)
    force = contact_force(model, surface - height, slope - velocity, theta) - MASS * acceleration
    force = force + 0.05 * random.standard_normal(n)
    height = height + 5e-6 * random.standard_normal(n)
    velocity = velocity + 0.67e-3 * random.standard_normal(n)
    always, stamp = np.ones(n, bool), np.arange(n, dtype=np.int64) * 2_000_000
    interval = np.concatenate([[0.0], np.full(n - 1, 0.002)])
    return Samples(stamp, time, interval, force, height, velocity, always, always.copy())


def bound(model: ContactModel, theta: list[float], samples: Samples, surface: float, force_std: float) -> np.ndarray:
    """Cramer-Rao bound on the standard deviation of surface [m] and parameters, with the motion known."""
    active = samples[samples.active]
    depth, rate = surface - active.position, -active.velocity
    columns = []
    for i in range(3):
        step = [0.0, 0.0, 0.0]
        step[i] = 1e-6 if i == 0 else theta[i - 1] * 1e-5
        ends = [
            contact_force(model, depth + s * step[0], rate, [t + s * d for t, d in zip(theta, step[1:], strict=True)])
            for s in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2 * step[i]))
    design = np.column_stack(columns) / force_std
    return np.sqrt(np.diag(np.linalg.inv(design.T @ design)))


def points(runs: int) -> None:
    """The table of point palpations."""
    filters: dict[str, Estimator] = {
        "ekf": ExtendedKalmanFilter(),
        "ekf, start_from fit": ExtendedKalmanFilter(start_from="fit"),
        "kinematic-ekf": KinematicFilter(),
    }
    print("| material | filter | E bias % | eta bias % | E std / bound | eta std / bound | NEES (3) | to 1 % of E, s |")
    print("|---|---|---|---|---|---|---|---|")
    for name, (elasticity, viscosity, radius) in MATERIALS.items():
        model, truth = DimensionalityReduction(indenter=Sphere(radius=radius)), [elasticity, viscosity]
        records = [palpation(elasticity, viscosity, radius, seed) for seed in range(runs)]
        limits = bound(model, truth, records[0], SURFACE, 0.05)
        for label, estimator in filters.items():
            results = [estimator.start(Problem(model, MASS)).run(samples) for samples in records]
            last = np.array([e.values[s.active][-1] for e, s in zip(results, records, strict=True)])
            bias, spread = last.mean(axis=0) / truth - 1, last.std(axis=0, ddof=1)
            nees = [consistency(e, s, truth) for e, s in zip(results, records, strict=True)]
            times = [settled(e, s, elasticity) for e, s in zip(results, records, strict=True)]
            print(
                f"| {name} | {label} | {100 * bias[0]:+.3f} | {100 * bias[1]:+.2f} | {spread[0] / limits[1]:.2f} | "
                f"{spread[1] / limits[2]:.2f} | {np.mean(nees):.1f} | {np.median(times):.2f} |"
            )


def consistency(estimates: Estimates, samples: Samples, truth: list[float]) -> float:
    """Sum of squared normalised errors of surface, E and eta at the end; without their correlations."""
    row = np.flatnonzero(samples.active)[-1]
    errors = [estimates.surface[row] - SURFACE, *(estimates.values[row] - truth)]
    return float(np.sum((np.array(errors) / [estimates.surface_std[row], *estimates.std[row]]) ** 2))


def settled(estimates: Estimates, samples: Samples, elasticity: float) -> float:
    """Time [s] of contact after which E stays within 1 %; infinite where it never does."""
    error = np.abs(estimates.values[samples.active][:, 0] / elasticity - 1)
    outside = np.flatnonzero(~(error < 0.01))
    time = samples.time[samples.active]
    if len(outside) and outside[-1] == len(error) - 1:
        return float("inf")
    return float(time[outside[-1] + 1] - time[0]) if len(outside) else 0.0


def felt(along: np.ndarray) -> np.ndarray:
    """Contrast (n,) along a sweep over a sphere at 20 mm and the bow of a horseshoe from 40 to 50 mm.

    The sphere's is a bell of 32.5 %, as finite elements have it for a sphere of 5 mm whose top lies 4 mm deep; the
    bow's of 15 % a step up and down as felt by a tip that rests on a circle of radius a = sqrt(R d), 4.5 mm: averaged
    with the weight of a Hertzian pressure, sqrt(1 - (x/a)^2).
    """
    reach = np.sqrt(5e-3 * 4e-3)
    offset = np.linspace(-reach, reach, 201)
    weight = np.sqrt(1 - (offset / reach) ** 2)
    grid = np.arange(-0.01, 0.08, 1e-4)
    inside = np.abs(grid[:, None] + offset - 0.045) < 5e-3
    bow = np.interp(along, grid, inside @ weight / weight.sum())
    return 0.325 * np.exp(-0.5 * ((along - 0.02) / 3.5e-3) ** 2) + 0.15 * bow


def sweep(speed: float, seed: int) -> tuple[Samples, np.ndarray]:
    """A sweep over two inclusions in a tilted, mildly rough block, and the true E (n,) [Pa]; 10 s still first."""
    random = np.random.default_rng(seed)
    model = DimensionalityReduction(indenter=Sphere(radius=5e-3))
    n = round((STANDSTILL + 60e-3 / speed) * 500)
    time = np.arange(n) / 500
    along = np.maximum(time - STANDSTILL, 0.0) * speed
    elasticity = 112e3 * (1 + felt(along))
    phases, waves = random.uniform(0, 2 * np.pi, 6), random.uniform(8e-3, 40e-3, 6)
    rough = sum(2e-5 * np.sin(2 * np.pi * along / w + p) for w, p in zip(waves, phases, strict=True))
    surface = rough + np.tan(np.radians(0.3)) * along
    slope = np.gradient(surface, time)
    theta = [elasticity, 362.0 / 112e3 * elasticity]
    return measured(model, theta, surface, slope, time, 1e-3, -4e-3, random), elasticity


def sweeps(runs: int) -> None:
    """The table of sweeps."""
    problem = Problem(DimensionalityReduction(indenter=Sphere(radius=5e-3)), MASS)
    print("\n| filter | RMSE of E, kPa, at 2 mm/s | 4 mm/s | 6 mm/s |\n|---|---|---|---|")
    speeds = (2e-3, 4e-3, 6e-3)
    records = {speed: [sweep(speed, seed) for seed in range(runs)] for speed in speeds}
    for label in ("ekf", "afekf", "afukf", "kinematic-ekf", "kinematic-smoother, lag 0.5 s", "kinematic-smoother"):
        cells = []
        for speed in speeds:
            estimator: Estimator = {
                "ekf": ExtendedKalmanFilter(),
                "afekf": AdaptiveFadingEkf(),
                "afukf": AdaptiveFadingUkf(),
                "kinematic-ekf": KinematicFilter(sweep_speed=speed),
                "kinematic-smoother, lag 0.5 s": KinematicSmoother(sweep_speed=speed, lag=0.5),
                "kinematic-smoother": KinematicSmoother(sweep_speed=speed),
            }[label]
            errors = []
            for samples, truth in records[speed]:
                found = estimator.start(problem).run(samples).values[:, 0]
                moving = samples.time > STANDSTILL
                errors.append(np.sqrt(np.nanmean((found - truth)[moving] ** 2)) / 1e3)
            cells.append(f"{np.median(errors):.2f}")
        print(f"| {label} | {' | '.join(cells)} |")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    points(count)
    sweeps(max(count // 5, 3))
