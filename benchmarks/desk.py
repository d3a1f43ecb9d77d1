"""What a key costs on the page of `palpate desk`, over its WebSocket and without a browser.

Run it with: python benchmarks/desk.py [CURVES]. Processor time of the server and its processes for a curve that is
looked at, one that is fitted again and a mark, against the fit itself in this process; wall times of 200 keys on the
machine as it is; bytes of a curve and of the page.
"""

import os
import resource
import statistics
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import numpy as np
from palpate_desk.curve_answers import curve_answer
from palpate_desk.desk import Desk

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.curves.conftest import TIP, press
from tests.desk.conftest import opened, served
from tests.processes import palpate

_TICK = os.sysconf("SC_CLK_TCK")
_FILES = (
    "",
    "page.css",
    "desk.css",
    "main.js",
    "table.js",
    "curve.js",
    "points.js",
    "keys.js",
    "messages.js",
    "charts.js",
)
_OTHERS = ("icon.svg", "uplot/uPlot.iife.min.js", "uplot/uPlot.min.css")


def processor_time(pid):
    """Of a process and its children that live [s]."""
    total = 0.0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(folder.name) == pid or int(fields[1]) == pid:
            total += (int(fields[11]) + int(fields[12])) / _TICK
    return total


def write(folder, count):
    """Curves of 1000 points."""
    (folder / "curves").mkdir()
    for i in range(count):
        table = press(i, 1e5 * (1 + 0.3 * np.sin(i)), 1000)
        np.savetxt(
            folder / f"curves/{i:04d}.csv",
            table,
            delimiter=",",
            header="time_s,force_N,height_mm",
            comments="",
            fmt="%.7g",
        )


def timed(page, pid, messages, answer):
    """Milliseconds of the wall from a message to its answer, each; and of the processor for one."""
    begin, walls, size = processor_time(pid), [], 0
    for message in messages:
        at = time.perf_counter()
        page.ask(**message)
        found = page.read(answer)
        walls.append(1e3 * (time.perf_counter() - at))
        size = sum(part.nbytes for part in found[1]) if isinstance(found, tuple) else 0
    return walls, 1e3 * (processor_time(pid) - begin) / len(walls), size


def told(name, walls, processor):
    """A line of the table."""
    ordered = sorted(walls)
    last = ordered[min(int(0.99 * len(ordered)), len(ordered) - 1)]
    print(f"{name:34s} {processor:8.1f} {statistics.median(walls):8.1f} {last:8.1f}")


def main(count=200):
    """Measure, and print."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write(folder, count)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = palpate("fit", "curves", *TIP, "--out", "fits", "--jobs", "1", cwd=folder)
        assert done.returncode == 0, done.stderr
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        each = 1e3 * (after.ru_utime - before.ru_utime) / count
        print(f"{count} curves of 1000 points; palpate fit: {each:.1f} ms a curve")
        os.chdir(folder)
        desk = Desk(folder / "fits")
        names = desk.folder.names
        curve_answer(desk.reader(names[0]), desk.curve(names[0]), True)
        begin = time.process_time()
        for name in names[:50]:
            curve_answer(desk.reader(name), desk.curve(name), True)
        print(
            f"one read and fitted in this process: {1e3 * (time.process_time() - begin) / 50:.1f} ms of the processor"
        )
        print(f"{'':34s} {'processor':>8s} {'wall ms':>8s} {'99 %':>8s}")
        with served(folder / "fits") as process:
            kept = sum(len(urllib.request.urlopen(process.address + name).read()) for name in (*_FILES, *_OTHERS))
            with opened(process.address) as page:
                page.read("folder")
                timed(page, process.pid, [{"do": "curve", "curve": names[-1], "number": 1}], "curve")
                looks = [{"do": "curve", "curve": name, "number": 1} for name in names[:200]]
                walls, processor, size = timed(page, process.pid, looks, "curve")
                told("a curve is looked at", walls, processor)
                told(
                    "it is fitted again",
                    *timed(page, process.pid, [{"do": "refit", "curve": n} for n in names[:50]], "curve")[:2],
                )
                marks = [{"do": "mark", "curve": name, "mark": "good"} for name in names[:50]]
                told("it is marked", *timed(page, process.pid, marks, "done")[:2])
                words = [{"do": "filter", "words": f"E>{limit}"} for limit in range(60, 110)]
                told("the table is filtered", *timed(page, process.pid, words, "filter")[:2])
        print(f"a curve of 1000 points: {size} bytes; the page: {kept} bytes in {len((*_FILES, *_OTHERS))} requests")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
