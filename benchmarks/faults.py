"""Every fault of the twins during contact: what the user sees, when the job learns of it, when the arm has stopped.

``python benchmarks/faults.py [contact] [start] [force] [tricks] [--repeats 3] [-o faults.jsonl]``: measures those
tables of results/faults.md, all where none is named. Each measurement is a line of the file as soon as it is made;
started again it goes on with those that the file lacks, and prints the tables of all. ``--table`` only prints. "still"
is when the tip first stood or turned, "free" when it was out of the material by itself, "deeper" how far it went on.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import json
import os
import tempfile
import threading
import time
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

from palpate.errors import DeviceError

_SURFACE = 0.0003  # [m]
_FAULTS = (
    *("protective-stop", "safeguard-stop", "emergency-stop", "stop-program", "pause-program"),
    *("freeze", "half", "stall 0.4", "close", "reset", "gone"),
    *("stuck-pose", "nan-pose", "jam", "mute-control", "half-open 0.6", "slider 0.6", "reduced", "robot-mode 6"),
    "short-states 200",
    *("unplug", "end-stream", "silent", "reboot", "overrange", "saturated", "raw"),
    *("stuck-force", "clipped-force 3", "speed-scaling 0.6"),
)


@cache
def devices_conftest() -> ModuleType:
    """The tests' handle on twins."""
    path = Path(__file__).parents[1] / "tests" / "devices" / "conftest.py"
    spec = importlib.util.spec_from_file_location("devices_conftest", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def measured(twin: Any, fault: str, folder: Path) -> dict[str, Any] | None:
    """One fault, as soon as the tip is 3 mm below the work frame; None where something else ended the run before."""
    track, begun, over = [], [], threading.Event()

    def follow() -> None:
        while not over.is_set():
            state = twin.state()
            track.append((state["time"], state["height"], state["tip_speed"]))
            if not begun and state["height"] < -0.003:
                begun.append((twin.fault(fault), state["height"]))
            time.sleep(0.003)

    thread = threading.Thread(target=follow)
    thread.start()
    text = "nothing"
    try:
        twin.run('run.tracks=["dr/ekf"]', out=folder.name, limits=())
    except DeviceError as error:
        text = str(error).split(" (what was found")[0]
    time.sleep(0.3)
    over.set()
    thread.join()
    if not begun:  # the machine itself was at fault before
        return None
    began, began_height = begun[0]
    stop = json.loads((twin.folder / folder.name / "result.json").read_text())["run"].get("live", {}).get("stop")
    if stop is None or stop["monotonic"] < began:
        return None
    after = [row for row in track if row[0] > began]
    still = next((t for t, _, speed in after if speed < 1e-3), float("nan"))
    turned = next((t for (t, h, _), (_, later, _) in pairwise(after) if later > h + 1e-6), float("nan"))
    deeper = began_height - min(height for _, height, _ in after)
    free = next((t for t, height, _ in after if height > _SURFACE), float("nan"))
    return {
        "text": text,
        "learnt": stop["monotonic"] - began,
        "still": min(still, turned) - began,
        "free": free - began,
        "deeper": deeper,
        "peak": twin.state()["peak_force"],
    }


_STARTS = (  # fault, overrides of the run
    *((fault, ()) for fault in ("gone", "mute", "no-port 30003", "no-port 29999", "no-greeting", "local")),
    *((fault, ()) for fault in ("emergency-stop", "protective-stop", "lack actual_TCP_force", "refuse-start", "deaf")),
    ("freeze", ()),
    ("unplug", ()),
    ("refuse f", ()),
    ("slow 1.0", ("trajectory.press.duration=0.2 s",)),
    ("restore", ("device.sensor.baud=115200",)),
    ("restore", ("device.sensor.sinc=40",)),
)


def contact(twin: Any, fault: str, folder: Path) -> dict[str, Any]:
    """One fault in contact, and what it did."""
    for attempt in range(10):
        twin.fault("restore")
        row = measured(twin, fault, folder.with_name(f"{folder.name}-{attempt}"))
        if row is not None:
            return row
    return {"text": "the machine never let a run come to the fault"}


def start(twin: Any, words: str, folder: Path) -> dict[str, Any]:
    """One fault that is there before the run: what the user sees, and after how long."""
    fault, overrides = next((fault, options) for fault, options in _STARTS if " ".join([fault, *options]) == words)
    twin.fault("restore")
    twin.fault(fault)
    began, text = time.monotonic(), "runs"
    try:
        twin.run(*overrides, out=folder.name, limits=())
    except DeviceError as error:
        text = str(error).split(" (what was found")[0]
    return {"text": text, "after": time.monotonic() - began}


def force(_: Any, case: str, folder: Path) -> dict[str, Any]:
    """What is under the tip and was not expected: speed, way and latency beyond the limit, largest force."""
    module = devices_conftest()
    overrides, options, elasticity = module.ForceLimit.cases[case]
    folder.mkdir()
    twin, text = module.Bench(folder, (*module.SHORT, *overrides)), "runs"
    try:
        try:
            twin.run(*options, limits=())
        except DeviceError as error:
            text = str(error).split(" (what was found")[0]
        speed, way, latency = module.ForceLimit.overrun(folder / "out")
        bound = module.ForceLimit.bound(elasticity, speed)
        figures = {"speed": speed, "way": way, "latency": latency, "peak": twin.state()["peak_force"], "bound": bound}
        return {"text": text, **figures}
    finally:
        twin.close()


_TRICKS = (  # what, the tip's start [mm, deg], elasticity [Pa], overrides of the run
    ("tool off by 3 deg", (0, 0, 4, 3, 0, 0), 112.5e3, ()),
    ("tool off by 8 deg", (0, 0, 4, 8, 0, 0), 112.5e3, ()),
    ("tool off by 90 deg about its axis", (0, 0, 4, 0, 0, 90), 112.5e3, ()),
    ("5 mm deep at the start, 18 N", (0, 0, -5, 0, 0, 0), 366e3, ()),
    ("the same, 50 N at standstill allowed", (0, 0, -5, 0, 0, 0), 366e3, ("safety.standstill_force=50 N",)),
    ("the same, 60 N allowed", (0, 0, -5, 0, 0, 0), 366e3, ("safety.standstill_force=50 N", "safety.force=60 N")),
    ("a joint may turn at 2 deg/s", (0, 0, 4, 0, 0, 0), 112.5e3, ("device.arm.joint_speed=2 deg/s",)),
)


def trick(twin: Any, what: str, folder: Path) -> dict[str, Any]:
    """A start that no limit allows: how it ended, and what the arm truly did."""
    _, start, elasticity, overrides = next(row for row in _TRICKS if row[0] == what)
    for words in (f"start {' '.join(map(str, start))}", f"elasticity {elasticity}", "restore", "mark"):
        twin.fault(words)
    text = "runs"
    try:
        twin.run('run.tracks=["dr/ekf"]', *overrides, out=folder.name, limits=())
    except DeviceError as error:
        text = str(error).split(" (what was found")[0]
    state = twin.state()
    twin.fault("start 0 0 4 0 0 0")
    figures = {"tip": state["fastest_tip"], "joint": state["fastest_joint"], "lowest": state["low"][2]}
    return {"text": text, **figures, "peak": state["peak_force"]}


Measure = Callable[[Any, str, Path], dict[str, Any]]
# By table: what measures a row, the rows, and the columns with their factor and unit.
_TABLES: dict[str, tuple[Measure, tuple[str, ...], dict[str, tuple[float, str]]]] = {
    "contact": (
        contact,
        _FAULTS,
        {**dict.fromkeys(("learnt", "still", "free"), (1e3, "ms")), "deeper": (1e3, "mm"), "peak": (1.0, "N")},
    ),
    "start": (start, tuple(" ".join([fault, *options]) for fault, options in _STARTS), {"after": (1.0, "s")}),
    "force": (
        force,
        tuple(devices_conftest().ForceLimit.cases),
        {"speed": (1e3, "mm/s"), "way": (1e3, "mm"), "latency": (1e3, "ms"), "peak": (1.0, "N"), "bound": (1.0, "N")},
    ),
    "tricks": (
        trick,
        tuple(row[0] for row in _TRICKS),
        {"tip": (1e3, "mm/s"), "joint": (57.3, "deg/s"), "lowest": (1e3, "mm"), "peak": (1.0, "N")},
    ),
}


def measure(tables: list[str], repeats: int, file: Path) -> None:
    """Everything that the file lacks, row by row."""
    known = {(row["table"], row["what"], row["repeat"]) for row in read(file)}
    jobs = [(name, what, i) for name in tables for what in _TABLES[name][1] for i in range(repeats)]
    module = devices_conftest()
    with tempfile.TemporaryDirectory() as folder:
        twin = module.Bench(Path(folder), module.SHORT)
        try:
            for number, (name, what, i) in enumerate(job for job in jobs if job not in known):
                found = _TABLES[name][0](twin, what, Path(folder) / f"run{number}")
                row = {"table": name, "what": what, "repeat": i, "load": os.getloadavg()[0], **found}
                with file.open("a") as lines:
                    lines.write(json.dumps(row) + "\n")
                print(json.dumps(row), flush=True)
        finally:
            twin.close()


def read(file: Path) -> list[dict[str, Any]]:
    """The measurements that a file has; a line that was cut does not count."""
    rows = []
    for line in file.read_text().splitlines() if file.exists() else ():
        with contextlib.suppress(json.JSONDecodeError):
            rows.append(json.loads(line))
    return rows


def show(rows: list[dict[str, Any]]) -> None:
    """The tables: median (largest) of each column."""
    for name, (_, order, columns) in _TABLES.items():
        those = [row for row in rows if row["table"] == name]
        if not those:
            continue
        heads = (f"{key} {unit}" for key, (_, unit) in columns.items())
        print(f"\n| {name} | what the user sees | {' | '.join(heads)} |\n|{'---|' * (len(columns) + 2)}")
        for what in order:
            same = [row for row in those if row["what"] == what]
            if same:
                cells = (
                    _cell([factor * row.get(key, float("nan")) for row in same]) for key, (factor, _) in columns.items()
                )
                print(f"| {what} | {same[0]['text']} | {' | '.join(cells)} |")
        load = sorted(row["load"] for row in those)
        print(f"load {load[0]:.1f} to {load[-1]:.1f} on {os.cpu_count()} cores")


def _cell(values: list[float]) -> str:
    known = sorted(value for value in values if value == value)
    return f"{known[len(known) // 2]:.3g} ({known[-1]:.3g})" if known else "-"


def main() -> None:
    """What is left, and the tables of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", nargs="*", choices=[*_TABLES, []], help="contact, start, force, tricks")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("-o", "--output", type=Path, default=Path("faults.jsonl"))
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    if not given.table:
        measure(given.tables or list(_TABLES), given.repeats, given.output)
    show(read(given.output))


if __name__ == "__main__":
    main()
