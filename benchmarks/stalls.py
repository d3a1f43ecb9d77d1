"""Stalls of the host in a point palpation: what they do to the estimates.

The same simulated samples with and without stretches left out, as after a host that stood still for 12 to 20 ms
(bridged by the filter's prediction) or 22 to 40 ms (a pause: the measured position carries the depth). Mean and scatter
of E and eta over the seeds, and the change against the same seed without stalls. ``python benchmarks/stalls.py 20``
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from palpate import Estimates, Samples, Status
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_engine.pipeline.tracks import start_tracks

PIPELINE = Path(__file__).parents[1] / "pipelines" / "filters.toml"
_CASES = {"1 of 12-20 ms": (1, 0.012, 0.020), "1 of 22-40 ms": (1, 0.022, 0.040)}
_CASES |= {"10 of 12-20 ms": (10, 0.012, 0.020), "10 of 22-40 ms": (10, 0.022, 0.040)}


class Keep:
    """An observer that keeps the samples."""

    def __init__(self) -> None:
        self.blocks: list[Samples] = []

    def batch(self, *_: object) -> None:
        """Not kept."""

    def samples(self, samples: Samples) -> None:
        """Keep a block."""
        self.blocks.append(samples)

    def estimates(self, *_: object) -> None:
        """Not kept."""


def stalled(samples: Samples, dice: np.random.Generator, count: int, least: float, most: float) -> Samples:
    """The samples without those of some stalls in contact."""
    kept, contact = np.ones(len(samples), bool), np.flatnonzero(samples.active)
    for first in dice.choice(contact[300:-600], count, replace=False):
        kept[first : first + round(dice.uniform(least, most) / 0.002)] = False
    left = samples[kept]
    return replace(left, interval=np.diff(left.time, prepend=left.time[0]))


def found(estimates: Estimates) -> list[float]:
    """E, eta over the last second, and how often it was too stiff, resumed and restarted."""
    values = estimates.values[np.isfinite(estimates.values[:, 0])][-500:].mean(axis=0)
    marks = (Status.STIFF, Status.RESUMED, Status.RESTARTED)
    return [*values.tolist(), *(float(np.count_nonzero(estimates.status & mark)) for mark in marks)]


def main() -> None:
    """All cases, all tracks."""
    rows: dict[tuple[str, str], list[list[float]]] = {}
    for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 20):
        pipeline, keep = load_pipeline(PIPELINE, [f"run.seed={seed}"]), Keep()
        with tempfile.TemporaryDirectory() as folder:
            run_pipeline(pipeline, Path(folder) / "out", None, keep)
        whole, dice = Samples.joined(keep.blocks), np.random.default_rng(1000 + seed)
        cases = {"none": whole} | {name: stalled(whole, dice, *case) for name, case in _CASES.items()}
        for name, samples in cases.items():
            for running in start_tracks(pipeline):
                rows.setdefault((running.track.name, name), []).append(found(running.tracker.run(samples)))
    print(
        "| track | stalls in 10 s | E kPa | eta Pa s | largest change of E %, eta % | too stiff, resumed, restarted |"
    )
    for (track, name), numbers in rows.items():
        table, plain = np.array(numbers), np.array(rows[track, "none"])
        change = 100 * np.abs(table[:, :2] / plain[:, :2] - 1).max(axis=0)
        (e, eta), (e_std, eta_std) = table[:, :2].mean(axis=0), table[:, :2].std(axis=0)
        marks = ", ".join(f"{x:.1f}" for x in table[:, 2:].mean(axis=0))
        print(
            f"| {track} | {name} | {e / 1e3:.2f} ({e_std / 1e3:.2f}) | {eta:.1f} ({eta_std:.1f}) | "
            f"{change[0]:.2f}, {change[1]:.2f} | {marks} |"
        )


if __name__ == "__main__":
    main()
