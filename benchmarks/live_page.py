"""The live page during a live run of the twins, in a real Chromium: ``python benchmarks/live_page.py --seconds 20``.

What the page costs (sink, server, browser), how long a reading takes to the drawn curve, how long a click on "Stop and
retract" takes, and whether the servo loop is later with the page open, its process stopped, or killed, than without.
Wall times depend on the machine: figures are of a quiet one. ``--pictures DIR`` saves what was seen.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Estimates, Floats, Parameter, Run, Samples
from palpate_live.live_feed import PageFeed
from palpate_live.server_process import PageServer

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tests.live_page.browser import Browser, browser  # noqa: E402

PIPELINE = ROOT / "pipelines" / "point_ur3e.toml"
_PALPATE = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]
_FREQUENCY = 2.0  # [Hz] of that pipeline's sine
_TICK = os.sysconf("SC_CLK_TCK")
_JOBS: list[subprocess.Popen[str]] = []  # none is left behind


def cpu_of(pid: int) -> float:
    """Seconds of CPU that a process and its living children have used."""
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return (int(fields[11]) + int(fields[12])) / _TICK + sum(cpu_of(int(child)) for child in children)
    return 0.0


def sink_cost(seconds: int = 60) -> dict[str, float]:
    """CPU of the sink for blocks of 10 ms of 500 Hz and two tracks: share of a core, and microseconds a block."""
    parameters = (Parameter("elasticity", "E", "Pa", ""), Parameter("viscosity", "eta", "Pa*s", ""))
    run = Run(Path(), {}, {"dr/ekf": parameters, "dr/kinematic": parameters}, {}, {})
    child = PageServer(0, None)
    feed = PageFeed(run, child.send, {})
    n, blocks = 5, []
    ones, yes, table = np.ones(n), np.ones(n, bool), np.ones((n, 2))
    for k in range(100 * seconds):
        time_ = (n * k + np.arange(n)) / 500.0
        samples = Samples(np.rint(1e9 * time_).astype(np.int64), time_, ones, ones, ones, ones, yes, yes)
        blocks.append((samples, Estimates(time_, table, table, ones, ones, ones, ones, np.zeros(n, np.uint32))))
    took, before = [], time.thread_time()
    for k, (samples, found) in enumerate(blocks):
        if k % 2 == 0:
            feed._next = 0.0  # a message in 20 ms of the record, as in real time
        began = time.perf_counter()
        feed.samples(samples)
        feed.estimates("dr/ekf", found)
        feed.estimates("dr/kinematic", found)
        took.append(time.perf_counter() - began)
    share = (time.thread_time() - before) / seconds
    child.close()
    quantiles = np.quantile(took, [0.5, 0.99, 1.0]) * 1e6
    return {"share": share, **dict(zip(("p50_us", "p99_us", "max_us"), quantiles.tolist(), strict=True))}


class Twin:
    """The rig in software."""

    def __init__(self, folder: Path, options: list[str]) -> None:
        words = [*_PALPATE, "twin", str(PIPELINE), *options]
        self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        print(self.process.stdout.readline().strip(), flush=True)

    def state(self) -> dict[str, Any]:
        """Where the arm is."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write("state\n")
        self.process.stdin.flush()
        return dict(json.loads(self.process.stdout.readline().removeprefix("state ")))

    def close(self) -> None:
        """End it."""
        self.process.communicate()


class Job:
    """A live run in a process of its own."""

    def __init__(self, folder: Path, options: list[str], page: bool) -> None:
        self.folder = folder
        words = [*_PALPATE, "run", str(PIPELINE), "--out", str(folder), *options, *(["--live"] if page else [])]
        self.process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        _JOBS.append(self.process)
        self.lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        self.address = self.lines.get(timeout=60).removeprefix("live page: ") if page else ""

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.put(line.strip())

    @property
    def server(self) -> int:
        """Process id of the page's server."""
        pid = self.process.pid
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            if b"palpate_live.page_server" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
        raise LookupError("the page has no process")

    def table(self) -> dict[str, Any]:
        """``result.json``, when the run has ended."""
        code = self.process.wait(300)
        live = json.loads((self.folder / "result.json").read_text())["run"]["live"]
        commands = live["devices"]["arm"]["commands"]
        while not self.lines.empty():
            print(f"  said: {self.lines.get()}")
        return {"code": code, "cpu_cores": live["cpu_cores"], "commands": commands, "stop": live.get("stop")}


def shown(name: str, found: dict[str, Any]) -> None:
    """A line."""
    print(f"{name}: {json.dumps(found)}", flush=True)


def with_browser(
    chromium: Browser, job: Job, seconds: float, pictures: Path | None
) -> Iterator[tuple[str, dict[str, Any]]]:
    """One page on a run, then another: what they and the server cost, how late curves are; one is loaded again."""
    first = chromium.open(job.address)
    first.until("window.palpate && window.palpate.draws > 3 && window.palpate.latency.length > 20", 60)
    for pages in (1, 2):
        began, before = time.monotonic(), (cpu_of(job.server), cpu_of(chromium.process.pid))
        time.sleep(seconds / 4)
        elapsed = time.monotonic() - began
        used = (cpu_of(job.server) - before[0], cpu_of(chromium.process.pid) - before[1])
        late = np.array(first.ask("window.palpate.latency"))[-round(25 * seconds) :]  # a quarter of it, at 100 Hz
        came = np.array(first.ask("window.palpate.arrival"))[-round(10 * seconds) :]
        yield f"{pages} open, CPU as share of a core", {"server": used[0] / elapsed, "chromium": used[1] / elapsed}
        yield f"{pages} open, reading to curve, ms", _quantiles(late)
        yield f"{pages} open, newest reading to browser, ms", _quantiles(came)
        if pages == 1:
            second = chromium.open(job.address)
            second.until("window.palpate && window.palpate.draws > 3", 60)
    before_it = second.ask("document.getElementById('time').textContent")
    second.call("Page.reload")
    second.until("window.palpate && window.palpate.draws > 1", 60)
    yield "reload", {"time before": before_it, "after": second.ask("document.getElementById('time').textContent")}
    if pictures is not None:
        first.picture(pictures / "live-page.png")


