"""Every fault of the twins during contact: what the user sees, when the job learns of it, when the arm has stopped.

``python benchmarks/faults.py``: prints the table of docs/devices.md. "still" is when the tip first stood or turned,
"free" when it was out of the material by itself, "deeper" how far it went on into it.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path
from types import ModuleType

from palpate.errors import DeviceError

_SURFACE = 0.0003  # [m]
_FAULTS = (
    *("protective-stop", "safeguard-stop", "emergency-stop", "stop-program", "pause-program"),
    *("freeze", "half", "stall 0.4", "close", "reset", "gone"),
    *("stuck-pose", "nan-pose", "jam", "mute-control"),
    *("unplug", "silent", "reboot", "overrange", "saturated", "raw"),
)


def devices_conftest() -> ModuleType:
    """The tests' handle on twins."""
    path = Path(__file__).parents[1] / "tests" / "devices" / "conftest.py"
    spec = importlib.util.spec_from_file_location("devices_conftest", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def measured(twin, fault: str, folder: Path) -> dict | None:
    """One fault, 0.3 s after the tip went below 2 mm."""
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
    stop = json.loads((twin.folder / folder.name / "result.json").read_text())["run"]["live"]["stop"]
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
        "peak": twin.state()["peak_force"] / 1e3,
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


def starts(repeats: int) -> None:
    """Every fault that is there before the run: what the user sees, and after how long."""
    module = devices_conftest()
    with tempfile.TemporaryDirectory() as name:
        twin = module.Bench(Path(name), module.SHORT)
        try:
            for i, (fault, overrides) in enumerate(_STARTS):
                times, text = [], ""
                for repeat in range(repeats):
                    twin.fault("restore")
                    twin.fault(fault)
                    began, text = time.monotonic(), "runs"
                    try:
                        twin.run(*overrides, out=f"start{i}-{repeat}")
                    except DeviceError as error:
                        text = str(error).split(" (what was found")[0]
                    times.append(time.monotonic() - began)
                what = " ".join([fault, *overrides])
                print(f"| {what} | {text} | {sorted(times)[len(times) // 2]:.1f} ({max(times):.1f}) s |", flush=True)
        finally:
            twin.close()


def force_limits(repeats: int) -> None:
    """What is under the tip and was not expected: speed, way and latency beyond the limit, largest force."""
    module = devices_conftest()
    print("| case | speed mm/s | way mm | latency ms | peak N | bound N |")
    for case, (overrides, options, elasticity) in module.ForceLimit.cases.items():
        rows = []
        for _ in range(repeats):
            with tempfile.TemporaryDirectory() as name:
                twin = module.Bench(Path(name), (*module.SHORT, *overrides))
                try:
                    if case == "the other way round":
                        twin.fault("sign")
                    with contextlib.suppress(DeviceError):
                        twin.run(*options)
                    speed, way, latency = module.ForceLimit.overrun(Path(name) / "out")
                    bound = module.ForceLimit.bound(elasticity, speed)
                    rows.append((1e3 * speed, 1e3 * way, 1e3 * latency, twin.state()["peak_force"], bound))
                finally:
                    twin.close()
        cells = [f"{sorted(column)[len(column) // 2]:.3g} ({max(column):.3g})" for column in zip(*rows, strict=True)]
        print(f"| {case} | {' | '.join(cells)} |", flush=True)


_TRICKS = (  # what, the tip's start [mm, deg], elasticity [Pa], overrides of the run
    ("tool off by 3 deg", (0, 0, 4, 3, 0, 0), 112.5e3, ()),
    ("tool off by 8 deg", (0, 0, 4, 8, 0, 0), 112.5e3, ()),
    ("tool off by 90 deg about its axis", (0, 0, 4, 0, 0, 90), 112.5e3, ()),
    ("5 mm deep at the start, 18 N", (0, 0, -5, 0, 0, 0), 366e3, ()),
    ("the same, a rest of 50 N allowed", (0, 0, -5, 0, 0, 0), 366e3, ("safety.rest_force=50 N",)),
    ("the same, 60 N allowed", (0, 0, -5, 0, 0, 0), 366e3, ("safety.rest_force=50 N", "safety.force=60 N")),
    ("a joint may turn at 2 deg/s", (0, 0, 4, 0, 0, 0), 112.5e3, ("device.arm.joint_speed=2 deg/s",)),
)


def tricks() -> None:
    """Starts that no limit allows: how it ended, and what the arm truly did."""
    module = devices_conftest()
    print("| trick | what the user sees | fastest tip mm/s | joint deg/s | lowest mm | peak N |")
    with tempfile.TemporaryDirectory() as name:
        twin = module.Bench(Path(name), module.SHORT)
        try:
            for i, (what, start, elasticity, overrides) in enumerate(_TRICKS):
                for words in (f"start {' '.join(map(str, start))}", f"elasticity {elasticity}", "restore", "mark"):
                    twin.fault(words)
                text = "runs"
                try:
                    twin.run('run.tracks=["dr/ekf"]', *overrides, out=f"trick{i}")
                except DeviceError as error:
                    text = str(error).split(" (what was found")[0]
                state = twin.state()
                joint, tip = 57.3 * state["fastest_joint"], 1e3 * state["fastest_tip"]
                low, peak = 1e3 * state["low"][2], state["peak_force"]
                print(f"| {what} | {text} | {tip:.1f} | {joint:.1f} | {low:.2f} | {peak:.1f} |", flush=True)
        finally:
            twin.close()


def main() -> None:
    """All of them, some times each; ``faults.py 5 force`` and ``faults.py 1 start`` for other tables."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    if sys.argv[2:]:
        {"force": force_limits, "start": starts, "tricks": lambda _: tricks()}[sys.argv[2]](repeats)
        return
    with tempfile.TemporaryDirectory() as name:
        module = devices_conftest()
        twin = module.Bench(Path(name), module.SHORT)
        print(
            f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; {repeats} times each: median (largest), ms, mm"
        )
        try:
            for fault in _FAULTS:
                rows = []
                for i in range(10 * repeats):
                    twin.fault("restore")
                    row = measured(twin, fault, Path(name) / f"{fault.split()[0]}{i}")
                    if row is not None:
                        rows.append(row)
                    if len(rows) == repeats:
                        break
                cells = []
                for key in ("learnt", "still", "free", "deeper", "peak"):
                    values = sorted(1e3 * row[key] for row in rows)
                    cells.append(f"{values[len(values) // 2]:.3g} ({values[-1]:.3g})")
                print(f"| {fault} | {rows[0]['text']} | {' | '.join(cells)} |", flush=True)
        finally:
            twin.close()


if __name__ == "__main__":
    main()
