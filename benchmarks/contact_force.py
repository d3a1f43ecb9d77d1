"""What a force costs: by tip and by model, on arrays of a million depths and in a step of the filter.

Run: python benchmarks/contact_force.py [ROUNDS]. All candidates take turns in one process; medians are printed, and
ratios to the paper's paraboloid. "quadrature" is the same paraboloid with `contact_radius` only, as a stranger writes
it: its area is the default integral.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ContactModel, Indenter, Length, Problem, contact_force
from palpate_engine import Source, build_parts
from palpate_filters.ekf import ExtendedKalmanFilter
from palpate_models import (
    DimensionalityReduction,
    FreeHuntCrossley,
    HuntCrossley,
    KelvinVoigt,
    Maxwell,
    PlateCompression,
    StandardLinearSolid,
)
from palpate_models.thickness import Thickness
from palpate_testing import synthetic_samples

R = 5e-3  # radius [m] of the tips
STEPS, NUMBERS = 20_000, 1_000_000


class Quadrature(Indenter):
    """The paraboloid by its contact radius alone."""

    radius: Length

    def contact_radius(self, depth: Any) -> Any:
        """sqrt(R d) [m]."""
        return (self.radius * depth) ** 0.5


EXAMPLE = Path(__file__).parents[1] / "pipelines" / "parts" / "tips.toml"
TIPS: Mapping[str, Indenter] = {
    **build_parts(Source.read(EXAMPLE, named=False), "indenter"),
    "quadrature": Quadrature(radius=R),
}
OTHERS: Mapping[str, tuple[ContactModel, list[float]]] = {
    "dimitriadis": (
        DimensionalityReduction(indenter=TIPS["sphere"], thickness=Thickness(law="dimitriadis", height=22e-3)),
        [1e5, 300.0],
    ),
    "standard-linear-solid": (StandardLinearSolid(indenter=TIPS["sphere"]), [1e5, 2e4, 0.1]),
    "maxwell": (Maxwell(indenter=TIPS["sphere"]), [1e5, 2e4]),
    "kelvin-voigt": (KelvinVoigt(), [1e3, 10.0]),
    "hunt-crossley": (HuntCrossley(), [1.0, 10.0]),
    "hunt-crossley-free": (FreeHuntCrossley(), [1.0, 10.0, 1.5]),
    "compression": (PlateCompression(diameter=51e-3, height=22e-3), [1e5]),
}


def candidates() -> dict[str, tuple[ContactModel, list[float]]]:
    """Every model with every tip that is worth distinguishing."""
    tips = {name: (DimensionalityReduction(indenter=tip), [1e5, 300.0]) for name, tip in TIPS.items()}
    return {**tips, **OTHERS}


def on_array(model: ContactModel, theta: list[float]) -> Callable[[], object]:
    """A call that evaluates a million forces."""
    depth, rate = np.linspace(1e-5, 4e-3, NUMBERS), np.full(NUMBERS, 0.01)
    memory = [np.zeros(NUMBERS) for _ in model.memory]
    return lambda: contact_force(model, depth, rate, theta, memory)


def in_filter(model: ContactModel, theta: list[float]) -> Callable[[], object]:
    """A call that filters a record of STEPS samples."""
    samples = synthetic_samples(model, theta, duration=STEPS / 500.0)
    problem, estimator = Problem(model, 0.14), ExtendedKalmanFilter()
    tracker = estimator.start(problem)
    tracker.run(samples)  # builds what is built once
    return lambda: tracker.run(samples)


def medians(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median CPU seconds of each call, taking turns."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            began = time.process_time()
            call()
            taken[name].append(time.process_time() - began)
    return {name: statistics.median(times) for name, times in taken.items()}


def main() -> None:
    """Print the table."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    chosen = candidates()
    array = medians({name: on_array(*pair) for name, pair in chosen.items()}, rounds)
    step = medians({name: in_filter(*pair) for name, pair in chosen.items()}, rounds)
    print(f"{'':<24}{'array of 1e6':>20}{'EKF step':>20}")
    print(f"{'':<24}{'us/force':>12}{'ratio':>8}{'us/step':>12}{'ratio':>8}")
    for name in chosen:
        per_force, per_step = 1e6 * array[name] / NUMBERS, 1e6 * step[name] / STEPS
        ratios = array[name] / array["sphere"], step[name] / step["sphere"]
        print(f"{name:<24}{per_force:12.4f}{ratios[0]:8.2f}{per_step:12.3f}{ratios[1]:8.2f}")


if __name__ == "__main__":
    main()
