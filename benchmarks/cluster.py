"""What a cluster costs against the size of its work, and what is left of a thousand runs where each part of it dies.

    python benchmarks/cluster.py runs [--count 10 100 1000]            a sweep: a second of contact with one filter each
    python benchmarks/cluster.py curves [--count 1000 10000 100000]    `fit --each`, curves of 1000 samples
    python benchmarks/cluster.py troubles [--count 1000]               the sweep, with what follows

A scheduler and three workers of `dask`, each a process of its own, and the real commands. Costs are processor time of
the command and of the scheduler, a job, and the command's memory (PSS). `troubles` kills a worker when a fifth of the
runs is done, the client at two fifths, the scheduler at three fifths, and has a worker run out of memory at four
fifths; what was stopped is begun again with the same words. Then every run must be there once, with the numbers of this
machine; it says how many were begun twice.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import many_curves
import numpy as np
from loads import HEADING, PALPATE, swept, watched
from soak import family

WORKERS = 3
_TICK = os.sysconf("SC_CLK_TCK")


def processor(pid: int) -> float:
    """Processor time [s] of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICK


class Cluster:
    """A scheduler and its workers."""

    def __init__(self, folder: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self._port = free.getsockname()[1]
        self.address, self._folder = f"tcp://127.0.0.1:{self._port}", folder
        self.begin()

    def begin(self) -> None:
        """Restart all of it, at the same address."""
        self._log = (self._folder / "cluster.log").open("a")
        where = ("--host", "127.0.0.1", "--port", self._port, "--no-dashboard")
        self.scheduler = self._started("dask_scheduler", *where)
        many = ("--nworkers", WORKERS, "--nthreads", 1, "--memory-limit", "700MB", "--no-dashboard")
        self.workers = self._started("dask_worker", self.address, *many, "--local-directory", self._folder / "dask")
        from distributed import Client

        with Client(self.address, timeout="60s", set_as_default=False) as client:
            client.wait_for_workers(WORKERS)

    def _started(self, module: str, *words: object) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, words)]
        environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "false"}  # as docs/cluster.md has it
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=self._log, stderr=self._log, env=environment)

    def worker(self) -> int:
        """The process of one worker: a child of the nannies."""
        return next(
            pid for pid in family(self.workers.pid) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
        )

    def end(self) -> None:
        """All of it."""
        for process in (self.workers, self.scheduler):
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._log.close()


@contextlib.contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """A cluster for a while."""
    running = Cluster(folder)
    try:
        yield running
    finally:
        running.end()


def measured(running: Cluster, count: int, *words: object) -> None:
    """The rows of a command on a cluster: itself, and what a job costs without the workers' work."""
    before = processor(running.scheduler.pid)
    found = watched(f"{words[0]}, {count}", *words, "--scheduler", running.address)
    scheduler = processor(running.scheduler.pid) - before
    each = 1e3 * (found.cpu + scheduler) / count
    print(f"    command {found.cpu:.1f} s, scheduler {scheduler:.1f} s: {each:.2f} ms each", flush=True)


def runs(folder: Path, counts: list[int]) -> None:
    """Sweeps of several sizes, on a new cluster each."""
    for count in counts:
        with cluster(folder) as running:
            measured(running, count, "sweep", swept(folder, count), "--out", folder / f"runs{count}")


def curves(folder: Path, counts: list[int]) -> None:
    """Folders of several sizes: a thousand different curves, under as many names as there are to be."""
    (folder / "made").mkdir()
    with contextlib.chdir(folder / "made"):
        many_curves.write(1000)
    (folder / "reader.toml").write_text(many_curves.PIPELINE.replace("PROFILE", "true").replace("0.csv", "made/0.csv"))
    for count in counts:
        place = folder / f"curves{count}"
        place.mkdir()
        for i in range(count):
            os.link(folder / "made" / f"{i % 1000}.csv", place / f"{i:06}.csv")
        words = ("fit", "--each", place, "--pipeline", folder / "reader.toml", "--out", folder / f"fits{count}")
        with cluster(folder) as running:
            measured(running, count, *words)


def troubles(folder: Path, counts: list[int]) -> None:
    """A sweep while parts of the cluster die; what is left must be what this machine makes."""
    for count in counts:
        _troubled(folder, count)


def _troubled(folder: Path, count: int) -> None:
    pipeline, out = swept(folder, count), folder / f"troubles{count}"
    words = ("sweep", pipeline, "--out", out)
    fifths = {k: k * count // 5 for k in range(1, 5)}

    def done() -> int:
        return sum(1 for _ in out.glob("*/answer.json")) if out.is_dir() else 0

    def until(wanted: int) -> None:
        while done() < wanted:
            time.sleep(0.05)

    with cluster(folder) as running:
        on = (*words, "--scheduler", running.address)

        def kill_worker() -> None:
            until(fifths[1])
            os.kill(running.worker(), signal.SIGKILL)

        threading.Thread(target=kill_worker, daemon=True).start()
        client = subprocess.Popen([*PALPATE, *map(str, on)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        until(fifths[2])
        client.kill()
        client.wait()
        print(f"client killed, {done()} done", flush=True)

        def kill_scheduler() -> None:
            until(fifths[3])
            running.scheduler.kill()

        threading.Thread(target=kill_scheduler, daemon=True).start()
        watched("scheduler killed", *on, code=2)
        running.end()
        running.begin()

        def exhaust() -> None:
            from distributed import Client

            until(fifths[4])
            with Client(running.address, set_as_default=False) as other:
                hungry = other.submit(_hungry, pure=False, retries=0)
                print(f"out of memory: {type(hungry.exception(timeout=300)).__name__}", flush=True)

        hunger = threading.Thread(target=exhaust)
        hunger.start()
        watched("worker out of memory", *on)
        hunger.join()
    with (out / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    again = sum(1 for path in out.iterdir() if path.is_dir() and "." in path.name)
    print(f"{len(rows)} rows of {count}, {done()} whole runs, {again} begun twice", flush=True)
    watched("the same here", "sweep", pipeline, "--out", folder / f"here{count}")
    own, theirs = ((folder / place / "sweep.csv").read_text() for place in (f"here{count}", f"troubles{count}"))
    print("table as here" if _values(own) == _values(theirs) else "TABLE DIFFERS", flush=True)


def _values(text: str) -> list[dict[str, str]]:
    """The rows of a table, without how long a run took and where it is."""
    return [
        {key: value for key, value in row.items() if not key.startswith(("seconds", "folder", "run"))}
        for row in csv.DictReader(text.splitlines())
    ]


def _hungry() -> int:
    """What needs more memory than a worker may have."""
    held = []
    for _ in range(100):
        held.append(np.ones(10_000_000))
        time.sleep(0.2)
    return len(held)


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    sizes = {"runs": [10, 100, 1000], "curves": [1000, 10_000, 100_000], "troubles": [1000]}
    parser.add_argument("what", choices=sizes)
    parser.add_argument("--count", type=int, nargs="+")
    parser.add_argument("--folder", type=Path, help="where gigabytes may be written; it is empty again in the end")
    options = parser.parse_args()
    print(HEADING, flush=True)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        {"runs": runs, "curves": curves, "troubles": troubles}[options.what](
            Path(folder), options.count or sizes[options.what]
        )


if __name__ == "__main__":
    main()
