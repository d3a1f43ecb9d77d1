"""The force of a skin on a tip as it goes: along the normal, and what friction adds across it."""

from __future__ import annotations

import math

import numpy as np
from palpate import Floats

from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen

_DEEPER = 1e-7  # [m] over which the stiffness of the contact is taken
_FASTER = 1e-6  # [m/s] over which its damping is


class SkinContact:
    """Contact force of a skin over time; what the tip drags along is remembered from call to call.

    A skin that is level and flat has the friction of `Specimen.with_friction`. On any other, friction is Mindlin's: the
    contact sticks with 2 (1 - nu)/(2 - nu) of its stiffness and damping along the normal, and slips where that would
    be more than mu times the force along the normal. That the rim slips before the middle is left out.
    """

    def __init__(self) -> None:
        self._spring = np.zeros(3)  # [N] that the stretched skin holds against
        self._place: Floats | None = None  # (3,) [m] of the tip, at the end of the last call

    def force(self, specimen: Specimen, instants: Floats, position: Floats, velocity: Floats) -> Floats:
        """Force (n, 3) [N] on a tip at positions (n, 3) with velocities (n, 3), at instants (n,) [s] in order."""
        under = SkinUnderTip(specimen, position)
        contact = under.push(instants, velocity)
        if specimen.form is None:
            return specimen.with_friction(contact, velocity)
        force = contact[:, None] * under.normal
        if not specimen.friction:
            return force
        if not contact.any():
            self._spring = np.zeros(3)
            self._place = position[-1] if len(position) else self._place
            return force
        slow = velocity if specimen.model.memory else np.zeros_like(velocity)  # what remembers has no force at rest
        deep = SkinUnderTip(specimen, position - _DEEPER * under.normal).push(instants, slow)
        fast = under.push(instants, velocity - _FASTER * under.normal)
        stiffness, damping = (deep - under.push(instants, slow)) / _DEEPER, (fast - contact) / _FASTER
        poisson = float(getattr(specimen.model, "poisson", 0.5))
        share = 2.0 * (1.0 - poisson) / (2.0 - poisson)
        limit = specimen.friction * contact
        return force + self._friction(position, velocity, under.normal, limit, share * stiffness, share * damping)

    def _friction(
        self, position: Floats, velocity: Floats, normal: Floats, limit: Floats, stiffness: Floats, damping: Floats
    ) -> Floats:
        """Force (n, 3) [N] across normals (n, 3), of limits (n,) [N], by the contact's stiffness and damping (n,)."""
        before = position[:1] if self._place is None else self._place[None]
        self._place = position[-1] if len(position) else self._place
        step, speed = (_across(way, normal) for way in (np.diff(position, axis=0, prepend=before), velocity))
        springs, dampers = -stiffness[:, None] * step, -damping[:, None] * speed
        columns = [column.tolist() for column in (*springs.T, *dampers.T, *normal.T, limit)]
        (x, y, z), force = self._spring.tolist(), list[float]()
        for by_x, by_y, by_z, drag_x, drag_y, drag_z, out_x, out_y, out_z, most in zip(*columns, strict=True):
            if most <= 0.0:
                x = y = z = 0.0
                force += (0.0, 0.0, 0.0)
                continue
            x, y, z = x + by_x, y + by_y, z + by_z
            out = x * out_x + y * out_y + z * out_z
            x, y, z = x - out * out_x, y - out * out_y, z - out * out_z
            whole_x, whole_y, whole_z = x + drag_x, y + drag_y, z + drag_z
            if (size := math.hypot(whole_x, whole_y, whole_z)) > most:
                share = most / size
                x, y, z = share * x, share * y, share * z
                whole_x, whole_y, whole_z = share * whole_x, share * whole_y, share * whole_z
            force += (whole_x, whole_y, whole_z)
        self._spring = np.array([x, y, z])
        return np.array(force).reshape(-1, 3)


def _across(vectors: Floats, normal: Floats) -> Floats:
    """Return the part (n, 3) of vectors (n, 3) that is across normals (n, 3)."""
    return np.asarray(vectors - np.sum(vectors * normal, axis=1)[:, None] * normal)
