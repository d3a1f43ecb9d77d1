"""Random scenes in simulated time: does the arm keep its limits, and are its reports true, whatever happens?

``python benchmarks/scenes.py 2000 [first seed] [-o scenes.jsonl]``: a line of the file for each scene as it ends, on
all cores or on ``--processes N``; started again it goes on with the seeds that the file lacks, and prints the table of
all. ``--table`` only prints that; ``--seed N`` runs one scene and says what happened; ``--grid`` runs every fault with
every hold-up of every process, under seeds from 1 000 000 on. Scenes from seed 100 000 on are of a rig that lies or
does not obey: frames that are apart, forces that are not what is felt, stops that are not carried out, a slow driver,
an age that grows, skin that moves. A scene is drawn from its seed: material, place and tilt of the tool, motion,
limits, a fault and its instant, a second one a little later, how often the controller sends its state, and what the
computer holds up for how long. Four of five motions suit their material, and two of five scenes below seed 100 000 have
no first fault. What the arm did is taken from the twin at every tick, not from what the run says. The same seed is the
same scene, to the bit.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

FAULTS = (
    *("nothing", "protective-stop", "safeguard-stop", "emergency-stop", "stop-program", "pause-program"),
    *("freeze", "half", "stall 0.2", "stall 0.6", "close", "gone", "message", "mute-control"),
    *("half-open 0.4", "half-open 3", "slider 0.5", "reduced", "robot-mode 5"),
    *("stuck-pose", "jam", "nan-pose", "unplug", "silent", "reboot", "overrange", "saturated", "raw"),
    *("throttled", "corrupt 0.05", "lumps 0.016", "sign", "stuck-force", "clipped-force 6", "end-stream"),
    *("speed-scaling 0.5", "late-readings 0.05", "late-readings 0.2", "late-states 0.1"),
    *("scaled-force 0.5", "scaled-force 1.5", "saturated-force 6 0.05", "saturated-force 3 0.02"),
)
# Faults of scenes from seed 100 000 on: from the start, by the driver, by a setting, or in the motion.
FROM_THE_START = (
    *("pose-offset 0 0 -4", "pose-offset 3 0 0", "frame-offset 0 0 4", "compressed-force", "reduced-force 0.102"),
    *("reduced-force 0.5", "deadened-force 10", "forgotten-force 1", "old-force 0.5"),
)
BY_THE_DRIVER = ("driver-ignores-stop", "driver-takes 0.003", "driver-takes 0.01")
BY_A_SETTING = ("sensor-ppm 1000", "sensor-ppm 5000")  # of the sensor's clock: its readings get older and older
IN_MOTION = (
    "push 0 0 -8",
    "slow-stop 1",
    "breathe 5 0.25",
    "cough 20 0.15",
    "rise 40 1",
    "compressed-force",
    "reduced-force 0.5",
)
LIES = FROM_THE_START + BY_THE_DRIVER + BY_A_SETTING + IN_MOTION
_SKIN = {"breathe 5 0.25": 5e-3, "cough 20 0.15": 20e-3, "rise 40 1": 40e-3}  # [m]
_DEEPER = {"pose-offset 0 0 -4": 4e-3, "frame-offset 0 0 4": 4e-3, **_SKIN}  # [m]
_SECOND = ("protective-stop", "mute-control", "freeze", "gone", "half-open 3", "close")  # while the arm leaves, perhaps
_HARMLESS = ("nothing", "message", "throttled", "corrupt 0.05", "lumps 0.016")
# Faults that a run may end well with, for the arm still follows its commands, and what it feels is still true enough.
_MAY_PASS = (
    *_HARMLESS,
    "stall 0.2",
    "sign",
    "slider 0.5",
    "speed-scaling 0.5",
    "reduced",
    "clipped-force 6",
    "half-open 0.4",
    "scaled-force 0.5",
    "scaled-force 1.5",
    "saturated-force 6 0.05",  # it may be reached where the tip slows down, or not at all
    "saturated-force 3 0.02",
    *(
        fault
        for fault in LIES
        if fault not in ("pose-offset 0 0 -4", "pose-offset 3 0 0", "frame-offset 0 0 4", "driver-takes 0.01")
    ),
)
_PROCESSES = ("robot", "sensor", "main")
_HOLD_UPS = (0.0, 0.008, 0.05, 0.275)  # [s]
_OFTEN = (0.4, 0.25, 0.25, 0.1)  # share of each; the last is longer than an arm goes on alone
_RADIUS, _SURFACE = 0.005, 0.0003  # [m]
_SWING = 1.5e-3  # [m] by which an arm may swing over the box of its setpoints: 1 mm of margin, and braking
_FIRST_LEAP = 0.045  # [m/s] of a tip whose joints take up 0.16 rad/s in the one tick before a state shows it (0530)
_LATENCY, _AGE, _DECELERATION = 0.06, 0.02, 1.0  # [s], [s], [m/s^2] of [safety]
_STIFFNESS, _ROOM = 3e3, 8.0  # [N/m], [N] between stop_force and force, of [safety]
_FASTEST = 0.02  # [m/s] of a motion that the rule of overshoot allows with room to spare
_HELD = 2.0  # [N] of force-hold
_SUITABLE, _OF_STOP = 0.8, 0.6  # share of scenes whose motion suits the material: so much of the force that stops it
_LYING = 100_000  # seed of the first scene of a rig that lies or does not obey
_GRID = 1_000_000  # seed of the first scene of the grid
_LEFT = 1e-4  # [m]
_LONGEST = 60.0  # [s] of a motion in simulated time
_MOTIONS = {
    "point": 'type = "point"\nbias = "{depth} mm"\namplitude = "{swing} mm"\nfrequency = "{frequency} Hz"\n'
    'duration = "1 s"\nclearance = "3 mm"\nstandstill = "0 s"',
    "raster": 'type = "raster"\nsize = ["2.5 mm", "1 mm"]\npitch = "1 mm"\nspeed = "4 mm/s"\nsettle = "0.2 s"\n'
    'press = {{ bias = "{depth} mm", amplitude = "{small} mm", frequency = "8 Hz", clearance = "3 mm" }}',
    "ramp-hold": 'type = "ramp-hold"\ndepths = ["{depth} mm"]\nhold = "0.5 s"\nclearance = "3 mm"\nstandstill = "0 s"',
    "force-hold": 'type = "force-hold"\nforce = "2 N"\ndepth = "{depth} mm"\nduration = "4 s"\n'
    'stiffness = "3 N/mm"\nclearance = "3 mm"\nstandstill = "0 s"',
}


@dataclass(frozen=True)
class Scene:
    """What is drawn."""

    seed: int
    place: tuple[float, float, float]  # [m]
    turn: tuple[float, float, float]  # [rad]
    elasticity: float  # [Pa]
    motion: str
    depth: float  # [mm]
    swing: float  # [mm]
    frequency: float  # [Hz]
    speed: float  # [m/s] limit
    acceleration: float  # [m/s^2] limit
    stop_force: float  # [N]
    fault: str
    instant: float  # [s] after the tip began to move
    held: str  # which process the computer holds up
    hold_up: float  # [s]
    every: float | None  # [s]
    second: str = "nothing"  # fault, `after` [s] the first
    after: float = 0.0
    rate: float = 500.0  # [Hz] of the controller's states

    @property
    def preload(self) -> float:
        """Force [N] on the skin at the start."""
        depth = max(_SURFACE - self.place[2], 0.0)
        return 16 / 9 * self.elasticity * math.sqrt(_RADIUS) * depth**1.5

    def most_force(self, speed: float) -> float:
        """The largest force [N] on the skin that the declared latency explains at a speed [m/s]; see ForceLimit.

        F + (8/3) E sqrt(R d) x with x = v tau + v^2/2a: the limit, and the tangent stiffness at the deepest point times
        the way allowed.
        """
        if self.fault in LIES and self.fault not in BY_THE_DRIVER + BY_A_SETTING:
            return self.force_by_depth
        name, _, level = self.fault.partition(" ")
        allowed = speed * (_LATENCY + _AGE * name.startswith(("late-", "sensor-ppm"))) + speed**2 / (2 * _DECELERATION)
        stop = self.stop_force
        if name == "scaled-force":
            stop /= float(level)
        elif name in ("clipped-force", "saturated-force"):  # seen after a window, but where the tip slows down
            stop, allowed = min(stop, float(level.split()[0])), allowed + (self.depth + self.swing) * 1e-3
        depth = (9 * stop / (16 * self.elasticity * _RADIUS**0.5)) ** (2 / 3) + allowed
        beyond = stop + 8 / 3 * self.elasticity * (_RADIUS * depth) ** 0.5 * allowed
        return max(beyond, 1.02 * self.preload + 0.1)

    @property
    def force_by_depth(self) -> float:
        """The largest force [N] that the depth limit leaves, whatever the sensor reads, with what comes on top of it.

        A sphere at the deepest setpoint, a swing and the tissue deeper, and the share of a viscosity of 3.2 ms at the
        fastest of tip and skin, 0.25 m/s.
        """
        depth = 1e-3 * (self.depth + self.swing) + _SURFACE + _SWING + _DEEPER.get(self.fault, 0.0)
        rate = 1.2 * self.speed + 2e-3 + (0.25 if self.fault in _SKIN else 0.0)
        elastic = 16 / 9 * self.elasticity * math.sqrt(_RADIUS) * depth**1.5
        viscous = 8 * 3.2e-3 * self.elasticity * math.sqrt(_RADIUS * depth) * rate
        return max(elastic + viscous, 1.02 * self.preload + 0.1)


def _depth_at(force: float, elasticity: float) -> float:
    """Of a sphere in an elastic half-space [m]."""
    return (9 * force / (16 * elasticity * _RADIUS**0.5)) ** (2 / 3)


def _elasticity(rng: np.random.Generator, motion: str, deepest: float, stop_force: float, most: float) -> float:
    """Such that a motion to a depth [m] stays below the force that stops it and, with a held force, reaches that."""
    of = lambda force, depth: 9 * force / (16 * _RADIUS**0.5 * depth**1.5)  # noqa: E731
    low, high = 1e3, most
    if rng.random() < _SUITABLE:
        high = min(of(_OF_STOP * stop_force, deepest), most)
        if motion == "force-hold":
            low, high = of(_HELD, 0.6 * deepest), max(of(_HELD, 0.3 * deepest), of(_HELD, 0.6 * deepest) * 1.1)
    return float(np.exp(rng.uniform(np.log(low), np.log(max(high, 1.1 * low)))))


def drawn(seed: int) -> Scene:
    """A scene: one in fourteen with the tip in the material, one in fourteen with a tool that looks elsewhere."""
    rng = np.random.default_rng(seed)
    touching = rng.random() < 1 / 14
    height = -float(rng.uniform(0.0, 0.004)) if touching else float(rng.uniform(0.001, 0.008))
    askew = np.radians(rng.uniform(5.0, 15.0) if rng.random() < 1 / 14 else rng.uniform(0.0, 4.0))
    axis = rng.normal(size=3)
    motion, stop_force = str(rng.choice(list(_MOTIONS))), float(rng.uniform(5.0, 15.0))
    acceleration, frequency = float(rng.uniform(0.7, 3.0)), float(rng.choice([0.5, 1.0, 2.0, 5.0]))
    depth, pace = float(rng.uniform(0.5, 5.0)), 2 * math.pi * frequency
    fastest = 1e3 * min(_FASTEST / pace, 0.6 * acceleration / pace**2)  # [mm]
    swing = float(rng.uniform(0.1, 1.0)) * min(1.0, 0.9 * depth, fastest)
    deepest = 1e-3 * (depth + swing) + _SURFACE
    elasticity = _elasticity(rng, motion, deepest, stop_force, 0.3e6 if touching else 5e6)
    x, y = rng.uniform(-0.002, 0.002, 2)
    kinds = LIES if _LYING <= seed < _GRID else FAULTS
    fault = "nothing" if rng.random() < (0.4 if kinds is FAULTS else 0.0) else kinds[int(rng.integers(len(kinds)))]
    second = str(rng.choice(_SECOND)) if rng.random() < 0.3 and fault != "nothing" else "nothing"
    return Scene(
        seed,
        (float(x), float(y), height),
        tuple((askew * axis / np.linalg.norm(axis)).tolist()),
        elasticity,
        motion,
        depth,
        swing,
        frequency,
        float(rng.uniform(0.03, 0.06)),
        acceleration,
        stop_force,
        fault,
        float(rng.uniform(0.0, 3.0)),
        str(rng.choice(_PROCESSES)),
        float(rng.choice(_HOLD_UPS, p=_OFTEN)),
        None if rng.random() < 0.5 else float(rng.uniform(0.4, 2.0)),
        second,
        float(rng.uniform(0.02, 0.3)),
        float(rng.choice([500.0, 500.0, 500.0, 250.0, 125.0])),
    )


def grid() -> list[Scene]:
    """Every fault in contact, with every hold-up of every process."""
    held = [(process, hold_up) for process in _PROCESSES for hold_up in _HOLD_UPS if hold_up or process == "main"]
    place, turn, nominal = (0.0, 0.0, 0.004), (0.0, 0.0, 0.0), (112.5e3, "point", 4.0, 1.0, 2.0, 0.04, 0.5, 12.0)
    return [
        Scene(_GRID + number, place, turn, *nominal, fault, 2.0, process, hold_up, 0.5)
        for number, (fault, (process, hold_up)) in enumerate(itertools.product(FAULTS, held))
    ]


def pipeline_of(scene: Scene, folder: Path) -> Any:
    """The example pipeline with this scene's motion, limits and specimen."""
    from palpate_engine import load_pipeline

    text = (Path(__file__).parents[1] / "pipelines" / "point_ur3e.toml").read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    motion = _MOTIONS[scene.motion].format(
        depth=f"{scene.depth:.3f}",
        swing=f"{scene.swing:.3f}",
        frequency=scene.frequency,
        small=f"{0.2 * scene.swing:.3f}",
    )
    file = folder / "scene.toml"
    file.write_text(f"{text[:begin]}[trajectory.press]\n{motion}\n\n{text[end:]}")
    x, y, z = (f"{1e3 * value} mm" for value in scene.place)
    return load_pipeline(
        file,
        [
            'run.tracks=["dr/ekf"]',
            "device.sensor.settle=0.1 s",
            "safety.standstill=0.2 s",
            "alignment.tare_duration=0.15 s",
            f"safety.speed={scene.speed}",
            f"safety.acceleration={scene.acceleration}",
            f"safety.stop_force={scene.stop_force}",
            f"safety.force={scene.stop_force + _ROOM}",
            f"safety.stiffness={_STIFFNESS}",
            f'twin.bench.place=["{x}", "{y}"]',
            f"twin.bench.height={z}",
            f"twin.bench.tool_rotation={list(scene.turn)}",
            f"twin.bench.specimen.elasticity={scene.elasticity}",
            f"twin.bench.specimen.viscosity={scene.elasticity * 362.0 / 112.5e3}",
            *([f"twin.bench.sensor_ppm={scene.fault.split()[1]}"] if scene.fault in BY_A_SETTING else ()),
        ],
    )


