"""A rig that gives way: the force on a tip behind a spring."""

from __future__ import annotations

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen

DIFFERENCE_STEP = 1e-7  # [m] of depth over which the contact's stiffness is taken (a choice: 0.1 um of millimetres)
DEFLECTION_ERROR = 1e-9  # [m] up to which the deflection is solved (a choice: far below any encoder's resolution)
MAX_STEPS = 100  # of Newton's method (a choice): with more of them the spring counts as too soft


def motion_behind_spring(
    specimen: Specimen, instants: Floats, position: Floats, velocity: Floats, stiffness: float
) -> tuple[Floats, Floats]:
    """Return positions and velocities (n, 3) of a tip on a spring of stiffness k [N/m], which the force F deflects.

    `position` and `velocity` (n, 3) at instants (n,) [s] are those that the robot measures. The tip is up by the
    deflection x with k x = F(d - x), d being the depth without a spring and F the force along the tool without
    friction; its velocity along z is that of the robot times 1/(1 + K/k), K = dF/dd. Raises ConfigurationError for a
    model with memory, and where no x is found.
    """
    if specimen.model.memory:
        raise ConfigurationError("device sim: series_stiffness: a specimen with memory cannot be behind a spring")

    def deflected_motion(deflection: Floats, speed_ratio: Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities (n, 3) of the tip."""
        tip_position, tip_velocity = position.copy(), velocity.copy()
        tip_position[:, 2] += deflection
        tip_velocity[:, 2] *= speed_ratio
        return tip_position, tip_velocity

    def force_along_tool(deflection: Floats, speed_ratio: Floats) -> Floats:
        """Return F (n,) [N]."""
        tip_position, tip_velocity = deflected_motion(deflection, speed_ratio)
        skin = SkinUnderTip(specimen, tip_position)
        force = skin.push(instants, tip_velocity)
        return force if specimen.form is None else force * skin.normal[:, 2]

    # Newton's method for k x - F = 0, at all instants at once.
    deflection, speed_ratio = np.zeros(len(instants)), np.ones(len(instants))
    for _ in range(MAX_STEPS):
        force = force_along_tool(deflection, speed_ratio)
        deeper_force = force_along_tool(deflection - DIFFERENCE_STEP, speed_ratio)
        contact_stiffness = np.maximum((deeper_force - force) / DIFFERENCE_STEP, 0.0)
        step = (force / stiffness - deflection) / (1.0 + contact_stiffness / stiffness)
        deflection, speed_ratio = deflection + step, 1.0 / (1.0 + contact_stiffness / stiffness)
        if np.abs(step).max(initial=0.0) < DEFLECTION_ERROR:
            return deflected_motion(deflection, speed_ratio)
    raise ConfigurationError(
        f"device sim: series_stiffness: {1e-3 * stiffness:g} N/mm is too soft for the specimen: no equilibrium is found"
    )
