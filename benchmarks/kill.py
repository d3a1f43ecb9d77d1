"""What a kill -9 costs: a recording of a 1 kHz wrench, killed at random moments.

A child process hands readings to the MCAP sink and notes in shared memory the stamp of the last one; the loss is what
was handed over before the kill and is not in the log. ``python benchmarks/kill.py [--times 20]``
"""

import argparse
import mmap
import multiprocessing
import os
import random
import signal
import statistics
import struct
import tempfile
import time
from pathlib import Path

import numpy as np
from palpate import Batch, Channel, Run, Stream
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.mcap_sink import McapSink

STREAM = Stream("wrench", tuple(Channel(n, "N") for n in ("x", "y", "z", "tx", "ty", "tz")), 1000.0, "wrench")


def record(folder, shared):
    """Hand over ten readings every ten milliseconds, until somebody kills."""
    with McapSink().open(Run(folder, {"rig": (STREAM,)}, {}, {}, {})) as writer:
        while True:
            stamps = time.time_ns() + np.arange(10) * 1_000_000
            writer.batch("rig", Batch("wrench", stamps, stamps, np.random.default_rng(0).normal(size=(10, 6))))
            shared[:8] = struct.pack("<q", int(stamps[-1]))
            time.sleep(0.01)


def lost(folder, moment):
    """Seconds of readings that were handed over and are missing after a kill some seconds into the recording."""
    folder.mkdir()
    shared = mmap.mmap(-1, 8)
    child = multiprocessing.get_context("fork").Process(target=record, args=(folder, shared))
    child.start()
    time.sleep(moment)
    os.kill(child.pid, signal.SIGKILL)
    child.join()
    (handed,) = struct.unpack("<q", shared[:8])
    with McapReplay(file=folder / "log.mcap", accept_cut=True).connect(0) as link:
        return (handed - max(int(batch.time[-1]) for batch in link.batches())) / 1e9


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