def run(scene: Scene, folder: Path) -> dict[str, Any]:
    """One scene: how it ended, what the arm did, and the promises that were broken."""
    from palpate import HoldUp, PalpateError, UserError, clock
    from palpate_engine import run_pipeline

    hold_ups = [HoldUp(scene.held, scene.hold_up, 1.0 + scene.instant, scene.every)] if scene.hold_up else []
    made: list[float] = []
    over: list[bool] = []
    try:
        pipeline = pipeline_of(scene, folder)
        bench = pipeline.twins["bench"]
    except UserError as error:
        return {"ended": f"refused: {' '.join(str(error).split())}", "problems": [], "simulated": 0.0}
    with bench.simulated(scene.seed, hold_ups) as twin, driver_of(scene.fault):
        begin = clock().now()
        if scene.fault in FROM_THE_START and not _begins_later(scene):
            made.append(0.0)
            twin.fault(scene.fault)
        if scene.rate < 500.0:
            twin.fault(f"state-rate {scene.rate:g}")

        def disturb() -> None:
            while not over and twin.truth.speed < 1e-4:
                clock().sleep(0.02)
            clock().sleep(scene.instant)
            for fault, wait in ((scene.fault, scene.after), (scene.second, 0.0)):
                if (
                    over
                    or fault == "nothing"
                    or fault in BY_THE_DRIVER + BY_A_SETTING
                    or (made and fault == scene.fault)
                ):
                    continue
                made.append(clock().now() - begin)
                twin.fault(fault)
                clock().sleep(wait)

        clock().thread(disturb, "fault").start()
        try:
            run_pipeline(pipeline, folder / "run")
            ended = "done"
        except PalpateError as error:
            ended = " ".join(str(error).split())
        except Exception as error:
            ended = f"traceback: {type(error).__name__}: {error}"
        over.append(True)
        last = clock().now() - begin
        clock().sleep(1.0)
        truth = twin.truth
        twin.fault("mark")  # from now on its height is that at which it stands
        clock().sleep(0.01)
        height = twin.truth.low[2]
    problems = [*broken(scene, truth, ended), *untrue(scene, ended, made, last), *unreadable(folder / "run")]
    problems += unnamed(scene, ended, height)
    row = {"ended": ended, "problems": problems, "simulated": last, "made": made, "height": height}
    return row | {key: value for key, value in asdict(truth).items() if key != "moving"}


