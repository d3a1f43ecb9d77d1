"""The presets of the fading filters on simulated sweeps and points: python benchmarks/presets.py [runs].

Records as in `filters_accuracy.py`. RMSE of E along the sweep; peak: largest E within 5 mm of the sphere, over
the true one; late: how far behind the sphere's centre that is; point: error of E after 10 s. Medians over the runs;
lost: runs that diverged, or are further than 100 % off.
"""

from __future__ import annotations

import sys

import numpy as np
from filters_accuracy import MATERIALS, STANDSTILL, palpation, sweep
from palpate import Problem
from palpate_filters import palpate_estimators
from palpate_models import DimensionalityReduction, Sphere

PROBLEM = Problem(DimensionalityReduction(indenter=Sphere(radius=5e-3)), 0.14)


def along_a_sweep(name: str, preset: str, speed: float, seed: int) -> tuple[float, float, float]:
    """RMSE [kPa], height of the peak [%] and its lateness [mm] of one run; infinite where it was lost."""
    samples, truth = sweep(speed, seed)
    found = palpate_estimators()[name](preset=preset).start(PROBLEM).run(samples).values[:, 0]
    moving = samples.time > STANDSTILL
    error = (found - truth)[moving]
    if not np.isfinite(error).all() or np.abs(error / truth[moving]).max() > 1.0:
        return np.inf, np.inf, np.inf
    place = (samples.time - STANDSTILL) * speed
    near = np.abs(place - 0.02) < 5e-3
    period = np.ones(250) / 250  # of the palpation
    smooth = np.convolve(found, period, "same")
    peak = place[near][np.argmax(smooth[near])]
    return (
        float(np.sqrt(np.mean(error**2)) / 1e3),
        100 * float(smooth[near].max() / truth.max() - 1),
        1e3 * (peak - 0.02),
    )


def main(runs: int) -> None:
    """One row for each filter and preset."""
    print("| filter | preset | RMSE kPa at 2 / 4 / 6 mm/s | peak % and mm late at 4 mm/s | lost | point, E error % |")
    print("|---|---|---|---|---|---|")
    elasticity, viscosity, radius = MATERIALS["S2 R5"]
    for name in ("afekf", "afukf"):
        for preset in ("palpate", "paper", "authors"):
            found = {v: np.array([along_a_sweep(name, preset, v, s) for s in range(runs)]) for v in (2e-3, 4e-3, 6e-3)}
            points = []
            for seed in range(runs):
                samples = palpation(elasticity, viscosity, radius, seed)
                values = palpate_estimators()[name](preset=preset).start(PROBLEM).run(samples).values
                points.append(100 * (values[-250:, 0].mean() / elasticity - 1))
            errors = " / ".join(f"{np.median(table[:, 0]):.2f}" for table in found.values())
            lost = sum(int(np.isinf(table[:, 0]).sum()) for table in found.values())
            _, peak, late = np.median(found[4e-3], axis=0)
            good = np.array(points)[np.isfinite(points)]
            cell = f"{np.median(good):+.1f}, worst {np.abs(good).max():.1f}" if len(good) else "lost"
            print(
                f"| {name} | {preset} | {errors} | {peak:+.1f}, {late:+.1f} | {lost} of {3 * runs} | {cell} |",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
