"""What a kill -9 costs: recordings of the simulated rig in real time, killed at random moments.

``python benchmarks/kill.py [--times 20]`` prints how much of the record before each kill is missing from the log.
"""

import argparse
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from palpate_devices.mcap_replay import McapReplay

PIPELINE = Path(__file__).parent.parent / "pipelines" / "point.toml"


def lost(folder, moment):
    """Seconds of the record that are missing after a kill some seconds into the recording."""
    command = [sys.executable, "-c", "from palpate.cli import main; main()", "run", str(PIPELINE)]
    command += ["--set", "device.rig.pace=real-time", "--out", str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    log = folder / "log.mcap"
    while not log.exists():
        time.sleep(0.01)
    time.sleep(moment)
    os.kill(process.pid, signal.SIGKILL)
    killed = time.time_ns()
    process.wait()
    with McapReplay(file=log, accept_cut=True).connect(0) as link:
        last = max(int(batch.time[-1]) for batch in link.batches() if batch.stream == "tip")
    return (killed - last) / 1e9


def main():
    """Kill, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20)
    times = parser.parse_args().times
    dice = random.Random(0)
    with tempfile.TemporaryDirectory() as root:
        found = [lost(Path(root) / str(i), 1.0 + 3.0 * dice.random()) for i in range(times)]
    print(f"{times} kills: lost {statistics.median(found):.3f} s in the median, {max(found):.3f} s at most")


if __name__ == "__main__":
    main()
