"""A long live run against the twins: memory, clocks, losses. ``python benchmarks/soak.py --minutes 30 -o soak.jsonl``.

The file gets a line with the memory over time and, at the end, the table; Ctrl-C ends the run, and what it was
until then is judged. It ends with a verdict, and with exit code 1 where one is bad: after three hours, by the slope of
the last four fifths of the time, memory must be within its budget; nothing may be lost; and both devices' clocks must
stay with the host's as they say. Where the slope's uncertainty leaves that open, it says so: no pass, and no failure.
How late estimates come, what waited and which periods had no command is reported with the load, and not judged:
that is the machine's.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate_devices.mcap_replay import McapReplay

PIPELINE = Path(__file__).parents[1] / "pipelines" / "point_ur3e.toml"
_PALPATE = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]
_PERIOD = 1.25e6  # [ns] of the sensor
_HOURS = 3.0  # that a run may take
_MEMORY = 250.0  # [MB] of all processes, every page once, after that time
_DRIFT = 0.3e-3  # [s] that the pipeline declares


def family(pid: int) -> list[int]:
    """A process and its children, whichever of its threads has begun them."""
    try:
        children = [int(word) for task in Path(f"/proc/{pid}/task").iterdir() for word in _words(task / "children")]
    except OSError:
        return []
    return [pid, *(member for child in children for member in family(child))]


def _words(file: Path) -> list[str]:
    try:
        return file.read_text().split()
    except OSError:  # the thread has ended
        return []


def mapped(pid: int) -> tuple[int, int, dict[str, int]]:
    """Proportional share, anonymous pages, and the pages of each file that a process has in memory [kB]."""
    share, anonymous, files, name = 0, 0, dict[str, int](), ""
    for line in Path(f"/proc/{pid}/smaps").read_text().splitlines():
        words = line.split(maxsplit=5)
        match words[0]:
            case "Rss:":
                files[name] = files.get(name, 0) + int(words[1])
            case "Pss:":
                share += int(words[1])
            case "Anonymous:":
                anonymous += int(words[1])
                files[name] -= int(words[1])
            case first if not first.endswith(":"):
                # Two pieces of memory without a name are two, though both are called "palpate".
                name = f"{words[4]} {words[5]}" if len(words) > 5 else ""
    return share, anonymous, files


@dataclass(frozen=True)
class Look:
    """What a job and its children hold at an instant."""

    time: float  # [s]
    processes: int
    share: int  # [kB] proportional share (PSS) of all: what others on this machine map as well counts in part
    own: int  # [kB] anonymous pages of all, and every page of a file once: does not depend on who else is there
    descriptors: int
    threads: int

    @classmethod
    def at(cls, pid: int, time: float) -> Look:
        """A job, now."""
        share = own = processes = descriptors = threads = 0
        once: dict[str, int] = {}
        for member in family(pid):
            with contextlib.suppress(OSError):
                its, anonymous, files = mapped(member)
                descriptors += len(os.listdir(f"/proc/{member}/fd"))
                threads += len(os.listdir(f"/proc/{member}/task"))
                processes, share, own = processes + 1, share + its, own + anonymous
                for name, pages in files.items():
                    once[name] = max(once.get(name, 0), pages)
        return cls(time, processes, share, own + sum(once.values()), descriptors, threads)


def watch(job: subprocess.Popen[bytes], interval: float, file: Path) -> list[Look]:
    """Looks until the job ends; Ctrl-C, which it hears as well, ends it sooner."""
    began, seen = time.monotonic(), []
    while job.poll() is None:
        seen.append(Look.at(job.pid, time.monotonic() - began))
        write(file, asdict(seen[-1]) | {"load": os.getloadavg()[0]})
        with contextlib.suppress(KeyboardInterrupt, subprocess.TimeoutExpired):
            job.wait(interval)
    return seen


def write(file: Path, row: dict[str, Any]) -> None:
    """Append a line."""
    with file.open("a") as lines:
        lines.write(json.dumps(row) + "\n")


def late(looks: list[Look]) -> list[Look]:
    """Looks of the last four fifths of the time; while processes begin or end they lack one of them, and do not count.

    The last one may be of a job that is about to go.
    """
    most = max(look.processes for look in looks)
    return [look for look in looks[:-1] if look.processes == most and look.time > 0.2 * looks[-1].time]


def slope(looks: list[Look]) -> tuple[float, float]:
    """How fast memory rises and its standard error [MB a minute], over the last four fifths of the time."""
    time, own = (np.array([getattr(look, key) for look in late(looks)], float) for key in ("time", "own"))
    if len(time) < 4:
        return float("nan"), float("nan")
    line, covariance = np.polyfit(time / 60, own / 1024, 1, cov=True)
    return float(line[0]), float(np.sqrt(covariance[0, 0]))


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
        deadline += late[-1] // period * period  # like the servo loop, it does not make up for them
    elapsed = time.monotonic() - began
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    p50, p99 = np.quantile(late, [0.5, 0.99]).tolist()
    missed = sum(x > period for x in late)
    return {"p50": p50, "p99": p99, "largest": max(late), "missed": missed, "rate": len(late) / elapsed}


@dataclass(frozen=True)
class Soaked:
    """What a soak left behind."""

    code: int  # of the job
    looks: list[Look]
    table: dict[str, Any]  # result.json
    state: dict[str, Any]  # of the twin
    log: Path


def soak(minutes: float, silence: float, folder: Path, every: float, file: Path, host: str = "127.66.0.1") -> Soaked:
    """One long press against the twins, with a look at the memory every so often [s]."""
    port = folder / "sensor"
    sets = [f"twin.bench.host={host}", f"twin.bench.port={port}", f"device.arm.host={host}"]
    sets += [f"device.sensor.port={port}", f"trajectory.press.duration={60 * minutes} s"]
    limits = ("device.sensor.sensor_timeout", "device.arm.controller_timeout", "safety.sensor_timeout")
    sets += [f"{limit}={silence} s" for limit in limits] + [f"device.arm.host_timeout={max(silence, 0.25)} s"]
    sets += [f"device.arm.watchdog={max(1 / silence, 1.0)} Hz"]
    options = [word for item in sets for word in ("--set", item)]
    twin = subprocess.Popen(
        [*_PALPATE, "twin", str(PIPELINE), *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,  # Ctrl-C is for the job
    )
    assert twin.stdin is not None
    assert twin.stdout is not None
    try:
        print(twin.stdout.readline().strip())
        out = folder / "out"
        job = subprocess.Popen([*_PALPATE, "run", str(PIPELINE), "--out", str(out), *options])
        looks = watch(job, every, file)
        twin.stdin.write("state\n")
        twin.stdin.flush()
        state = json.loads(twin.stdout.readline().removeprefix("state "))
    finally:
        twin.stdin.close()
        twin.wait(10)
        twin.stdout.close()
    return Soaked(job.returncode, looks, json.loads((out / "result.json").read_text()), state, out / "log.mcap")


def recorded(log: Path, device: str, stream: str) -> tuple[np.ndarray, np.ndarray]:
    """Stamps [ns] and values of a stream."""
    with McapReplay(file=log, recorded=device).connect(0) as link:
        batches = [batch for batch in link.batches() if batch.stream == stream]
    return np.concatenate([b.time for b in batches]), np.concatenate([b.values for b in batches])


def drifts(log: Path) -> dict[str, float]:
    """By how much [s] each device's stamps have moved against its own clock from the second second to the last.

    The twin's sensor takes a reading every 1.25 ms of true time and stamps it with a clock that is 20 ppm fast.
    """
    stamps, _ = recorded(log, "sensor", "wrench")
    sensor = (stamps - stamps[0]) - _PERIOD * np.arange(len(stamps))
    stamps, values = recorded(log, "arm", "status")
    arm = stamps - stamps[0] - 1e9 * (values[:, 0] - values[0, 0])
    found = {}
    for name, apart, second in (("sensor", sensor, 800), ("arm", arm, 500)):
        found[name] = float(np.median(apart[-second:]) - np.median(apart[second : 2 * second])) / 1e9
    return found


def memory_verdict(looks: list[Look]) -> tuple[bool | None, str]:
    """Whether memory is within its budget after three hours; None where the slope is not known well enough."""
    most = max(look.own for look in looks) / 1024
    rise, error = slope(looks)
    minutes = max(60 * _HOURS - looks[-1].time / 60, 0.0)
    least, then = (most + max(rise + by * error, 0.0) * minutes for by in (-2.0, 2.0))
    good = True if then <= _MEMORY else False if max(most, least) > _MEMORY else None
    text = f"{most:.1f} MB, rising by {rise:+.3f} +- {error:.3f} a minute: {least:.0f} to {then:.0f} after {_HOURS:g} h"
    return good, f"memory: {text}; {_MEMORY:.0f} are allowed"


def verdicts(soaked: Soaked) -> Iterator[tuple[bool | None, str]]:
    """What must hold, and whether it does; None where this run does not show it."""
    live, state = soaked.table["run"]["live"], soaked.state
    yield soaked.code == 0, f"the job ends with exit code {soaked.code}"
    yield memory_verdict(soaked.looks)
    counted = late(soaked.looks) or soaked.looks
    for what in ("descriptors", "threads"):
        first, last = getattr(counted[0], what), getattr(counted[-1], what)
        yield first == last, f"{what}: {first} after a fifth of the time, {last} at the end"
    sensor, arm = live["devices"]["sensor"], live["devices"]["arm"]
    lost = state["frames_dropped"] + sensor["damaged"] + sensor["unusable"]
    lost += sensor["readings"] - soaked.table["streams"]["sensor.wrench"]["samples"]
    yield lost == 0, f"{lost} readings of the sensor were dropped, damaged or not recorded"
    for name, drift in drifts(soaked.log).items():
        allowed = max(live["devices"][name]["clock_wander"], _DRIFT)
        yield abs(drift) < allowed, f"clock of the {name}: {1e3 * drift:+.3f} ms apart, {1e3 * allowed:.3f} ms allowed"
    yield True, f"{live['largest_backlog']} batches waited at most; none is left, or the estimates would end early"
    latency = live["estimates"]["latency"] or {}
    figures = ", ".join(f"{key} {1e3 * value:.1f} ms" for key, value in latency.items())
    yield True, f"from a reading to its estimate: {figures}; {live['estimates']['largest_behind']:.2f} s behind at most"
    rate, missed = arm["commands"].get("rate", float("nan")), arm["commands"]["missed"]
    yield True, f"commands: {rate:.2f} Hz, {missed} of {arm['commands']['cycles']} late by more than a period"
    yield True, f"the live system takes {live['cpu_cores']:.2f} cores; load {os.getloadavg()[0]:.1f}"
    periods = arm["commands"]["periods_lost"]
    yield True, f"{periods} periods of the servo loop were lost, {arm['commands']['periods_lost_to_host']} to the host"


def report(soaked: Soaked, file: Path) -> bool:
    """Print the figures, and add them to the file; whether all is well."""
    table = soaked.table
    live = table["run"]["live"]
    most = {key: max(getattr(look, key) for look in soaked.looks) / 1024 for key in ("own", "share")}
    print(f"memory: {most['own']:.1f} MB at most, every page once; proportional share {most['share']:.1f} MB at most")
    size = soaked.log.stat().st_size / 2**20
    print(f"log: {size:.1f} MB; CPU of the live system: {live['cpu_cores']:.2f} cores")
    for name, device in live["devices"].items():
        print(f"{name}: {json.dumps(device)}")
    for name, stream in table["streams"].items():
        print(f"{name}: {json.dumps(stream)}")
    for name, track in table["tracks"].items():
        print(f"{name}: {json.dumps(track['parameters'])} {track['flags']}")
    found = list(verdicts(soaked))
    write(file, {"live": live, "streams": table["streams"], "verdicts": found})
    for good, text in found:
        print(f"{ {True: 'ok ', False: 'BAD', None: '?  '}[good] } {text}")
    return all(good is not False for good, _ in found)


def main() -> None:
    """Parse and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--silence", type=float, default=0.1, help="limits of silence [s]; 0.6 where cores are shared")
    parser.add_argument("-o", "--output", type=Path, default=Path("soak.jsonl"))
    given = parser.parse_args()
    print(f"bare loop of 500 Hz before: {json.dumps(bare_loop())}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        every = max(min(given.minutes, 10.0), 0.2)
        good = report(soak(given.minutes, given.silence, Path(folder), every, given.output), given.output)
    print(f"bare loop of 500 Hz after: {json.dumps(bare_loop())}", flush=True)
    sys.exit(not good)


if __name__ == "__main__":
    main()
