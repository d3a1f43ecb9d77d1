"""Every fault of the twins during contact: what the user sees, when the job learns of it, when the arm has stopped.

``python benchmarks/faults.py``: prints the table of docs/devices.md. "still" is when the tip first stood or turned,
"free" when it was out of the material by itself, "deeper" how far it went on into it.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

from palpate.errors import DeviceError

_SURFACE = 0.0003  # [m]
_FAULTS = (
    *("protective-stop", "emergency-stop", "stop-program", "freeze", "stall 0.4", "close", "reset", "gone"),
    *("unplug", "silent", "reboot", "overrange", "saturated"),
)


def bench_class() -> type:
    """The tests' handle on a twin."""
    path = Path(__file__).parents[1] / "tests" / "devices" / "conftest.py"
    spec = importlib.util.spec_from_file_location("devices_conftest", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.Bench.short = module.SHORT
    return module.Bench


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
        twin.run(out=folder.name, patient=False)
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
    }


def main() -> None:
    """All of them, some times each."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    with tempfile.TemporaryDirectory() as name:
        kind = bench_class()
        twin = kind(Path(name), kind.short)
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
                for key in ("learnt", "still", "free", "deeper"):
                    values = sorted(1e3 * row[key] for row in rows)
                    cells.append(f"{values[len(values) // 2]:.3g} ({values[-1]:.3g})")
                print(f"| {fault} | {rows[0]['text']} | {' | '.join(cells)} |", flush=True)
        finally:
            twin.close()


if __name__ == "__main__":
    main()
