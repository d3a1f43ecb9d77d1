"""A rig that gives way: the force on a tip behind a spring."""

from __future__ import annotations

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_simulation.specimen import Specimen

_STEP = 1e-7  # [m] over which the stiffness of the contact is taken
_CLOSE = 1e-9  # [m]
_MOST = 100  # steps of Newton's


def force_behind_spring(
    specimen: Specimen, instants: Floats, position: Floats, velocity: Floats, stiffness: float
) -> Floats:
    """Contact force (n,) [N] where the tip goes back by F/k behind what is measured: F = F(d - F/k).

    Positions and velocities (n, 3) are those that the robot measures. The tip's velocity is that of the robot times
    1/(1 + K/k), K being the stiffness of the contact. Raises ConfigurationError for a model with memory.
    """
    if specimen.model.memory:
        raise ConfigurationError("device sim: series_stiffness: a specimen with memory cannot be behind a spring")

    def pushed(back: Floats, share: Floats) -> Floats:
        there, moving = position.copy(), velocity.copy()
        there[:, 2] += back
        moving[:, 2] *= share
        return specimen.push(instants, there, moving)

    back, share = np.zeros(len(instants)), np.ones(len(instants))
    for _ in range(_MOST):
        force = pushed(back, share)
        slope = np.maximum((pushed(back - _STEP, share) - force) / _STEP, 0.0)
        step = (force / stiffness - back) / (1.0 + slope / stiffness)
        back, share = back + step, 1.0 / (1.0 + slope / stiffness)
        if np.abs(step).max(initial=0.0) < _CLOSE:
            return pushed(back, share)
    raise ConfigurationError(
        f"device sim: series_stiffness: {1e-3 * stiffness:g} N/mm is too soft for the specimen: no equilibrium is found"
    )
