"""What force and motion are measured with: each stream at its own rate and with its own noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_studies.design.tip_path import DepthPath


@dataclass(frozen=True)
class QuantityNoise:
    """Readings of one quantity."""

    rate: float  # [Hz]
    std: float  # of one reading [SI]

    @property
    def density(self) -> float:
        """Variance over rate: what is left of the noise in a second of readings."""
        return self.std**2 / self.rate


@dataclass(frozen=True)
class MeasurementNoise:
    """The streams of a palpation."""

    force: QuantityNoise
    position: QuantityNoise
    velocity: QuantityNoise | None = None
    in_step: bool = False  # every position has a force of its own instant

    def noise(self, path: DepthPath, by_depth: Floats, by_rate: Floats) -> Floats:
        """Noise [N] (n,) of one force reading at each instant of a path, all streams together.

        Densities add up: S = S_F + (F_d^2 + (F_v w)^2) S_d, 1/S_d = 1/S_z + w^2/S_v, where w is the frequency of the
        motion. A depth that is wrong by noise is a force that is wrong by the stiffness times that, and a velocity
        tells a depth of this frequency as well as its noise over w.
        """
        swing = float(np.std(path.depth))
        pulse = float(np.std(path.rate)) / swing if swing > 0 else 0.0
        depth = self.position.density
        if self.velocity is not None and depth > 0 and self.velocity.density > 0:
            depth = 1.0 / (1.0 / depth + pulse**2 / self.velocity.density)
        density = self.force.density + (by_depth**2 + (by_rate * pulse) ** 2) * depth
        sampling = 1.0 / float(path.time[1] - path.time[0])
        return np.asarray(np.sqrt(density * sampling))

    def interpolation(self, path: DepthPath, force: Floats, by_rate: Floats, lag: float) -> Floats:
        """Mean error [N] (n,) of a force that is interpolated on a straight line to the instants of the positions.

        Between readings T apart the error is u (1 - u) T^2/2 times the second derivative of the force, u the place
        between them; its mean over u is T^2/12. A robot that takes a command every h with a `lag` [s] does part of the
        curving at its ticks, the instants themselves: there the acceleration jumps by (a/lag + a') h, the slope of the
        force by F_v times that, and a jump of the slope costs T/6. None where every position has a reading of its own.
        """
        if self.in_step:
            return np.zeros_like(force)
        step = float(path.time[1] - path.time[0])
        wait, tick = 1.0 / self.force.rate, 1.0 / self.position.rate
        second = np.gradient(np.gradient(force, step), step)
        jump = by_rate * (path.acceleration / lag + path.jerk) * tick if lag > 0 else np.zeros_like(force)
        return np.asarray(wait**2 / 12.0 * (second - jump / tick) + wait / 6.0 * jump)
