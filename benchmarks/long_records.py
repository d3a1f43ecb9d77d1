"""The noise of the motion summed over blocks, as in long records, against sums over every sample: power, false alarms.

Run it with: python benchmarks/long_records.py [RECORDS]. Right records of each rig of `verdicts.py`, and a sine of 2 Hz
over ten minutes, are tested with blocks however short they are. Printed are the lowest and the highest ratio of the
variance of every sample to that of blocks, over all alternatives and combinations of bins: the share of its
noncentrality that a test keeps; and how many of the records have a p below 0.05 and 0.001 by either.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from lack_of_fit import findings
from palpate_uncertainty import residual_null, residual_tests
from palpate_uncertainty.residual_null import ResidualNull
from palpate_uncertainty.score_tests import TestedResidual
from verdict_records.files import drawn, random_of, write
from verdict_records.judgement import judged
from verdict_records.rigs import RIGS
from verdict_records.sizes import readings
from wrong_records import S2

SEED = 76
TEN_MINUTES = "ten-minutes"  # of a sine of 2 Hz at 500 Hz
NEVER = 10**9  # samples
SHARES = (0.05, 0.001)


def covariance_ratios(weights: np.ndarray, null: ResidualNull) -> np.ndarray:
    """Return the variances by every sample over those by blocks (m,), of all combinations of sums."""
    blocks = null.covariance(weights)
    with summed_over_blocks_from(NEVER):
        samples = null.covariance(weights)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(samples), 1e-300))
    powers, axes = np.linalg.eigh(samples * scale * scale[:, None])
    independent = powers > 1e-6 * powers[-1]
    axes = axes[:, independent] / np.sqrt(powers[independent])
    return 1.0 / np.linalg.eigvalsh(axes.T @ (blocks * scale * scale[:, None]) @ axes)


@contextmanager
def summed_over_blocks_from(samples: int) -> Iterator[None]:
    """Let a record of so many samples be a long one."""
    usual, residual_null.LONG = residual_null.LONG, samples
    try:
        yield
    finally:
        residual_null.LONG = usual


@contextmanager
def observed(ratios: list[np.ndarray], probabilities: list[tuple[float, float]]) -> Iterator[None]:
    """Take down the ratios of all tests, and p of each residual by blocks and by every sample."""
    tests, along = residual_tests._tests, TestedResidual.along

    def both_tests(*arguments):
        with summed_over_blocks_from(0):
            TestedResidual.along = along_with_ratios
            by_blocks = tests(*arguments)
            TestedResidual.along = along
        by_samples = tests(*arguments)
        probabilities.append((by_blocks.p, by_samples.p))
        return by_samples

    def along_with_ratios(residual, columns):
        directions = along(residual, columns)
        ratios.append(covariance_ratios(directions.sharp / residual.space.std[:, None], residual.null))
        return directions

    residual_tests._tests = both_tests
    try:
        yield
    finally:
        residual_tests._tests, TestedResidual.along = tests, along


def main() -> None:
    """Print a line for each rig."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print(f"{count} records a rig; ratio of variances: lowest, highest; of p below {SHARES}: by blocks, by samples")
    with tempfile.TemporaryDirectory() as folder:
        for rig in sys.argv[2:] or (*RIGS, TEN_MINUTES):
            ratios: list[np.ndarray] = []
            probabilities: list[tuple[float, float]] = []
            with observed(ratios, probabilities):
                for number in range(count):
                    judge(rig, number, Path(folder))
            every, p = np.concatenate(ratios), np.array(probabilities)
            below = ", ".join(f"{np.sum(p[:, 0] < share)} and {np.sum(p[:, 1] < share)}" for share in SHARES)
            print(f"{rig:<14}{every.min():8.4f}{every.max():8.4f}   {len(p)} tests: {below}", flush=True)


def judge(rig: str, number: int, folder: Path) -> None:
    """Draw a right record, and let the product judge it."""
    if rig == TEN_MINUTES:
        list(findings(replace(S2, duration=600.0), "clean", number))
        return
    random = random_of(SEED, rig, number)
    specimen = drawn(rig, random)
    path = write(folder / f"{rig}-{number}", specimen.rig, readings(specimen), random)
    judged(path, specimen.rig, True)


if __name__ == "__main__":
    main()
