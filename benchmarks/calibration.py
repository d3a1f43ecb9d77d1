"""How often the calibration's 95 % intervals hold the truth, and how far off its values are, on the simulated rig.

Run it with: python benchmarks/calibration.py [--runs 100] [--seed 0] [--fixed]
Each run is a whole calibration: standstill, shake (5 Hz, 3 mm, 10 s), standstill, three times, with its
own noise. By default every run has a rig of its own, drawn at random: delay 0 to 25 ms, mass 50 to 400 g, offset, drift
and noises; once with and once without a measured velocity. With --fixed: the same rig in all runs, one rig after the
other. Printed: coverage of the 95 % interval, RMS and largest error, and mean stated uncertainty of every value.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable

import numpy as np
from palpate_calibration.calibrated_value import MeasuredValue
from palpate_calibration.calibration_record import CalibrationRecord, CalibrationRecorder
from palpate_calibration.protocol import calibrate
from palpate_calibration.settings import CalibrationSettings
from palpate_engine.alignment import GRAVITY, AlignmentSettings, Ports
from palpate_models import DimensionalityReduction, Sphere
from palpate_simulation.simulated_rig import SimulatedRig
from palpate_trajectories.shake import Shake

MODEL = DimensionalityReduction(indenter=Sphere(radius=0.005))
CHANNELS = AlignmentSettings.model_validate(
    {"force": "rig.wrench.z", "position": "rig.tip.z", "velocity": "rig.twist.z"}
)
WITHOUT = AlignmentSettings.model_validate({"force": "rig.wrench.z", "position": "rig.tip.z"})


def rig(**settings: object) -> SimulatedRig:
    """A rig over some specimen, which the tip never touches."""
    specimen = {"model": MODEL, "elasticity": 112.5e3, "viscosity": 362.0}
    return SimulatedRig.model_validate({"specimen": specimen, **settings})


def record(device: SimulatedRig, shake: Shake, seed: int, channels: AlignmentSettings = CHANNELS) -> CalibrationRecord:
    """One repeat."""
    recorder = CalibrationRecorder(channels, Ports.of(channels, {"rig": device.streams}))
    with device.connect(seed) as link:
        link.follow(shake)  # type: ignore[attr-defined]
        for batch in link.batches():
            recorder.feed("rig", batch)
    return recorder.record()


def truths(device: SimulatedRig, shake: Shake) -> dict[str, float]:
    """What the values should be; the offset is that of the first standstill's middle."""
    weight = device.tip_mass * GRAVITY
    return {
        "mass": device.tip_mass,
        "delay": device.force_delay - device.motion_delay,
        "offset": device.bias - weight + device.drift * shake.standstill / 2,
        "weight": weight,
        "bias": device.bias + device.drift * shake.standstill / 2,
        "drift": device.drift,
        "force_std": device.force_std,
        "velocity_std": device.velocity_std,
    }


CLOSE = {"mass": 1e-3, "delay": 1e-4}  # [kg], [s] what a shake of 5 Hz, 3 mm and 10 s should reach


def drawn(rng: np.random.Generator) -> SimulatedRig:
    """A rig that nobody knows; either the force or the motion is late, by any fraction of a sample."""
    late = "force_delay" if rng.random() < 0.5 else "motion_delay"
    return rig(
        **{late: rng.uniform(0.0, 0.025)},
        tip_mass=rng.uniform(0.05, 0.4),
        bias=rng.uniform(-5.0, 5.0),
        drift=rng.uniform(-0.002, 0.002),
        force_std=rng.uniform(0.02, 0.1),
        velocity_std=rng.uniform(0.2e-3, 1e-3),
    )


Judged = dict[str, list[tuple[float, MeasuredValue]]]  # by value: truth and finding of each run


def judged(rigs: Iterable[SimulatedRig], shake: Shake, channels: AlignmentSettings, seed: int) -> Judged:
    """Truth and finding of every value in every run."""
    found: Judged = {}
    for run, device in enumerate(rigs):
        records = [record(device, shake, seed + 1000 * run + k, channels) for k in range(3)]
        session = calibrate(records, CalibrationSettings())
        for name, truth in truths(device, shake).items():
            if name in session.values:
                found.setdefault(name, []).append((truth, session.values[name]))
    return found


def report(found: Judged) -> None:
    """One line for each value."""
    for name, pairs in found.items():
        inside = sum(v.interval[0] <= truth <= v.interval[1] for truth, v in pairs)
        errors = np.array([v.value - truth for truth, v in pairs])
        stated = float(np.mean([v.combined for _, v in pairs]))
        print(
            f"  {name:14} inside {inside:3d} of {len(pairs)}   RMS error {np.sqrt(np.mean(errors**2)):.3g}   "
            f"largest {np.abs(errors).max():.3g}   stated {stated:.3g}",
            flush=True,
        )
        if name in CLOSE:
            close = int(np.count_nonzero(np.abs(errors) <= CLOSE[name]))
            print(f"  {'':14} within {CLOSE[name]:g}: {close} of {len(pairs)}", flush=True)


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
    """Print one table for each kind of rig."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fixed", action="store_true")
    given = parser.parse_args()
    if given.fixed:
        for settings, motion in RIGS:
            print(f"{settings} {motion}: {given.runs} runs")
            shake = Shake.model_validate({**motion, "standstill": 1.5})
            report(judged([rig(**settings)] * given.runs, shake, CHANNELS, given.seed))
        return
    for text, channels in (("with velocity", CHANNELS), ("without velocity", WITHOUT)):
        print(f"rigs drawn at random, {text}: {given.runs} runs")
        rng = np.random.default_rng(given.seed)
        rigs = [drawn(rng) for _ in range(given.runs)]
        report(judged(rigs, Shake(amplitude=0.0057), channels, given.seed))


if __name__ == "__main__":
    main()
