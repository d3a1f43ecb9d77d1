"""How often the calibration's 95 % intervals hold the truth, and how far off its values are, on the simulated rig.

Run it with: python benchmarks/calibration.py [--runs 100] [--quick]
Each run is a whole calibration: rest, shake, rest, three times, with its own noise. For each rig: coverage of the 95 %
interval, RMS error, and mean stated standard uncertainty, of every value.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from palpate.alignment import GRAVITY, AlignmentSettings
from palpate.calibration import CalibrationSettings, Measured, Record, Recorder, calibrate
from palpate_devices.sim import SimulatedRig
from palpate_models import DimensionalityReduction, Sphere
from palpate_trajectories.shake import Shake

MODEL = DimensionalityReduction(indenter=Sphere(radius=0.005))
CHANNELS = AlignmentSettings.model_validate(
    {"force": "rig.wrench.z", "position": "rig.tip.z", "velocity": "rig.twist.z"}
)


def rig(**settings: object) -> SimulatedRig:
    """A rig over some specimen, which the tip never touches."""
    specimen = {"model": MODEL, "elasticity": 112.5e3, "viscosity": 362.0}
    return SimulatedRig.model_validate({"specimen": specimen, **settings})


def record(device: SimulatedRig, shake: Shake, seed: int) -> Record:
    """One repeat."""
    recorder = Recorder(CHANNELS, {"rig": device.streams})
    with device.connect(seed) as link:
        link.follow(shake)  # type: ignore[attr-defined]
        for batch in link.batches():
            recorder.feed("rig", batch)
    return recorder.record()


def truths(device: SimulatedRig, shake: Shake) -> dict[str, float]:
    """What the values should be; the offset is that of the first rest's middle."""
    weight = device.tip_mass * GRAVITY
    return {
        "mass": device.tip_mass,
        "delay": device.force_delay - device.motion_delay,
        "offset": device.bias - weight + device.drift * shake.rest / 2,
        "weight": weight,
        "bias": device.bias + device.drift * shake.rest / 2,
        "drift": device.drift,
        "force_std": device.force_std,
        "velocity_std": device.velocity_std,
    }


def covered(device: SimulatedRig, shake: Shake, runs: int) -> dict[str, tuple[float, float, float]]:
    """Coverage, RMS error and mean stated standard uncertainty, by value."""
    truth = truths(device, shake)
    found: dict[str, list[Measured]] = {name: [] for name in truth}
    for run in range(runs):
        session = calibrate([record(device, shake, 1000 * run + k) for k in range(3)], CalibrationSettings())
        for name in truth:
            found[name].append(session.values[name])
    table = {}
    for name, values in found.items():
        inside = np.mean([v.interval[0] <= truth[name] <= v.interval[1] for v in values])
        error = np.sqrt(np.mean([(v.value - truth[name]) ** 2 for v in values]))
        table[name] = float(inside), float(error), float(np.mean([v.combined for v in values]))
    return table


RIGS: list[tuple[dict[str, float], dict[str, object]]] = [
    ({"force_delay": 0.0, "tip_mass": 0.14}, {"amplitude": 0.0057}),
    ({"force_delay": 0.0003, "tip_mass": 0.05}, {"amplitude": 0.0057}),
    ({"force_delay": 0.007, "tip_mass": 0.163}, {"amplitude": 0.0057}),
    ({"force_delay": 0.0117, "tip_mass": 0.4}, {"amplitude": 0.0057}),
    ({"motion_delay": 0.0223, "tip_mass": 0.25, "bias": -3.0, "drift": 0.002}, {"amplitude": 0.0057}),
    ({"force_delay": 0.025, "tip_mass": 0.181, "sensor_rate": 500.0}, {"amplitude": 0.0057}),
    ({"force_delay": 0.0045, "tip_mass": 0.14}, {"frequencies": (3.0, 5.0, 7.0), "amplitude": 0.003}),
]


def main() -> None:
    """Print one table for each rig."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_args().runs
    for settings, motion in RIGS:
        began = time.perf_counter()
        table = covered(rig(**settings), Shake.model_validate({**motion, "rest": 1.5}), runs)
        print(f"{settings} {motion}: {runs} runs, {(time.perf_counter() - began) / runs:.2f} s each")
        for name, (inside, error, stated) in table.items():
            print(f"  {name:14} inside {100 * inside:5.1f} %   RMS error {error:.3g}   stated {stated:.3g}", flush=True)


if __name__ == "__main__":
    main()
