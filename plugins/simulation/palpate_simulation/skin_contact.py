"""Force of a skin on a moving tip: contact force along the normal, and friction across it."""

from __future__ import annotations

import math
from operator import add

import numpy as np
from palpate import Floats

from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen

# Differences over which stiffness and damping of the contact are taken (a choice: far below any depth and speed).
DEPTH_STEP = 1e-7  # [m]
SPEED_STEP = 1e-6  # [m/s]
INCOMPRESSIBLE = 0.5  # Poisson's ratio of a model that has none: soft tissue


class SkinContact:
    """Contact force of a skin over time; the stretch of the skin is kept from call to call.

    A skin that is level and flat has the friction of `Specimen.with_friction`. On any other, friction is Mindlin's: the
    contact sticks with 2 (1 - nu)/(2 - nu) of its stiffness and damping along the normal, and slips where that would
    be more than mu times the force along the normal. That the rim slips before the middle is left out.
    """

    def __init__(self) -> None:
        self._spring = np.zeros(3)  # [N] of the stretched skin on the tip
        self._last_position: Floats | None = None  # (3,) [m] of the tip at the end of the last call

    def force(self, specimen: Specimen, instants: Floats, position: Floats, velocity: Floats) -> Floats:
        """Return the force (n, 3) [N] on a tip at positions (n, 3) [m] with velocities (n, 3) [m/s].

        The instants (n,) [s] are in order, and after those of the call before.
        """
        skin = SkinUnderTip(specimen, position)
        contact = skin.push(instants, velocity)
        if specimen.form is None:
            return specimen.with_friction(contact, velocity)
        force = contact[:, None] * skin.normal
        if not specimen.friction:
            return force
        steps = self._steps_to(position)
        if not contact.any():
            self._spring = np.zeros(3)
            return force
        stiffness, damping = _contact_slopes(specimen, skin, instants, velocity, contact)
        poisson = float(getattr(specimen.model, "poisson", INCOMPRESSIBLE))
        mindlin_ratio = 2.0 * (1.0 - poisson) / (2.0 - poisson)
        spring_steps = -(mindlin_ratio * stiffness)[:, None] * _tangential(steps, skin.normal)
        dampers = -(mindlin_ratio * damping)[:, None] * _tangential(velocity, skin.normal)
        return force + self._friction(spring_steps, dampers, skin.normal, specimen.friction * contact)

    def _steps_to(self, position: Floats) -> Floats:
        """Return the step (n, 3) [m] of the tip to each of its positions (n, 3), and keep the last position."""
        start = position[:1] if self._last_position is None else self._last_position[None]
        if len(position):
            self._last_position = position[-1]
        return np.diff(position, axis=0, prepend=start)

    def _friction(self, spring_steps: Floats, dampers: Floats, normal: Floats, limit: Floats) -> Floats:
        """Return the friction (n, 3) [N] across normals (n, 3), at most as large as its limit (n,) [N].

        The spring's force grows by `spring_steps` (n, 3) [N] and turns with the skin; `dampers` (n, 3) [N] are added.
        Where both together are more than the limit the tip slips, and both are scaled down to it. The loop has lists
        of plain numbers for speed.
        """
        spring = self._spring.tolist()
        forces = []
        rows = zip(spring_steps.tolist(), dampers.tolist(), normal.tolist(), limit.tolist(), strict=True)
        for spring_step, damper, unit_normal, largest in rows:
            # Out of contact the skin relaxes.
            if largest <= 0.0:
                spring = [0.0, 0.0, 0.0]
                forces.append(spring)
                continue
            spring = _without_normal_part(list(map(add, spring, spring_step)), unit_normal)
            force = list(map(add, spring, damper))
            # Coulomb's limit.
            if (size := math.hypot(*force)) > largest:
                scale = largest / size
                spring = [scale * component for component in spring]
                force = [scale * component for component in force]
            forces.append(force)
        self._spring = np.array(spring)
        return np.array(forces).reshape(-1, 3)


def _without_normal_part(force: list[float], unit_normal: list[float]) -> list[float]:
    """Return a force (3,) without its part along a normal (3,)."""
    (x, y, z), (n_x, n_y, n_z) = force, unit_normal
    outward = x * n_x + y * n_y + z * n_z
    return [x - outward * n_x, y - outward * n_y, z - outward * n_z]


def _contact_slopes(
    specimen: Specimen, skin: SkinUnderTip, instants: Floats, velocity: Floats, contact: Floats
) -> tuple[Floats, Floats]:
    """Return stiffness (n,) [N/m] and damping (n,) [N s/m] of the contact along the normal, by differences.

    `contact` (n,) [N] is the force along the normal with velocities (n, 3) [m/s].
    """
    # A model with memory has no force at rest: its stiffness is taken in motion.
    slow = velocity if specimen.model.memory else np.zeros_like(velocity)
    deeper_force = skin.deeper(DEPTH_STEP).push(instants, slow)
    faster_force = skin.push(instants, velocity - SPEED_STEP * skin.normal)
    stiffness = (deeper_force - skin.push(instants, slow)) / DEPTH_STEP
    return stiffness, (faster_force - contact) / SPEED_STEP


def _tangential(vectors: Floats, normal: Floats) -> Floats:
    """Return the part (n, 3) of vectors (n, 3) that is across normals (n, 3)."""
    return np.asarray(vectors - np.sum(vectors * normal, axis=1)[:, None] * normal)
