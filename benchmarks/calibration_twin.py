"""How often a calibration's 95 % intervals hold the truth in the world of the twins, without drivers and clocks.

Run it with: python benchmarks/calibration_twin.py [--runs 100] [--seed 0]
Each run is one shake (5 Hz, 3 mm, 10 s) of the twin's arm with its own hidden delay (0 to 25 ms), mass (50 to 400 g)
and offset. The twin's acceleration is constant within its ticks of 2 ms, and its sensor reads every 1.25 ms: what that
adds to the delay, up to 0.125 ms, is known and counted as truth.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np
from palpate import Channel, Stream
from palpate_calibration.calibration_record import CalibrationRecord, Trace
from palpate_calibration.protocol import calibrate
from palpate_calibration.settings import CalibrationSettings
from palpate_engine.alignment import GRAVITY, Health
from palpate_kit.kinematics.rotations import pose_of
from palpate_models import DimensionalityReduction, Sphere
from palpate_simulation.twins.bench import VirtualBench
from palpate_simulation.twins.world import World
from palpate_trajectories.shake import Shake

SHAKE = Shake(amplitude=0.00301, height=0.03)
MODEL = DimensionalityReduction(indenter=Sphere(radius=0.005))
PERIOD, TICK = 1.25e-3, 2e-3  # [s]


def seen(delay: float) -> float:
    """The delay [s] that the readings have: the mean over the places of eight readings within their ticks."""
    places = np.mod(PERIOD * np.arange(8) - delay, TICK)
    places[places < 1e-9] = TICK
    return delay + float(places.mean()) - TICK / 2


def record(bench: VirtualBench, seed: int) -> CalibrationRecord:
    """One shake, tick by tick."""
    world = World(bench, seed)
    try:
        return _shaken(world, bench)
    finally:
        world.close()


def _shaken(world: World, bench: VirtualBench) -> CalibrationRecord:
    sensor, readings, heights = world.sensor, [], []
    sensor._sinc, sensor._mode, sensor._next = 64, "run", 0.0
    sensor.poll = lambda now: None  # type: ignore[method-assign]
    sensor.send = lambda instants, wrench: readings.extend(zip(instants, wrench[:, 2], strict=True))  # type: ignore[method-assign]
    count = math.floor(SHAKE.total_duration / TICK)
    path = SHAKE.at(TICK * np.arange(count)).position
    turn, origin = bench.work.matrix[:3, :3], bench.work.matrix[:3, 3]
    for place in path:
        world.controller.arm.servo_to_pose(pose_of(bench.work.tool_pose(place)), 0.03, 1000.0)
        world._tick()
        measured = np.array(world.controller.state()["actual_TCP_pose"][:3])
        heights.append((world.controller.now, float((turn.T @ (measured - origin))[2])))
    tracks = []
    for name, unit, rows in (("wrench", "N", readings), ("tip", "m", heights)):
        table = np.array(rows)
        tracks.append(Trace(table[:, 0], table[:, 1], Health(Stream(name, (Channel("z", unit),), 800.0))))
    return CalibrationRecord(tracks[0], tracks[1], None)


def main() -> None:
    """Print one line for each value."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    found: dict[str, list[tuple[bool, float, float]]] = {"mass": [], "delay": [], "offset": []}
    folder = Path(tempfile.mkdtemp())
    for run in range(given.runs):
        delay, mass, bias = rng.uniform(0, 0.025), rng.uniform(0.05, 0.4), rng.uniform(-5, 5)
        bench = VirtualBench.model_validate(
            {
                "host": "127.8.0.1",
                "port": folder / "port",
                "specimen": {"model": MODEL, "elasticity": 112.5e3, "viscosity": 362.0},
                "work": {"origin": (-0.3, -0.13, 0.1)},
                "height": 0.03,
                "tip_mass": mass,
                "force_delay": delay,
                "bias": bias,
                "drift": 0.0,
            }
        )
        values = calibrate([record(bench, given.seed + run)], CalibrationSettings()).values
        truth = {"mass": mass, "delay": seen(delay), "offset": bias - mass * GRAVITY}
        for name, pairs in found.items():
            low, high = values[name].interval
            pairs.append((low <= truth[name] <= high, values[name].value - truth[name], values[name].combined))
    for name, pairs in found.items():
        inside, errors, stated = (np.array(column) for column in zip(*pairs, strict=True))
        print(
            f"{name:7} inside {int(inside.sum())} of {len(pairs)}   RMS error {np.sqrt(np.mean(errors**2)):.3g}   "
            f"largest {np.abs(errors).max():.3g}   stated {stated.mean():.3g}"
        )


if __name__ == "__main__":
    main()
