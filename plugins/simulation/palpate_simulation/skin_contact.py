"""The force of a skin on a tip as it goes: along the normal, and what friction adds across it."""

from __future__ import annotations

import math

import numpy as np
from palpate import Floats

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
        contact = specimen.push(instants, position, velocity)
        if specimen.form is None:
            return specimen.with_friction(contact, velocity)
        normal = specimen.normal(position)
        force = contact[:, None] * normal
        if not specimen.friction:
            return force
        if not contact.any():
            self._spring = np.zeros(3)
            self._place = position[-1] if len(position) else self._place
            return force
        slow = velocity if specimen.model.memory else np.zeros_like(velocity)  # what remembers has no force at rest
        deeper, faster = position - _DEEPER * normal, velocity - _FASTER * normal
        deep, as_deep, fast = _pushes(specimen, instants, (deeper, slow), (position, slow), (position, faster))
        stiffness, damping = (deep - as_deep) / _DEEPER, (fast - contact) / _FASTER
        poisson = float(getattr(specimen.model, "poisson", 0.5))
        share = 2.0 * (1.0 - poisson) / (2.0 - poisson)
        limit = specimen.friction * contact
        return force + self._friction(position, velocity, normal, limit, share * stiffness, share * damping)

    def _friction(
        self, position: Floats, velocity: Floats, normal: Floats, limit: Floats, stiffness: Floats, damping: Floats
    ) -> Floats:
        """Force (n, 3) [N] across normals (n, 3), of limits (n,) [N], by the contact's stiffness and damping (n,)."""
        before = position[:1] if self._place is None else self._place[None]
        self._place = position[-1] if len(position) else self._place
        step, speed = (_across(way, normal) for way in (np.diff(position, axis=0, prepend=before), velocity))
        springs, dampers = -stiffness[:, None] * step, -damping[:, None] * speed
        rows = zip(springs.tolist(), dampers.tolist(), normal.tolist(), limit.tolist(), strict=True)
        (x, y, z), found = self._spring.tolist(), []
        for (by_x, by_y, by_z), (drag_x, drag_y, drag_z), (out_x, out_y, out_z), most in rows:
            if most <= 0.0:
                x = y = z = 0.0
                found.append((0.0, 0.0, 0.0))
                continue
            x, y, z = x + by_x, y + by_y, z + by_z
            out = x * out_x + y * out_y + z * out_z
            x, y, z = x - out * out_x, y - out * out_y, z - out * out_z
            whole = x + drag_x, y + drag_y, z + drag_z
            size = math.hypot(*whole)
            share = most / size if size > most else 1.0
            x, y, z = share * x, share * y, share * z
            found.append((share * whole[0], share * whole[1], share * whole[2]))
        self._spring = np.array([x, y, z])
        return np.array(found).reshape(-1, 3)


def _pushes(specimen: Specimen, instants: Floats, *motions: tuple[Floats, Floats]) -> list[Floats]:
    """Forces (n,) [N] along the normal of several motions: positions (n, 3) and velocities (n, 3) at the same instants.

    All at once, which takes as long as one; but each by itself where the force depends on the motion before.
    """
    if specimen.model.memory or specimen.unloading == "ting":
        return [specimen.push(instants, *motion) for motion in motions]
    position, velocity = (np.concatenate(columns) for columns in zip(*motions, strict=True))
    return np.split(specimen.push(np.tile(instants, len(motions)), position, velocity), len(motions))


def _across(vectors: Floats, normal: Floats) -> Floats:
    """The part (n, 3) of vectors (n, 3) that is across normals (n, 3)."""
    return np.asarray(vectors - np.sum(vectors * normal, axis=1)[:, None] * normal)
