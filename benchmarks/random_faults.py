"""Random starts, materials, faults and instants on the twins: does the arm keep its limits, whatever happens?

``python benchmarks/random_faults.py 300 [first seed]``: prints one line for each run that breaks a promise, and a table
at the end. What the arm did is taken from the twin's own record, not from what the run says. The bound of the force is
K (v tau + v^2/2a) on top of the force that stops the motion, for the material that is truly there.
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
import tempfile
import threading
import time
from collections import Counter
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


def main() -> None:
    """So many runs from a seed on."""
    count, first = (int(word) for word in (*sys.argv[1:], *("20", "0")[len(sys.argv) - 1 :]))
    module, endings, bad, forces = conftest(), Counter[str](), 0, []
    with tempfile.TemporaryDirectory() as name:
        twin = module.Bench(Path(name), module.SHORT)
        try:
            for seed in range(first, first + count):
                scene, ended, problems = run(twin, seed)
                endings["done" if ended == "done" else "stopped or refused"] += 1
                bad += bool(problems)
                forces.append(twin.state()["peak_force"])
                text = "; ".join(problems) or "kept"
                print(f"{seed} {scene.fault} at {scene.instant:.2f} s: {ended[:90]} | {text}", flush=True)
        finally:
            twin.close()
    print(
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; {count} runs: {dict(endings)}; {bad} broke a promise"
    )


if __name__ == "__main__":
    main()
