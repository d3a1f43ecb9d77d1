"""A long live run against the twins: memory, clocks, losses. ``python benchmarks/soak.py --minutes 30``."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

PIPELINE = Path(__file__).parents[1] / "pipelines" / "point_ur3e.toml"
_PALPATE = [sys.executable, "-c", "from palpate.cli import main; main()"]


def resident(pid: int) -> int:
    """Resident memory [kB] of a process and its children."""
    total = 0
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                total += int(line.split()[1])
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            total += resident(int(child))
    except OSError:
        return total
    return total


def watch(job: subprocess.Popen[bytes], interval: float) -> list[tuple[float, int]]:
    """Memory over time, until the job ends."""
    began, seen = time.monotonic(), []
    while job.poll() is None:
        seen.append((time.monotonic() - began, resident(job.pid)))
        time.sleep(interval)
    return seen


def bare_loop(seconds: float = 5.0, period: float = 0.002) -> dict[str, float]:
    """How late a loop that does nothing wakes up on this machine, with the priority of the servo loop [s].

    No command rate can be better than this: what it misses, the host has kept for itself.
    """
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(45))
    began = deadline = time.monotonic()
    late = []
    while deadline - began < seconds:
        deadline += period
        time.sleep(max(deadline - time.monotonic(), 0.0))
        late.append(time.monotonic() - deadline)
        if late[-1] > 4 * period:  # like the servo loop, it does not make up for more
            deadline = time.monotonic()
    elapsed = time.monotonic() - began
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    p50, p99 = np.quantile(late, [0.5, 0.99]).tolist()
    missed = sum(x > period for x in late)
    return {"p50": p50, "p99": p99, "largest": max(late), "missed": missed, "rate": len(late) / elapsed}


@dataclass(frozen=True)
class Soaked:
    """What a soak left behind."""

    code: int  # of the job
    memory: np.ndarray  # (n, 2) time [s], resident memory of the job and its processes [kB]
    table: dict[str, Any]  # result.json
    state: dict[str, Any]  # of the twin
    log: Path


def soak(minutes: float, silence: float, folder: Path, every: float, host: str = "127.66.0.1") -> Soaked:
    """One long press against the twins, with a look at the memory every so often [s]."""
    port = folder / "sensor"
    sets = [f"twin.bench.host={host}", f"twin.bench.port={port}", f"device.arm.host={host}"]
    sets += [f"device.sensor.port={port}", f"trajectory.press.duration={60 * minutes} s"]
    limits = ("device.sensor.silence", "device.arm.stale", "safety.stale")
    sets += [f"{limit}={silence} s" for limit in limits] + [f"device.arm.watchdog={max(1 / silence, 1.0)} Hz"]
    options = [word for item in sets for word in ("--set", item)]
    twin = subprocess.Popen(
        [*_PALPATE, "twin", str(PIPELINE), *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert twin.stdin is not None
    assert twin.stdout is not None
    try:
        print(twin.stdout.readline().strip())
        out = folder / "out"
        job = subprocess.Popen([*_PALPATE, "run", str(PIPELINE), "--out", str(out), *options])
        memory = np.array(watch(job, every))
        twin.stdin.write("state\n")
        twin.stdin.flush()
        state = json.loads(twin.stdout.readline().removeprefix("state "))
    finally:
        twin.stdin.close()
        twin.wait(10)
        twin.stdout.close()
    return Soaked(job.returncode, memory, json.loads((out / "result.json").read_text()), state, out / "log.mcap")


def report(soaked: Soaked) -> None:
    """Print the figures."""
    table, state = soaked.table, soaked.state
    times, memory = soaked.memory.T
    late = times > 0.2 * times[-1]
    slope = np.polyfit(times[late] / 60, memory[late] / 1024, 1)[0] if late.sum() > 2 else float("nan")
    live = table["run"]["live"]
    low, high = memory[late].min() / 1024, memory[late].max() / 1024
    print(f"memory after a fifth of the time: {low:.1f} to {high:.1f} MB, {slope:+.3f} MB a minute")
    size = soaked.log.stat().st_size / 2**20
    print(f"log: {size:.1f} MB; CPU of the live system: {live['cpu_cores']:.2f} cores")
    print(f"frames that the twin could not send: {state['frames_dropped']}")
    for name, device in live["devices"].items():
        print(f"{name}: {json.dumps(device)}")
    for name, stream in table["streams"].items():
        print(f"{name}: {json.dumps(stream)}")
    for name, track in table["tracks"].items():
        print(f"{name}: {json.dumps(track['parameters'])} {track['flags']}")


def main() -> None:
    """Parse and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--silence", type=float, default=0.1, help="limits of silence [s]; 0.6 where cores are shared")
    given = parser.parse_args()
    for when in ("before", "after"):
        print(f"bare loop of 500 Hz {when}: {json.dumps(bare_loop())}", flush=True)
        if when == "before":
            with tempfile.TemporaryDirectory() as folder:
                soaked = soak(given.minutes, given.silence, Path(folder), max(given.minutes, 0.1))
                report(soaked)
    sys.exit(soaked.code)


if __name__ == "__main__":
    main()
