"""How much faster than the clock a simulated raster is, with its filter and smoother, and what the filters take of it.

Run it with: python benchmarks/simulations.py [ROUNDS]. Processor time, in turns in one process, medians. The whole
is `run_pipeline` on pipelines/raster.toml: motion, rig, alignment, estimates, log, table, diagnoses, result. The
limit are the same trackers on the same samples, in one block. Linear algebra has one thread, as the command sets it.
"""

import os
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from palpate.estimation import Samples
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline, start_tracks
from threadpoolctl import threadpool_limits

RASTER = Path(__file__).parent.parent / "pipelines" / "raster.toml"


class Kept:
    """A writer that keeps the samples."""

    def __init__(self):
        self.blocks = []

    def batch(self, device, batch):
        """Readings are not kept."""

    def samples(self, samples):
        """Keep a block."""
        self.blocks.append(samples)

    def estimates(self, track, estimates):
        """Estimates are not kept."""


def main() -> None:
    """Print the table."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    pipeline, kept = load_pipeline(RASTER), Kept()
    taken: dict[str, list[float]] = {"palpate run, all of it": [], "its filter and smoother alone": []}
    clock: list[float] = []
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(limits=1):
        os.chdir(folder)
        run_pipeline(pipeline, Path("warm"), observer=kept)
        samples = Samples.joined(kept.blocks)
        for i in range(rounds):
            before, began = time.process_time(), time.perf_counter()
            run_pipeline(pipeline, Path(f"run-{i}"))
            middle = time.process_time()
            clock.append(time.perf_counter() - began)
            for track in start_tracks(replace(pipeline, sinks={})):
                track.tracker.run(samples)
            after = time.process_time()
            for name, seconds in zip(taken, (middle - before, after - middle), strict=True):
                taken[name].append(seconds)
    span = float(samples.time[-1])
    limit = statistics.median(taken["its filter and smoother alone"])
    print(f"raster of {span:.0f} s, {len(samples)} samples")
    for name, seconds in taken.items():
        median = statistics.median(seconds)
        print(
            f"  {name:<32} {median:7.2f} s CPU   {span / median:7.0f} x real time   {median / limit:6.1f} x the filters"
        )
    seen = statistics.median(clock)
    print(f"  {'palpate run, by the clock':<32} {seen:7.2f} s       {span / seen:7.0f} x real time")


if __name__ == "__main__":
    main()