def _quantiles(values: Floats) -> dict[str, float]:
    return {f"p{round(100 * share)}": round(float(np.quantile(values, share)), 1) for share in (0.5, 0.9)}


def leaving(log: Path, after: float) -> float:
    """When [s] the arm left its sine, both by the host's clock: beyond six times what the second before scatters."""
    from mcap_ros2.reader import read_ros2_messages

    read = (message.ros_msg for message in read_ros2_messages(log, topics=["/arm/twist"]))
    rows = np.array(
        [(found.header.stamp.sec + 1e-9 * found.header.stamp.nanosec, found.twist.linear.z) for found in read]
    )
    rows = rows[np.isfinite(rows[:, 1]) & (rows[:, 0] > after - 1.0)]
    phase = 2 * np.pi * _FREQUENCY * (rows[:, 0] - after)
    terms, before = np.column_stack([np.sin(phase), np.cos(phase), np.ones(len(rows))]), rows[:, 0] < after
    shares = np.linalg.lstsq(terms[before], rows[before, 1], rcond=None)[0]
    off = np.abs(rows[:, 1] - terms @ shares)
    left = rows[~before & (off > 6 * np.std(off[before])), 0]
    return float(left[0]) if len(left) else float("nan")


def stopped(chromium: Browser, job: Job, twin: Twin) -> dict[str, Any]:
    """A click in contact: time to the tripped guard, to the retreat that the log has, and where the arm ends."""
    tab = chromium.open(job.address)
    tab.until("document.getElementById('state')?.textContent === 'moving'", 60)
    while twin.state()["height"] > -0.0035:
        time.sleep(0.05)
    time.sleep(2.0)  # the approach is over
    place = tab.place("stop")
    asked, clock = time.monotonic(), time.time()
    tab.press(*place)
    answer = tab.until("window.palpate.tripped && window.palpate.tripped - window.palpate.asked", 60)
    table = job.table()
    height = twin.state()["height"]
    tripped = 1e3 * (table["stop"]["monotonic"] - asked)
    left = 1e3 * (leaving(job.folder / "log.mcap", clock) - clock)
    return {
        "click to tripped, ms": tripped,
        "to the arm leaving its motion, ms": left,
        "shown after, ms": answer,
        "height at the end, mm": 1e3 * height,
        **table,
    }


def refusals(address: str) -> dict[str, int]:
    """What those get who are not meant."""
    host, token = address.removeprefix("http://").rstrip("/").split("/")
    cases = {
        "no token": ("/", host, None),
        "wrong token": ("/wrong/", host, None),
        "DNS rebinding": (f"/{token}/", "127.0.0.1.evil.example", None),
        "another origin": (f"/{token}/", host, "http://evil.example"),
        "data without an origin": (f"/{token}/data", host, None),
        "the page through a tunnel": (f"/{token}/", "localhost:9000", None),
    }
    found = {}
    for name, (path, given, origin) in cases.items():
        connection = http.client.HTTPConnection(host, timeout=20)
        connection.request("GET", path, headers={"Host": given, **({"Origin": origin} if origin else {})})
        found[name] = connection.getresponse().status
    return found


def main() -> None:
    """Parse and run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of sine in each run")
    parser.add_argument("--silence", type=float, default=0.1, help="limits of silence [s]; 2 where cores are shared")
    parser.add_argument("--clicks", type=int, default=3, help="runs that are stopped by a click")
    parser.add_argument("--pictures", type=Path)
    given = parser.parse_args()
    shown("sink", sink_cost())
    with tempfile.TemporaryDirectory() as name, browser() as chromium:
        folder, host = Path(name), "127.66.0.2"
        port = folder / "sensor"
        sets = [f"twin.bench.host={host}", f"twin.bench.port={port}", f"device.arm.host={host}"]
        sets += [f"device.sensor.port={port}", f"trajectory.press.duration={given.seconds} s"]
        limits = ("device.sensor.sensor_timeout", "device.arm.controller_timeout", "safety.sensor_timeout")
        sets += [f"{limit}={given.silence} s" for limit in limits]
        sets += [f"device.arm.watchdog={max(1 / given.silence, 1.0)} Hz"]
        sets += [f"device.arm.host_timeout={max(2 * given.silence, 0.1)} s"] if given.silence > 0.1 else []
        options = [word for item in sets for word in ("--set", item)]
        twin = Twin(folder, options)
        try:
            shown("without the page", Job(folder / "plain", options, False).table())
            job = Job(folder / "page", options, True)
            shown("refused", refusals(job.address))
            for line in with_browser(chromium, job, given.seconds, given.pictures):
                shown(*line)
            shown("with the page", job.table())
            for how in (signal.SIGSTOP, signal.SIGKILL):
                job = Job(folder / how.name, options, True)
                time.sleep(4.0)
                os.kill(job.server, how)
                shown(f"page with {how.name}", job.table())
            for k in range(given.clicks):
                shown("stopped by a click", stopped(chromium, Job(folder / f"click-{k}", options, True), twin))
        finally:
            for left in _JOBS:
                left.send_signal(signal.SIGTERM)  # the arm retracts; one that has ended hears nothing
                left.wait(60)
            twin.close()


if __name__ == "__main__":
    main()
