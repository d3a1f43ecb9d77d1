"""A test without any contact model that a force is late: a passive contact gives out no work."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from palpate import Floats, Tail
from palpate_engine import acceleration

# Choices: a smooth elastic force, and few enough pieces that residuals of neighbouring ones are independent.
_POLYNOMIAL_DEGREE = 5  # of the elastic force over the depth
_PIECES = 12  # of the record, whose scatter is the standard error
_MIN_SAMPLES = 200  # that go both ways over the same depths
# Choices: the lateness that is reported.
_MIN_STANDARD_ERRORS = 5.0  # [standard errors] of a lateness that is not by chance
_MIN_LATENESS = 3e-4  # [s] of a force ahead of its motion, below which it is not reported

Column = np.ndarray[tuple[int], np.dtype[np.float64]]


def force_lateness(tail: Tail, tip_mass: float) -> float | None:
    """Least lateness [s] of the force, where the contact gives out more work than chance explains; else None.

    In F = p(z) - c v, with p any elastic law, v the velocity (down is negative) and m the mass of the tip taken off,
    a material that dissipates has c > 0, and a force late by t adds -t dF/dz v: c + t p' is found, which is negative
    where t is longer than the material's own eta/G. The answer is what it is longer by.
    """
    force = tail.force + tip_mass * acceleration(tail.time, tail.velocity)
    rows = np.isfinite(force) & np.isfinite(tail.velocity) & np.isfinite(tail.position)
    depths = _common_depths(tail.position[rows & (tail.velocity < 0)], tail.position[rows & (tail.velocity > 0)])
    if depths is None:
        return None
    low, high = depths
    rows &= (tail.position >= low) & (tail.position <= high)
    if np.count_nonzero(rows) < _MIN_SAMPLES or high <= low:
        return None
    # The force as a polynomial of the depth and a share of the velocity, by orthonormal columns.
    depth, speed, force = (2 * tail.position[rows] - low - high) / (high - low), tail.velocity[rows], force[rows]
    *elastic, viscous = _orthonormal((*np.polynomial.chebyshev.chebvander(depth, _POLYNOMIAL_DEGREE).T, speed))
    residual = force
    for column in elastic:
        residual = residual - column * float((column * residual).sum())
    drag = float((viscous * residual).sum())  # of the force along the velocity, times the velocity's length
    # Its standard error, by the scatter between pieces of the record.
    products = np.array_split(viscous * (residual - viscous * drag), _PIECES)
    error = float(np.sqrt((np.array([float(piece.sum()) for piece in products]) ** 2).sum()))
    # The mean slope p' [N/m] of the force over the depth, by which a drag is a time.
    length = float((viscous * speed).sum())
    slope = -float(((force - force.mean()) * (depth - depth.mean())).sum())
    slope *= 2 / (high - low) / float(((depth - depth.mean()) ** 2).sum())
    if length <= 0 or slope <= 0:
        return None
    lateness = drag / length / slope
    return lateness if lateness > max(_MIN_LATENESS, _MIN_STANDARD_ERRORS * (error / length / slope)) else None


def _common_depths(down: Floats, up: Floats) -> tuple[float, float] | None:
    """Lowest and highest position [m] that samples on the way down (n,) and up (m,) have in common; None of few."""
    if min(len(down), len(up)) < _MIN_SAMPLES / 2:
        return None
    return max(float(down.min()), float(up.min())), min(float(down.max()), float(up.max()))


def _orthonormal(columns: Iterable[Column]) -> list[Column]:
    """Columns (n,) made orthogonal one by one, of length 1: by sums, so that every machine finds the same."""
    basis: list[Column] = []
    for column in columns:
        for earlier in basis:
            column = column - earlier * float((earlier * column).sum())
        length = float(np.sqrt((column**2).sum()))
        basis.append(column / length if length > 0 else column)
    return basis
