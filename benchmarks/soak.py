"""A long live run against the twins: memory, clocks, losses. ``python benchmarks/soak.py --minutes 30``."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

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


def soak(minutes: float, silence: float, folder: Path) -> int:
    """One long press; prints what came of it."""
    host, port = "127.66.0.1", folder / "sensor"
    sets = [f"twin.bench.host={host}", f"twin.bench.port={port}", f"device.arm.host={host}"]
    sets += [f"device.sensor.port={port}", f"trajectory.press.duration={60 * minutes} s"]
    limits = ("device.sensor.silence", "device.arm.stale", "safety.stale")
    sets += [f"{limit}={silence} s" for limit in limits] + [f"device.arm.watchdog={max(1 / silence, 2.0)} Hz"]
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
        seen: list[tuple[float, int]] = []
        watcher = threading.Thread(target=lambda: seen.extend(watch(job, max(minutes, 0.5))))
        watcher.start()
        code = job.wait()
        watcher.join()
        twin.stdin.write("state\n")
        twin.stdin.flush()
        state = json.loads(twin.stdout.readline().removeprefix("state "))
    finally:
        twin.stdin.close()
        twin.wait(10)
    report(seen, json.loads((out / "result.json").read_text()), state, (out / "log.mcap").stat().st_size)
    return code


def report(seen: list[tuple[float, int]], table: dict, state: dict, size: int) -> None:
    """Print the figures."""
    times, memory = np.array(seen).T
    late = times > 0.2 * times[-1]
    slope = np.polyfit(times[late] / 60, memory[late] / 1024, 1)[0] if late.sum() > 2 else float("nan")
    live = table["run"]["live"]
    print(f"memory: {memory[late].min() / 1024:.1f} to {memory[late].max() / 1024:.1f} MB, {slope:+.3f} MB a minute")
    print(f"log: {size / 2**20:.1f} MB; CPU of the live system: {live['cpu_cores']:.2f} cores")
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
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(soak(given.minutes, given.silence, Path(folder)))


if __name__ == "__main__":
    main()
