"""The inverse of a reduced profile: contact radius by depth, as exact as the profile is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from palpate import Floats

_TABLE = 1500  # radii at which the reduced profile is tabulated
_NOTHING = 1e-14  # of the depth range: rounding
_FACE = 1e-3  # of the edge: what is flat over less is an apex
_SETTLE = 3  # secant steps from the table's inverse to the exact one


class ContactRadius:
    """a at w = (d/D)^(1/4), by interpolation in a table of the reduced profile and a few secant steps.

    `depth` D [m] is that at which the edge [m] touches, `face` [m] the contact radius at depth 0. Raises ValueError
    where the reduced profile is not finite or does not grow.
    """

    def __init__(self, reduced: Callable[[Floats], Floats], edge: float) -> None:
        from scipy.interpolate import PchipInterpolator

        depth = float(reduced(np.array([edge]))[0])
        if not np.isfinite(depth):
            raise ValueError(f"the reduced profile is not finite at the edge, a radius of {edge:.4g} m")
        if depth <= 0:
            raise ValueError("the profile does not rise anywhere: that is the tip 'flat'")
        face = _face(reduced, edge, depth)
        x = face + (edge - face) * np.linspace(0.0, 1.0, _TABLE + 1) ** 4
        g = np.concatenate([[0.0], reduced(x[1:])])
        rising = g > _NOTHING * depth  # below, rounding has the say
        rising[0] = True
        x, g = x[rising], g[rising]
        stuck = np.flatnonzero(~(np.diff(g) > 0))
        if len(stuck):
            raise ValueError(f"the reduced profile does not grow at a radius of {x[stuck[0]]:.4g} m")
        self.depth, self.face, self.edge = depth, face, edge
        self._reduced = reduced
        self._guess = PchipInterpolator((g / depth) ** 0.25, x)

    def __call__(self, w: Floats) -> Floats:
        """Contact radii (n,) [m] at values of w (n,) from 0 to 1."""
        wanted = self.depth * w**4
        a = np.clip(self._guess(w), self.face, self.edge)
        for _ in range(_SETTLE):
            step = 1e-5 * (a - self.face) + 1e-12 * self.edge
            inward = np.where(a > self.edge / 2, -step, step)
            g = self._reduced(a)
            slope = (self._reduced(a + inward) - g) / inward
            moved = np.where(slope > 0, a - (g - wanted) / np.where(slope > 0, slope, 1.0), a)
            # Where the table is coarse against the curve, at a face, a step may overshoot: keep to the table's side.
            a = np.where(np.abs(moved - a) < 0.1 * (a - self.face) + 1e-12 * self.edge, moved, a)
        return np.clip(np.where(w <= 0, self.face, a), self.face, self.edge)


def _face(reduced: Callable[[Floats], Floats], edge: float, depth: float) -> float:
    """Radius [m] of a flat face, 0 for a tip without one.

    A face touches all at once: the reduced profile is 0 up to its edge, which is the contact radius at depth 0.
    """
    low, high = 0.0, edge
    if float(reduced(np.array([_FACE * edge]))[0]) > _NOTHING * depth:
        return 0.0
    for _ in range(60):
        middle = (low + high) / 2
        inside = float(reduced(np.array([middle]))[0]) <= _NOTHING * depth
        low, high = (middle, high) if inside else (low, middle)
    return low if low > _FACE * edge else 0.0
