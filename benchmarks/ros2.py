"""Topics by DDS for a while: lost, late, and what it costs. ``python benchmarks/ros2.py --seconds 60``.

The publisher is a program in C++ with Fast DDS, the library under rmw_fastrtps (apt install g++ libfastrtps-dev): joint
states at 500 Hz and a wrench at 800 Hz of a UR3e that presses a 5 mm sphere into S2. Every wrench has its number, so
that what is lost is known; late is its arrival after it was written, over the least such time (some 0.1 ms). It ends
with exit code 1 where a message is lost.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from palpate_devices.logs.kinematics import Kinematics
from palpate_devices.logs.mapping import MappedSignal
from palpate_devices.ros2.device import Ros2Device

SOURCE = Path(__file__).parents[1] / "tests" / "devices" / "ros2" / "publisher.cpp"
_BASE = np.array([0.0, -1.5708, -1.5708, -1.5708, 1.5708, 0.0])  # a UR3e that looks down
_PERIOD = 4.0  # [s] of the table, which is gone through again and again


def program(folder: Path) -> Path:
    """The publisher, built."""
    found = folder / hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]
    if not found.exists():
        command = ["g++", "-O2", "-std=c++17", str(SOURCE), "-o", str(found), "-lfastrtps", "-lfastcdr", "-lpthread"]
        subprocess.run(command, check=True)
    return found


def table(robot: Kinematics, joint_rate: float, wrench_rate: float) -> list[str]:
    """Lines for the publisher."""
    names = [joint.name for joint in robot.chain]
    order = [names.index(name) for name in sorted(names)]

    def angles(times: np.ndarray) -> np.ndarray:
        found = np.tile(_BASE, (len(times), 1))
        found[:, 1] += 0.004 * np.sin(2 * np.pi * times * 2.0)
        return found

    lines = []
    for k, row in enumerate(angles(np.arange(0, _PERIOD, 1 / joint_rate)).tolist()):
        words = " ".join(f"{row[i]!r}" for i in order)
        lines.append((k / joint_rate, f"/joint_states {words} 0 0 0 0 0 0"))
    times = np.arange(0, _PERIOD, 1 / wrench_rate)
    height = robot.pose(angles(times))[:, 2]
    depth = np.maximum(height.mean() - height, 0)
    force = 16 / 9 * 112.5e3 * np.sqrt(5e-3) * depth**1.5
    lines += [(t, f"/wrench {k} 0 {f!r} 0 0 0") for k, (t, f) in enumerate(zip(times.tolist(), force.tolist()))]
    return ["topic /joint_states joints", "topic /wrench wrench", *(f"{t:.6f} {line}" for t, line in sorted(lines))]


def cpu(pid: int) -> float:
    """Seconds of processor that a process has taken."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def measure(seconds: float, joint_rate: float, wrench_rate: float, domain: int) -> dict[str, object]:
    """What came of it."""
    robot = Kinematics(topic="/joint_states", robot="ur3e", tcp=(0.0, 0.0, 0.12))
    number = MappedSignal(topic="/wrench", field="wrench.force.x")
    device = Ros2Device(
        domain=domain, interface="lo", kinematics=robot, signals={"number": number}, time="publish", patience=15.0
    )
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder) / "table.txt"
        lines.write_text("\n".join(table(robot, joint_rate, wrench_rate)) + "\n")
        times = str(int(seconds / _PERIOD) + 3)
        command = [str(program(Path(tempfile.gettempdir()))), str(domain), str(lines), "0", times]
        publisher = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            with device.connect(0) as link:
                worker, began, before = link._source.child.pid, time.monotonic(), (cpu(os.getpid()), 0.0)
                before = (before[0], cpu(worker))
                batches = {"number": [], "late": []}
                for batch in link.batches():
                    if batch.stream == "wrench" and len(batch.time):
                        batches["number"].append(batch.values[:, 0])
                        batches["late"].append(batch.received - batch.time)
                    if time.monotonic() - began > seconds:
                        break
                took = time.monotonic() - began
                spent = cpu(os.getpid()) - before[0], cpu(worker) - before[1]
                topics = link.health["topics"]
        finally:
            publisher.kill()
            publisher.wait()
    numbers, late = np.concatenate(batches["number"]), np.concatenate(batches["late"]) / 1e6
    count = round(_PERIOD * wrench_rate)
    lost = int(((np.diff(numbers) - 1) % count).sum())
    return {
        "seconds": round(took, 1),
        "load": os.getloadavg()[0],
        "wrenches": len(numbers),
        "lost": lost,
        "joint states": topics["/joint_states"]["messages"],
        "late over the least [ms], p50, p99, max": [round(float(x), 3) for x in np.percentile(late, (50, 99, 100))],
        "processor of the listening process [%]": round(100 * spent[1] / took, 1),
        "processor of the main process [%]": round(100 * spent[0] / took, 1),
    }


def main() -> None:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--joint-rate", type=float, default=500.0)
    parser.add_argument("--wrench-rate", type=float, default=800.0)
    parser.add_argument("--domain", type=int, default=77)
    options = parser.parse_args()
    found = measure(options.seconds, options.joint_rate, options.wrench_rate, options.domain)
    print(json.dumps(found, indent=2))
    sys.exit(bool(found["lost"]))


if __name__ == "__main__":
    main()
