"""Costs of a period of the servo loop in a motion of the simulated UR3e: CPU time and calls of functions.

Run it with: python benchmarks/servo_period.py [--calls]

Prints how many periods there were, and the CPU time [us] of the thread in one of them, with that of the twin's
commands: the 10 % quantile, which other work on the computer changes least, and the median; with ``--calls`` the mean
count of calls, which no other work changes, and the dearest functions. To compare two commits, check the other one out
with an installation of its own, and let both interpreters run this file in turns: each measures its own code.
"""

import argparse
import cProfile
import pstats
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from palpate_arms.arm_loop import ArmLoop
from palpate_engine import load_pipeline, run_pipeline

PIPELINE = Path(__file__).parents[1] / "pipelines" / "point_ur3e.toml"
SETTINGS = (
    *("device.sensor.settle=0.1 s", "safety.standstill=0.2 s", "alignment.tare_duration=0.15 s"),
    *("trajectory.press.standstill=0 s", "trajectory.press.clearance=3 mm", "trajectory.press.duration=2 s"),
    "twin.bench.height=4 mm",
)
_DEAREST = 30  # functions that are printed


def main() -> None:
    """Run the motion, and print a line; with --calls the functions as well."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", action="store_true")
    with_calls = parser.parse_args().calls
    profile, durations, cycle = cProfile.Profile(time.thread_time), list[int](), ArmLoop._cycle

    def measure(loop: ArmLoop, *arguments: Any) -> None:
        if not loop._following:
            cycle(loop, *arguments)
        elif with_calls:
            durations.append(0)
            profile.runcall(cycle, loop, *arguments)
        else:
            began = time.thread_time_ns()
            cycle(loop, *arguments)
            durations.append(time.thread_time_ns() - began)

    ArmLoop._cycle = measure  # type: ignore[method-assign]
    pipeline = load_pipeline(PIPELINE, SETTINGS)
    with tempfile.TemporaryDirectory() as folder, pipeline.twins["bench"].simulated(0, []):
        run_pipeline(pipeline, Path(folder) / "run")
    if not with_calls:
        tenth, median = np.quantile(durations, (0.1, 0.5)) / 1e3
        print(f"{len(durations)} periods, 10 % quantile {tenth:.1f} us, median {median:.1f} us")
        return
    statistics_of_calls = pstats.Stats(profile)
    print(f"{len(durations)} periods, {statistics_of_calls.total_calls / len(durations):.1f} calls")  # type: ignore[attr-defined]
    statistics_of_calls.sort_stats("cumulative").print_stats(_DEAREST)


if __name__ == "__main__":
    main()
