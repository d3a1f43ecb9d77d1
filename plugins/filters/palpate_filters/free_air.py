"""The noise of force and velocity, from the standstill before a motion or from the record's free air."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import Floats, LogError, Samples

_ENOUGH = 50  # samples
_KEPT = 2000  # samples; the latest before contact
_STILL = 1e-4  # [m]; a tip that goes further was not at rest


@dataclass(frozen=True)
class MeasuredNoise:
    """What was measured, and in which part of the record."""

    force: float  # [N]
    velocity: float  # [m/s]
    source: Literal["standstill", "free air"]


class FreeAir:
    """Gathers the samples before the first contact and determines their noise.

    `standstill` is how long the tip is known to hang still at the beginning of the record [s]; None where it is not
    declared.
    """

    def __init__(self, standstill: float | None = None) -> None:
        self._standstill = standstill
        self._air: Floats = np.zeros((2, 0))  # force, velocity
        self._still: Floats = np.zeros((3, 0))  # force, velocity, position

    def add(self, samples: Samples) -> None:
        """Take in samples; those in contact are left out."""
        rows = ~samples.contact
        new = np.array([samples.force[rows], samples.velocity[rows], samples.position[rows]])
        self._air = np.concatenate([self._air, new[:2]], axis=1)[:, -_KEPT:]
        if self._standstill is not None:
            still = new[:, samples.time[rows] < self._standstill]
            self._still = np.concatenate([self._still, still], axis=1)

    def noise(self) -> MeasuredNoise:
        """Standard deviations at standstill, else over the free air; raises LogError where there was too little."""
        found = self._at_standstill()
        if found is None:
            found = MeasuredNoise(_from_curvature(self._air[0]), _from_curvature(self._air[1]), "free air")
        if min(found.force, found.velocity) <= 0.0:
            raise LogError('noise = "measure": force or velocity is constant in free air')
        return found

    def _at_standstill(self) -> MeasuredNoise | None:
        """None where there was no standstill, or not enough of it."""
        force, velocity, position = (values[np.isfinite(values)] for values in self._still)
        if min(len(force), len(velocity), len(position)) < _ENOUGH or np.ptp(position) > _STILL:
            return None
        return MeasuredNoise(float(force.std(ddof=1)), float(velocity.std(ddof=1)), "standstill")


def _from_curvature(values: Floats) -> float:
    """From second differences, in which slow motion and drift drop out.

    White noise of standard deviation s gives them a variance of 6 s^2.
    """
    curvature = np.diff(values, 2)
    curvature = curvature[np.isfinite(curvature)]
    if len(curvature) < _ENOUGH:
        raise LogError(
            f'noise = "measure" needs {_ENOUGH} samples of free air before the first '
            f'contact, the record has {len(curvature)}; set noise = "given", force_std and velocity_std'
        )
    return float(np.sqrt(np.mean(curvature**2) / 6.0))
