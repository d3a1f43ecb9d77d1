"""The noise of force and velocity, from the standstill before a motion or from the record's free air."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import Floats, LogError, Samples

_MIN_SAMPLES = 50  # a choice: 50 samples give a standard deviation to 10 %, 1/sqrt(2 n)
_MAX_SAMPLES = 2000  # a choice: the latest before contact
_SECOND_DIFFERENCE_VARIANCE = 6.0  # variance of second differences of white noise of variance 1: 1 + 4 + 1
_MAX_TRAVEL = 1e-4  # [m], a choice: a tip that travels further was not at rest


@dataclass(frozen=True)
class MeasuredNoise:
    """Noise that was measured, and the part of the record that shows it."""

    force: float  # [N]
    velocity: float  # [m/s]
    source: Literal["standstill", "free air"]


class FreeAir:
    """Gathers the samples before the first contact and determines their noise.

    `standstill` [s] is the stretch at the beginning of the record in which the tip is known to hang still; None where
    it is not declared.
    """

    def __init__(self, standstill: float | None = None) -> None:
        self._standstill = standstill
        self._air: Floats = np.zeros((2, 0))  # force, velocity
        self._still: Floats = np.zeros((3, 0))  # force, velocity, position

    def add(self, samples: Samples) -> None:
        """Take in samples; those in contact are left out."""
        rows = ~samples.contact
        new = np.array([samples.force[rows], samples.velocity[rows], samples.position[rows]])
        self._air = np.concatenate([self._air, new[:2]], axis=1)[:, -_MAX_SAMPLES:]
        if self._standstill is not None:
            still = new[:, samples.time[rows] < self._standstill]
            self._still = np.concatenate([self._still, still], axis=1)

    def noise(self) -> MeasuredNoise:
        """Return the noise at standstill, else over the free air; raises LogError where there was too little."""
        noise = self._noise_at_standstill()
        if noise is None:
            noise = MeasuredNoise(_from_curvature(self._air[0]), _from_curvature(self._air[1]), "free air")
        if min(noise.force, noise.velocity) <= 0.0:
            raise LogError('noise = "measure": force or velocity is constant in free air')
        return noise

    def _noise_at_standstill(self) -> MeasuredNoise | None:
        """Return the scatter of the readings at standstill; None without one, or where it is too short."""
        force, velocity, position = (values[np.isfinite(values)] for values in self._still)
        if min(len(force), len(velocity), len(position)) < _MIN_SAMPLES or np.ptp(position) > _MAX_TRAVEL:
            return None
        return MeasuredNoise(float(force.std(ddof=1)), float(velocity.std(ddof=1)), "standstill")


def _from_curvature(values: Floats) -> float:
    """Return the noise of readings from their second differences, in which slow motion and drift drop out.

    White noise of standard deviation s gives them a variance of 6 s^2. Raises LogError of fewer than 50 readings.
    """
    curvature = np.diff(values, 2)
    curvature = curvature[np.isfinite(curvature)]
    if len(curvature) < _MIN_SAMPLES:
        raise LogError(
            f'noise = "measure" needs {_MIN_SAMPLES} samples of free air before the first '
            f'contact, the record has {len(curvature)}; set noise = "given", force_std and velocity_std'
        )
    return float(np.sqrt(np.mean(curvature**2) / _SECOND_DIFFERENCE_VARIANCE))