def _begins_later(scene: Scene) -> bool:
    """Return True for a lie that sets in during the motion."""
    return scene.fault in IN_MOTION and scene.seed % 2 == 1


@contextlib.contextmanager
def driver_of(fault: str) -> Iterator[None]:
    """Let the robot's driver ignore stops, or take a time [s] for each command, within the context."""
    from palpate import clock
    from palpate_devices.ur.driver import URDriver

    send, stop = URDriver.send, URDriver.stop
    name, _, number = fault.partition(" ")

    def send_slowly(driver: Any, pose: Any) -> bool:
        clock().sleep(float(number))
        return send(driver, pose)

    try:
        if name == "driver-takes":
            URDriver.send = send_slowly
        elif name == "driver-ignores-stop":
            URDriver.stop = lambda driver: None
        yield
    finally:
        URDriver.send, URDriver.stop = send, stop


def broken(scene: Scene, truth: Any, ended: str) -> list[str]:
    """Limits that the arm did not keep."""
    found = [ended] if ended.startswith("traceback") else []
    for axis, low, high in ((0, -0.005, 0.005), (1, -0.005, 0.005), (2, -0.007, 0.02)):
        least, most = min(low, scene.place[axis]) - _SWING, max(high, scene.place[axis]) + _SWING
        if truth.low[axis] < least or truth.high[axis] > most:
            found.append(f"{'xyz'[axis]} went from {1e3 * truth.low[axis]:.2f} to {1e3 * truth.high[axis]:.2f} mm")
    if truth.speed > max(1.2 * scene.speed + 2e-3, _FIRST_LEAP if scene.fault.startswith("frame-offset") else 0.0):
        found.append(f"the tip moved at {1e3 * truth.speed:.1f} mm/s of {1e3 * scene.speed:.1f}")
    if truth.turning > 1.2 * math.radians(10.0):
        found.append(f"the tool turned at {math.degrees(truth.turning):.1f} deg/s of 10")
    if truth.joint_speed > math.radians(90.0):
        found.append(f"a joint moved at {math.degrees(truth.joint_speed):.0f} deg/s")
    if ended == "done" and truth.acceleration > 1.5 * max(scene.acceleration, 1.0):  # 1.0: of what it does by itself
        found.append(f"the tip accelerated at {truth.acceleration:.2f} m/s^2")
    if truth.force > (most := scene.most_force(max(truth.speed, 0.02))):
        found.append(f"the force was {truth.force:.1f} N, over {most:.1f} N")
    if truth.moving:
        found.append("the arm still moves a second after the end")
    return found


