"""The inverse of a reduced profile: contact radius by depth, as exact as the profile is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from palpate import Floats

_TABLE_SIZE = 1500  # a choice: radii at which the reduced profile is tabulated
_ROUNDING = 1e-14  # of the depth range
_MIN_FACE = 1e-3  # of the edge, a choice: a tip that is flat over less has an apex
_SECANT_STEPS = 3  # a choice: from the table's inverse to the exact one
_STEP = 1e-5  # of the radius beyond the face, a choice: difference of a secant
_MIN_STEP = 1e-12  # of the edge, a choice: its least value
_MAX_CHANGE = 0.1  # of the radius beyond the face, a choice: a larger step overshoots
_HALVINGS = 60  # of the edge: 1e-18, below rounding


class ContactRadius:
    """The contact radius a at w = (d/D)^(1/4), by a table of the reduced profile and a few secant steps.

    `depth` D [m] is that at which the edge [m] touches, `face` [m] the contact radius at depth 0. Raises ValueError
    where the reduced profile is not finite or does not grow.
    """

    def __init__(self, reduced: Callable[[Floats], Floats], edge: float) -> None:
        """Tabulate a reduced profile g(x) up to the edge [m]; raises ValueError where it does not grow."""
        from scipy.interpolate import PchipInterpolator

        depth = float(reduced(np.array([edge]))[0])
        if not np.isfinite(depth):
            raise ValueError(f"the reduced profile is not finite at the edge, a radius of {edge:.4g} m")
        if depth <= 0:
            raise ValueError("the profile does not rise anywhere: that is the tip 'flat'")
        # The table, dense at the apex: radii by the fourth power of even steps, as depths are the fourth power of w.
        # Below rounding it is not monotonic.
        face = _face(reduced, edge, depth)
        x = face + (edge - face) * np.linspace(0.0, 1.0, _TABLE_SIZE + 1) ** 4
        g = np.concatenate([[0.0], reduced(x[1:])])
        is_significant = g > _ROUNDING * depth
        is_significant[0] = True
        x, g = x[is_significant], g[is_significant]
        level_rows = np.flatnonzero(~(np.diff(g) > 0))
        if len(level_rows):
            raise ValueError(f"the reduced profile does not grow at a radius of {x[level_rows[0]]:.4g} m")
        self.depth, self.face, self.edge = depth, face, edge
        self._reduced = reduced
        self._guess = PchipInterpolator((g / depth) ** 0.25, x)

    def __call__(self, w: Floats) -> Floats:
        """Return contact radii (n,) [m] at values of w (n,) from 0 to 1."""
        depth = self.depth * w**4
        a = np.clip(self._guess(w), self.face, self.edge)
        for _ in range(_SECANT_STEPS):
            step = _STEP * (a - self.face) + _MIN_STEP * self.edge
            inward = np.where(a > self.edge / 2, -step, step)
            g = self._reduced(a)
            slope = (self._reduced(a + inward) - g) / inward
            trial = np.where(slope > 0, a - (g - depth) / np.where(slope > 0, slope, 1.0), a)
            # Where the table is coarse against the curve, at a face, a step may overshoot: keep to the table's side.
            max_change = _MAX_CHANGE * (a - self.face) + _MIN_STEP * self.edge
            a = np.where(np.abs(trial - a) < max_change, trial, a)
        return np.clip(np.where(w <= 0, self.face, a), self.face, self.edge)


def _face(reduced: Callable[[Floats], Floats], edge: float, depth: float) -> float:
    """Return the radius [m] of a flat face, 0 for a tip without one; by halving.

    A face touches all at once: the reduced profile is 0 up to its edge, which is the contact radius at depth 0.
    """
    low, high = 0.0, edge
    if float(reduced(np.array([_MIN_FACE * edge]))[0]) > _ROUNDING * depth:
        return 0.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        is_face = float(reduced(np.array([middle]))[0]) <= _ROUNDING * depth
        low, high = (middle, high) if is_face else (low, middle)
    return low if low > _MIN_FACE * edge else 0.0
