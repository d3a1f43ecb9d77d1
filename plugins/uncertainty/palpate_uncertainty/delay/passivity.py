"""What says without any contact model that a force is late: a passive contact gives out no work."""

from __future__ import annotations

import numpy as np
from palpate import Tail
from palpate_engine import acceleration

_DEGREE = 5  # of the elastic force over the depth
_PIECES = 12  # of the record, between which chance is independent
_ENOUGH = 200  # samples that go both ways over the same depths
_SIGMAS = 5.0
_LEAST = 3e-4  # [s]


def force_lateness(tail: Tail, tip_mass: float) -> float | None:
    """How late [s] the force is at least, where the contact gives out more work than chance explains; else None.

    In F = p(z) - c v, with p any elastic law, v the velocity (down is negative) and m the mass of the tip taken off,
    a material that dissipates has c > 0, and a force late by t adds -t dF/dz v: c + t p' is found, which is negative
    where t is longer than the material's own eta/G. The answer is what it is longer by.
    """
    force = tail.force + tip_mass * acceleration(tail.time, tail.velocity)
    rows = np.isfinite(force) & np.isfinite(tail.velocity) & np.isfinite(tail.position)
    down, up = (tail.position[rows & way] for way in (tail.velocity < 0, tail.velocity > 0))
    if min(len(down), len(up)) < _ENOUGH / 2:
        return None
    low, high = max(float(down.min()), float(up.min())), min(float(down.max()), float(up.max()))
    rows &= (tail.position >= low) & (tail.position <= high)
    if np.count_nonzero(rows) < _ENOUGH or high <= low:
        return None
    place, speed = (2 * tail.position[rows] - low - high) / (high - low), tail.velocity[rows]
    columns = np.polynomial.chebyshev.chebvander(place, _DEGREE)
    # Sums, not a linear solve, so that every machine says the same; the columns are made orthogonal one by one.
    basis: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    for column in (*columns.T, speed):
        for known in basis:
            column = column - known * float((known * column).sum())
        length = float(np.sqrt((column**2).sum()))
        basis.append(column / length if length > 0 else column)
    *elastic, across = basis
    rest = force[rows]
    for known in elastic:
        rest = rest - known * float((known * rest).sum())
    drag = float((across * rest).sum())  # of the force along the velocity, times the velocity's length
    rest = rest - across * drag
    pieces = [float(part.sum()) for part in np.array_split(across * rest, _PIECES)]
    chance = float(np.sqrt((np.array(pieces) ** 2).sum()))
    length = float((across * speed).sum())
    slope = -float(((force[rows] - force[rows].mean()) * (place - place.mean())).sum())
    slope *= 2 / (high - low) / float(((place - place.mean()) ** 2).sum())  # [N/m] force over depth
    if length <= 0 or slope <= 0:
        return None
    late, doubt = drag / length / slope, chance / length / slope
    return late if late > max(_LEAST, _SIGMAS * doubt) else None