def unnamed(scene: Scene, ended: str, height: float) -> list[str]:
    """That a tip stays in the material, where the run does not say where it stands."""
    if height > min(_SURFACE, scene.place[2]) - _LEFT or "refused" in ended or "at a height of" in ended:
        return []
    if height > scene.place[2] - _LEFT:  # where it was found
        return []
    return [f"the tip stays in the material, at {1e3 * height:.1f} mm, and that is not reported"]


def untrue(scene: Scene, ended: str, made: list[float], last: float) -> list[str]:
    """What was reported of the run and was not true."""
    faults = [fault for fault in (scene.fault, scene.second) if fault != "nothing"]
    for fault, instant in zip(faults, made, strict=False):
        if ended == "done" and fault not in _MAY_PASS and instant < last - 0.3:
            return [f"{fault} at {instant:.2f} s of {last:.2f} s is not reported"]
    if last > _LONGEST:
        return [f"it took {last:.0f} s"]
    return []


def unreadable(folder: Path) -> list[str]:
    """What is wrong with what was recorded, by the format's own reader; nothing where nothing was."""
    from mcap.reader import make_reader

    if not (folder / "log.mcap").exists():
        return []
    try:
        with (folder / "log.mcap").open("rb") as file:
            summary = make_reader(file).get_summary()
            count = sum(1 for _ in make_reader(file).iter_messages(log_time_order=False))
    except Exception as error:
        return [f"log: {type(error).__name__}: {error}"]
    if summary is None or summary.statistics is None or summary.statistics.message_count != count:
        return ["the log has no whole summary"]
    return [] if (folder / "result.json").exists() else ["no result.json"]


