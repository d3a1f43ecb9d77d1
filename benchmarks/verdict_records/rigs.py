"""Rigs: tip, motion, rates, noise and stiffness of instruments and robots; written down before the first run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]


@dataclass(frozen=True)
class Rig:
    """One rig [SI]."""

    name: str
    words: str
    tip: Literal["paraboloid", "sphere", "flat", "cone"]
    size: float  # radius [m], or angle of the cone's face to the surface [rad]
    modulus: tuple[float, float]  # [Pa] range of E
    lag: tuple[float, float]  # [s] range of eta/G
    motion: Literal["hold", "triangle", "sine"]
    depth: float  # [m] the deepest
    pace: float  # [s] from touch to the deepest, or period of the sine
    rate: float  # [Hz]
    noise: float  # [N]
    height_noise: float = 0.0  # [m]
    speed_noise: float | None = None  # [m/s]; None: no channel of speed
    mass: float = 0.0  # [kg] behind the sensor
    channel: Literal["plain", "low-pass", "held", "rounded", "hum"] = "plain"
    pose_rate: float | None = None  # [Hz] of a pose that is a topic of its own, with stamps of its own
    units: tuple[str, str] = ("N", "mm")

    @property
    def tip_words(self) -> str:
        """The tip as `--tip` takes it."""
        if self.tip == "cone":
            return f"cone angle {np.degrees(self.size):.10g} deg"
        return f"{self.tip} {1e6 * self.size:.10g} um"


_MS = 1e-3
RIGS = {
    rig.name: rig
    for rig in (
        Rig("afm", "AFM: paraboloid 5 um, 1 um deep, a second each way", "paraboloid", 5e-6, (5e3, 50e3),
            (0.0, 2 * _MS), "triangle", 1e-6, 1.0, 2000, 5e-11, 0.3e-9, units=("nN", "um")),
        Rig("beam", "indenter on a beam of glass: paraboloid 50 um, 8 um deep, held", "paraboloid", 50e-6, (5e3, 100e3),
            (0.0, 5 * _MS), "hold", 8e-6, 2.0, 1000, 2e-8, 5e-9, units=("uN", "um")),
        Rig("texture", "texture analyser: flat 5 mm, 4 mm deep at 1 mm/s and back", "flat", 5e-3, (5e3, 200e3),
            (0.0, 3 * _MS), "triangle", 4e-3, 4.0, 200, 5e-3, 1e-6),
        Rig("cone", "texture analyser: cone, 5 mm deep at 2 mm/s and back", "cone", np.radians(45.0), (5e3, 200e3),
            (0.0, 3 * _MS), "triangle", 5e-3, 2.5, 250, 5e-3, 1e-6),
        Rig("instron", "Instron: paraboloid 6.35 mm, a ramp of 0.1 mm/s, 50 Hz", "paraboloid", 6.35e-3, (50e3, 1e6),
            (0.0, 5 * _MS), "triangle", 2e-3, 20.0, 50, 20e-3, 0.2e-6),
        Rig("press", "indenter with a good encoder: paraboloid 3 mm, ramp and hold", "paraboloid", 3e-3, (10e3, 500e3),
            (1 * _MS, 10 * _MS), "hold", 2e-3, 1.2, 500, 3e-3),
        Rig("robot-speed", "robot with a speed: paraboloid 5 mm, 2 Hz, 140 g", "paraboloid", 5e-3, (50e3, 500e3),
            (3 * _MS, 12 * _MS), "sine", 4e-3, 0.5, 500, 50e-3, 5e-6, 0.67e-3, 0.14),
        Rig("robot", "robot without a speed: paraboloid 5 mm, 2 Hz, 140 g", "paraboloid", 5e-3, (50e3, 500e3),
            (3 * _MS, 12 * _MS), "sine", 4e-3, 0.5, 250, 20e-3, 5e-6, None, 0.14),
        Rig("robot-ramp", "robot without a speed: paraboloid 5 mm, a ramp of 3 mm/s and back, 140 g", "paraboloid",
            5e-3, (20e3, 500e3), (3 * _MS, 12 * _MS), "triangle", 4e-3, 1.3, 500, 20e-3, 3e-6, None, 0.14),
        Rig("ros-125", "topics of a wrench at 500 Hz and a pose at 125 Hz: paraboloid 3 mm, ramp and hold",
            "paraboloid", 3e-3, (20e3, 500e3), (1 * _MS, 10 * _MS), "hold", 2e-3, 1.5, 500, 10e-3, 3e-6,
            pose_rate=125.0),
        Rig("ros-500", "topics of a wrench at 500 Hz and a pose at 500 Hz: paraboloid 5 mm, 1 Hz", "paraboloid", 5e-3,
            (20e3, 500e3), (3 * _MS, 12 * _MS), "sine", 3e-3, 1.0, 500, 20e-3, 5e-6, pose_rate=500.0),
        Rig("dma", "DMA-like: flat 5 mm, a sine of 5 Hz about 1.5 mm", "flat", 5e-3, (20e3, 1e6), (0.5 * _MS, 5 * _MS),
            "sine", 1.5e-3, 0.2, 500, 10e-3, 0.5e-6),
        Rig("low-pass", "the force's noise through a low-pass of 20 Hz: paraboloid 3 mm, ramp and hold", "paraboloid",
            3e-3, (10e3, 500e3), (1 * _MS, 10 * _MS), "hold", 2e-3, 1.2, 500, 10e-3, 1e-6, channel="low-pass"),
        Rig("held", "a force of 100 Hz in a table of 500 Hz: paraboloid 3 mm, ramp and back", "paraboloid", 3e-3,
            (10e3, 500e3), (0.0, 3 * _MS), "triangle", 2e-3, 4.0, 500, 5e-3, 1e-6, channel="held"),
        Rig("rounded", "force in steps of 10 mN, height of 1 um: flat 3 mm, ramp and back", "flat", 3e-3, (20e3, 500e3),
            (0.0, 5 * _MS), "triangle", 2e-3, 2.0, 200, 3e-3, channel="rounded"),
        Rig("hum", "a hum of 50 Hz, 15 mN: paraboloid 5 mm, ramp and hold", "paraboloid", 5e-3, (10e3, 500e3),
            (1 * _MS, 8 * _MS), "hold", 2e-3, 1.0, 500, 5e-3, 1e-6, channel="hum"),
        Rig("ball", "indenter with a good encoder: sphere 3 mm, 2 mm deep, ramp and hold", "sphere", 3e-3,
            (10e3, 500e3), (1 * _MS, 10 * _MS), "hold", 2e-3, 1.2, 500, 3e-3),
        Rig("ball-robot", "robot without a speed: sphere 5 mm, 4 mm deep, 2 Hz, 140 g", "sphere", 5e-3, (50e3, 500e3),
            (3 * _MS, 12 * _MS), "sine", 4e-3, 0.5, 250, 20e-3, 5e-6, None, 0.14),
    )
}  # fmt: skip
AIR = 0.8  # [s] at rest before the motion, half of that in AFM's
