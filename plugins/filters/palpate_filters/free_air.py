"""The noise of force and velocity, from the record's free air."""

from __future__ import annotations

import numpy as np
from palpate import LogError, Samples

_ENOUGH = 50  # samples
_KEPT = 2000  # samples; the latest before contact


class FreeAir:
    """Gathers the samples before the first contact and tells how noisy they are."""

    def __init__(self) -> None:
        self._force = np.zeros(0)
        self._velocity = np.zeros(0)

    def add(self, samples: Samples) -> None:
        """Take in samples; those in contact are left out."""
        rows = ~samples.contact
        self._force = np.concatenate([self._force, samples.force[rows]])[-_KEPT:]
        self._velocity = np.concatenate([self._velocity, samples.velocity[rows]])[-_KEPT:]

    def noise(self) -> tuple[float, float]:
        """Standard deviations of force [N] and velocity [m/s]; raises LogError where there was too little free air.

        From second differences, in which slow motion and drift drop out: white noise of standard deviation s gives them
        a variance of 6 s^2.
        """
        found = []
        for values in (self._force, self._velocity):
            curvature = np.diff(values, 2)
            curvature = curvature[np.isfinite(curvature)]
            if len(curvature) < _ENOUGH:
                raise LogError(
                    f'noise = "measure" needs {_ENOUGH} samples of free air before the first '
                    f'contact, the record has {len(curvature)}; set noise = "given", force_std and velocity_std'
                )
            found.append(float(np.sqrt(np.mean(curvature**2) / 6.0)))
        if min(found) <= 0.0:
            raise LogError('noise = "measure": force or velocity is constant in free air')
        return found[0], found[1]