def row_of(scene: Scene, keep: Path | None = None) -> dict[str, Any]:
    """One scene as a line of the file."""
    from palpate import DeviceError

    folder = Path(tempfile.mkdtemp(prefix="scene-"))
    began = time.process_time()
    try:
        try:
            outcome = run(scene, folder)
        except DeviceError as error:  # the twin's arm cannot get there
            outcome = {"ended": f"refused: {error}", "problems": [], "simulated": 0.0}
        row = {**asdict(scene), **outcome, "processor": time.process_time() - began}
        if keep is not None:
            shutil.copytree(folder, keep / str(scene.seed), dirs_exist_ok=True)
        return row
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def work(scenes: list[Scene], file: Path, processes: int | None) -> None:
    """The scenes that are left, each written as it ends."""
    with get_context("spawn").Pool(processes or os.cpu_count(), maxtasksperchild=50) as pool:
        for row in pool.imap_unordered(row_of, scenes):
            with file.open("a") as lines:
                lines.write(json.dumps(row) + "\n")
            if row["problems"]:
                print(f"{row['seed']} {row['motion']}, {row['fault']}: {'; '.join(row['problems'])}", flush=True)


def table(rows: list[dict[str, Any]]) -> None:
    """By fault: scenes, those that came to their end, those that broke a promise, largest force, speeds, depth."""
    print("| fault | scenes | to their end | broke a promise | force N | tip mm/s | joint deg/s | deepest mm |")
    print("|---|---|---|---|---|---|---|---|")
    for fault in (*dict.fromkeys(row["fault"] for row in sorted(rows, key=lambda row: row["fault"])), ""):
        those = [row for row in rows if fault in ("", row["fault"])]
        done, bad = (sum(map(bool, column)) for column in zip(*((r["ended"] == "done", r["problems"]) for r in those)))
        most = [max((row.get(key, 0.0) for row in those), default=0.0) for key in ("force", "speed", "joint_speed")]
        deepest = max((_SURFACE - row["low"][2] for row in those if "low" in row), default=0.0)
        figures = f"{most[0]:.1f} | {1e3 * most[1]:.1f} | {math.degrees(most[2]):.0f} | {1e3 * deepest:.1f}"
        print(f"| {fault or 'all'} | {len(those)} | {done} | {bad} | {figures} |")
    simulated, processor = (sum(row[key] for row in rows) for key in ("simulated", "processor"))
    print(f"{simulated:.0f} s simulated in {processor:.0f} s of processor time")


def main() -> None:
    """The scenes that are left, and the table of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("-o", "--output", type=Path, default=Path("scenes.jsonl"))
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--grid", action="store_true")
    parser.add_argument("--processes", type=int)
    given = parser.parse_args()
    if given.seed is not None:
        scene = drawn(given.seed) if given.seed < _GRID else grid()[given.seed - _GRID]
        print(json.dumps(row_of(scene, Path("scenes")), indent=2))
        return
    known = {row["seed"] for row in read(given.output)}
    if not given.table:
        scenes = grid() if given.grid else [drawn(seed) for seed in range(given.first, given.first + given.count)]
        work([scene for scene in scenes if scene.seed not in known], given.output, given.processes)
    if rows := read(given.output):
        table(rows)


def read(file: Path) -> list[dict[str, Any]]:
    """The scenes that a file has; a line that was cut does not count."""
    rows = []
    for line in file.read_text().splitlines() if file.exists() else ():
        with contextlib.suppress(json.JSONDecodeError):
            rows.append(json.loads(line))
    return rows


if __name__ == "__main__":
    sys.exit(main())
