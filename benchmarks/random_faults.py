"""Random starts, materials, faults and instants on the twins: does the arm keep its limits, whatever happens?

``python benchmarks/random_faults.py 300 [first seed] [-o random_faults.jsonl]``: one line of the file and of the output
for each run, as it ends; started again it goes on with the seeds that the file lacks, and prints the table of all.
``--table`` only prints that. The twins run in real time: beside other work the figures are those of a busy host.
What the arm did is taken from the twin's own record, not from what the run says. The bound of the force is
K (v tau + v^2/2a) on top of the force that stops the motion, for the material that is truly there. Where a run hangs,
the stacks of all its threads and processes are in the file; the twins are started anew.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import importlib.util
import json
import math
import os
import shutil
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate.errors import PalpateError

LOW, HIGH, SPEED = (-0.005, -0.005, -0.007), (0.005, 0.005, 0.02), 0.04  # of pipelines/point_ur3e.toml
FAULTS = (
    *("nothing", "protective-stop", "safeguard-stop", "emergency-stop", "stop-program", "pause-program"),
    *("freeze", "half", "stall 0.2", "stall 0.6", "close", "gone", "message", "mute-control"),
    *("stuck-pose", "jam", "nan-pose", "unplug", "silent", "reboot", "overrange", "saturated", "raw"),
    *("throttled", "corrupt 0.05", "lumps 0.016", "sign"),
)
_HANGS = 90.0  # [s]
_RADIUS, _SURFACE = 0.005, 0.0003  # [m]
_SWING = 1.5e-3  # [m] by which an arm may swing over the box of its setpoints: 1 mm of margin, and braking


@dataclass(frozen=True)
class Scene:
    """What is drawn."""

    place: tuple[float, float, float]  # [m]
    turn: tuple[float, float, float]  # [rad]
    stiffness: float  # [N/m] at the force that stops the motion
    fault: str
    instant: float  # [s] after the tip began to move

    @property
    def elasticity(self) -> float:
        """Of the half-space [Pa] that has this stiffness under a paraboloid at 12 N: K = 1.5 F/d."""
        depth = 1.5 * 12.0 / self.stiffness
        return 12.0 / (16 / 9 * math.sqrt(_RADIUS) * depth**1.5)

    @property
    def preload(self) -> float:
        """Force [N] on the skin at the start."""
        depth = max(_SURFACE - self.place[2], 0.0)
        return 16 / 9 * self.elasticity * math.sqrt(_RADIUS) * depth**1.5


def drawn(seed: int) -> Scene:
    """A scene: one in seven with the tip in the material, one in seven with a tool that looks elsewhere."""
    rng = np.random.default_rng(seed)
    height = -float(rng.uniform(0.0, 0.004)) if rng.random() < 1 / 7 else float(rng.uniform(0.001, 0.008))
    askew = np.radians(rng.uniform(5.0, 15.0) if rng.random() < 1 / 7 else rng.uniform(0.0, 4.0))
    axis = rng.normal(size=3)
    turn = askew * axis / np.linalg.norm(axis)
    stiffness = float(np.exp(rng.uniform(np.log(1e3), np.log(300e3))))
    if height < 0:
        stiffness = min(stiffness, 5e3)  # a preload that an arm could have been left with
    x, y = rng.uniform(-0.002, 0.002, 2)
    fault, instant = FAULTS[int(rng.integers(len(FAULTS)))], float(rng.uniform(0.0, 3.0))
    return Scene((float(x), float(y), height), tuple(turn.tolist()), stiffness, fault, instant)


def conftest() -> Any:
    """The tests' handle on twins."""
    path = Path(__file__).parents[1] / "tests" / "devices" / "conftest.py"
    spec = importlib.util.spec_from_file_location("devices_conftest", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class HangError(Exception):
    """A run that does not end."""

    def __init__(self, scene: Scene, where: str) -> None:
        super().__init__(f"hangs for {_HANGS:g} s")
        self.scene, self.where = scene, where


def stacks() -> str:
    """Where all threads of this process are, and what its children wait for."""
    with tempfile.TemporaryFile("w+") as file:
        faulthandler.dump_traceback(file)
        file.seek(0)
        found = [file.read()]
    for child in Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split():
        for task in sorted(Path(f"/proc/{child}/task").iterdir()):
            names = ("wchan", "syscall", "cmdline" if task.name == child else "comm")
            found.append(" ".join([child, task.name, *(_said(task / name) for name in names)]))
    return "\n".join(found)


def _said(file: Path) -> str:
    try:
        return file.read_text().replace("\0", " ").strip()
    except OSError:
        return "?"


def run(twin: Any, seed: int) -> tuple[Scene, str, list[str]]:
    """One run: its scene, how it ended, and the promises that it broke."""
    scene, over, ended = drawn(seed), threading.Event(), ["hangs"]
    x, y, z = (1e3 * value for value in scene.place)
    a, b, c = (math.degrees(value) for value in scene.turn)
    for words in (f"start {x} {y} {z} {a} {b} {c}", f"elasticity {scene.elasticity}", "restore", "mark"):
        twin.fault(words)
    out = f"random{seed}"

    def disturb() -> None:
        while not over.is_set() and twin.state()["fastest_tip"] < 1e-4:
            time.sleep(0.02)
        if not over.wait(scene.instant) and scene.fault != "nothing":
            twin.fault(scene.fault)

    def work() -> None:
        try:
            twin.run('run.tracks=["dr/ekf"]', out=out, limits=conftest().ALERT)
            ended[0] = "done"
        except PalpateError as error:
            ended[0] = " ".join(str(error).split())
        except BaseException as error:
            ended[0] = f"traceback: {type(error).__name__}: {error}"

    threads = [threading.Thread(target=part, daemon=True) for part in (disturb, work)]
    for thread in threads:
        thread.start()
    threads[1].join(_HANGS)
    if threads[1].is_alive():
        raise HangError(scene, stacks())
    over.set()
    threads[0].join()
    state = twin.wait(lambda state: state["joint_speed"] < 1e-3, 5.0)
    return scene, ended[0], [*broken(scene, state, ended[0]), *unreadable(twin.folder / out / "log.mcap")]


def broken(scene: Scene, state: dict[str, Any], ended: str) -> list[str]:
    """Promises that the arm broke."""
    found = [ended] if ended.startswith(("hangs", "traceback")) else []
    for axis, name in enumerate("xyz"):
        low, high = state["low"][axis], state["high"][axis]
        if low < LOW[axis] - _SWING or high > HIGH[axis] + _SWING:
            found.append(f"{name} went from {1e3 * low:.2f} to {1e3 * high:.2f} mm")
    if state["fastest_tip"] > 1.2 * SPEED:
        found.append(f"the tip moved at {1e3 * state['fastest_tip']:.1f} mm/s")
    if state["fastest_joint"] > math.radians(90):
        found.append(f"a joint moved at {math.degrees(state['fastest_joint']):.0f} deg/s")
    most = max(conftest().ForceLimit.bound(scene.elasticity, 0.02), 1.02 * scene.preload + 0.1)
    if state["peak_force"] > most:
        found.append(f"the force was {state['peak_force']:.1f} N, over {most:.1f} N")
    return found


def unreadable(log: Path) -> list[str]:
    """What is wrong with a log; nothing where there is none."""
    from palpate_devices.mcap_replay import McapReplay

    if not log.exists():
        return []
    try:
        with McapReplay(file=log, recorded="sensor").connect(0) as link:
            for _ in link.batches():
                pass
    except PalpateError as error:
        return [f"log: {error}"] if log.stat().st_size > 1000 else []
    return []


def row_of(folder: Path, twin: Any, seed: int) -> dict[str, Any]:
    """One run as a line of the file."""
    scene, ended, problems = run(twin, seed)
    if not problems:  # a log of every run is too much for a disk; that of one which broke a promise is wanted
        shutil.rmtree(folder / f"random{seed}", ignore_errors=True)
    state = twin.state()
    figures = {key: state[key] for key in ("peak_force", "fastest_tip", "fastest_joint", "low", "high")}
    return {**facts(scene, seed), "ended": ended, "problems": problems, **figures}


def facts(scene: Scene, seed: int) -> dict[str, Any]:
    """What a run was, and how busy the host."""
    scened = {"fault": scene.fault, "instant": scene.instant, "stiffness": scene.stiffness, "preload": scene.preload}
    return {"seed": seed, **scened, "load": os.getloadavg()[0]}


def work(seeds: list[int], file: Path) -> None:
    """The runs that are left, each written as it ends."""
    module, folder = conftest(), file.resolve().with_suffix("")
    folder.mkdir(exist_ok=True)
    while seeds:
        twin = module.Bench(folder, module.SHORT)
        try:
            while seeds:
                row = row_of(folder, twin, seeds[0])
                _write(file, row)
                seeds.pop(0)
        except HangError as error:
            _write(file, {**facts(error.scene, seeds[0]), "ended": str(error), "problems": [str(error)],
                          "where": error.where})  # fmt: skip
            seeds.pop(0)
            twin.process.kill()
            if seeds:  # what hangs is left behind with its process
                os.execv(sys.executable, [sys.executable, *sys.argv])
            os._exit(1)
        finally:
            twin.close()


def _write(file: Path, row: dict[str, Any]) -> None:
    with file.open("a") as lines:
        lines.write(json.dumps(row) + "\n")
    text = "; ".join(row["problems"]) or "kept"
    print(f"{row['seed']} {row['fault']} at {row['instant']:.2f} s: {row['ended'][:90]} | {text}", flush=True)


def table(rows: list[dict[str, Any]]) -> None:
    """By fault: runs, those that came to their end, those that broke a promise, largest force, speeds."""
    print("| fault | runs | to their end | broke a promise | peak N | tip mm/s | joint deg/s |")
    print("|---|---|---|---|---|---|---|")
    for fault in (*dict.fromkeys(row["fault"] for row in sorted(rows, key=lambda row: row["fault"])), ""):
        those = [row for row in rows if fault in ("", row["fault"])]
        done, bad = (sum(map(bool, column)) for column in zip(*((r["ended"] == "done", r["problems"]) for r in those)))
        most = [max((row[key] for row in those if key in row), default=math.nan)
                for key in ("peak_force", "fastest_tip", "fastest_joint")]  # fmt: skip
        figures = f"{most[0]:.1f} | {1e3 * most[1]:.1f} | {math.degrees(most[2]):.0f}"
        print(f"| {fault or 'all'} | {len(those)} | {done} | {bad} | {figures} |")
    load = sorted(row["load"] for row in rows)
    print(f"load {load[0]:.1f} to {load[-1]:.1f} on {os.cpu_count()} cores, {load[len(load) // 2]:.1f} in the median")


def main() -> None:
    """The runs that are left, and the table of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("-o", "--output", type=Path, default=Path("random_faults.jsonl"))
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.count)
    known = {row["seed"] for row in read(given.output)}
    if not given.table:
        work([seed for seed in seeds if seed not in known], given.output)
    if rows := read(given.output):
        table(rows)


def read(file: Path) -> list[dict[str, Any]]:
    """The runs that a file has; a line that was cut is none."""
    rows = []
    for line in file.read_text().splitlines() if file.exists() else ():
        with contextlib.suppress(json.JSONDecodeError):
            rows.append(json.loads(line))
    return rows


if __name__ == "__main__":
    main()
