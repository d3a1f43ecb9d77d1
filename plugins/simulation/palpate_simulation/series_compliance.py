"""A rig that gives way: the force on a tip behind a spring."""

from __future__ import annotations

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen

_STEP = 1e-7  # [m] over which the stiffness of the contact is taken
_CLOSE = 1e-9  # [m]
_MOST = 100  # steps of Newton's


def motion_behind_spring(
    specimen: Specimen, instants: Floats, position: Floats, velocity: Floats, stiffness: float
) -> tuple[Floats, Floats]:
    """Positions and velocities (n, 3) of a tip that goes back by F/k behind what is measured: F = F(d - F/k).

    F is the force along the tool without friction. What is given is what the robot measures. The tip's velocity is that
    of the robot times 1/(1 + K/k), K being the stiffness of the contact. Raises ConfigurationError for a model with
    memory.
    """
    if specimen.model.memory:
        raise ConfigurationError("device sim: series_stiffness: a specimen with memory cannot be behind a spring")

    def left(back: Floats, share: Floats) -> tuple[Floats, Floats]:
        there, moving = position.copy(), velocity.copy()
        there[:, 2] += back
        moving[:, 2] *= share
        return there, moving

    def pushed(back: Floats, share: Floats) -> Floats:
        there, moving = left(back, share)
        under = SkinUnderTip(specimen, there)
        force = under.push(instants, moving)
        return force if specimen.form is None else force * under.normal[:, 2]

    back, share = np.zeros(len(instants)), np.ones(len(instants))
    for _ in range(_MOST):
        force = pushed(back, share)
        slope = np.maximum((pushed(back - _STEP, share) - force) / _STEP, 0.0)
        step = (force / stiffness - back) / (1.0 + slope / stiffness)
        back, share = back + step, 1.0 / (1.0 + slope / stiffness)
        if np.abs(step).max(initial=0.0) < _CLOSE:
            return left(back, share)
    raise ConfigurationError(
        f"device sim: series_stiffness: {1e-3 * stiffness:g} N/mm is too soft for the specimen: no equilibrium is found"
    )
