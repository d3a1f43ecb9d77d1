"""A test without any contact model that a force is late: a passive contact gives out no work."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from palpate import Floats, Tail
from palpate_engine import acceleration

# Choices: a smooth elastic force, and few enough pieces that residuals of neighbouring ones are independent.
_POLYNOMIAL_DEGREE = 5  # of the elastic force over the depth
_PIECES = 12  # of the record, whose scatter is the standard error
_MIN_SAMPLES = 200  # that go both ways over the same depths
# Choices: the lateness that is reported, of a force ahead of its motion, which no passive material makes.
_MIN_STANDARD_ERRORS = 5.0  # [standard errors] of a lateness that is not by chance
_MIN_LATENESS = 3e-4  # [s] of a force ahead of its motion, below which it is not reported

Column = np.ndarray[tuple[int], np.dtype[np.float64]]


def force_lateness(tail: Tail, tip_mass: float) -> float | None:
    """Return the least lateness [s] of the force, where the contact gives out more work than chance explains.

    In F = p(z) - c v, with p any elastic law, v the velocity (down is negative) and m the mass of the tip subtracted,
    a material that dissipates has c > 0. A force late by t adds -t dF/dz v: the regression gives c + t p', which is
    negative where t is longer than the material's own eta/G. The answer is the excess; None without one.
    """
    contact = _contact_there_and_back(tail, tip_mass)
    if contact is None:
        return None
    # The force as a polynomial of the depth and a share of the velocity, by orthonormal columns.
    polynomial = np.polynomial.chebyshev.chebvander(contact.depth, _POLYNOMIAL_DEGREE).T
    *elastic, viscous = _orthonormal((*polynomial, contact.velocity))
    residual = contact.force
    for column in elastic:
        residual = residual - column * float((column * residual).sum())
    drag = float((viscous * residual).sum())  # of the force along the velocity, times the velocity's length
    # Its standard error, by the scatter between pieces of the record.
    products = np.array_split(viscous * (residual - viscous * drag), _PIECES)
    error = float(np.sqrt((np.array([float(piece.sum()) for piece in products]) ** 2).sum()))
    # A drag over the length of the velocity and the mean slope p' [N/m] of the force is a time.
    length = float((viscous * contact.velocity).sum())
    slope = contact.slope()
    if length <= 0 or slope <= 0:
        return None
    lateness = drag / length / slope
    return lateness if lateness > max(_MIN_LATENESS, _MIN_STANDARD_ERRORS * (error / length / slope)) else None


@dataclass(frozen=True)
class _BothWays:
    """Samples of the depths that a tip passed both ways."""

    depth: Column  # position over half the range of depths, from -1 to 1
    velocity: Column  # [m/s]
    force: Column  # [N] without the tip's inertia
    half_range: float  # [m]

    def slope(self) -> float:
        """Return the mean slope [N/m] of the force over the depth, by linear regression."""
        depth = self.depth - self.depth.mean()
        slope = -float(((self.force - self.force.mean()) * depth).sum())
        return slope * (1 / self.half_range / float((depth**2).sum()))


def _contact_there_and_back(tail: Tail, tip_mass: float) -> _BothWays | None:
    """Return the samples of a tail at depths that it passed both ways; None of too few."""
    force = tail.force + tip_mass * acceleration(tail.time, tail.velocity)
    rows = np.isfinite(force) & np.isfinite(tail.velocity) & np.isfinite(tail.position)
    depths = _common_depths(tail.position[rows & (tail.velocity < 0)], tail.position[rows & (tail.velocity > 0)])
    if depths is None:
        return None
    low, high = depths
    rows &= (tail.position >= low) & (tail.position <= high)
    if np.count_nonzero(rows) < _MIN_SAMPLES or high <= low:
        return None
    depth = (2 * tail.position[rows] - low - high) / (high - low)
    return _BothWays(depth, tail.velocity[rows], force[rows], (high - low) / 2)


def _common_depths(down: Floats, up: Floats) -> tuple[float, float] | None:
    """Return the lowest and highest position [m] that samples down (n,) and up (m,) have in common; None of few."""
    if min(len(down), len(up)) < _MIN_SAMPLES / 2:
        return None
    return max(float(down.min()), float(up.min())), min(float(down.max()), float(up.max()))


def _orthonormal(columns: Iterable[Column]) -> list[Column]:
    """Return columns (n,) made orthogonal one by one, of length 1: by sums, so that every machine finds the same."""
    basis: list[Column] = []
    for column in columns:
        for earlier in basis:
            column = column - earlier * float((earlier * column).sum())
        length = float(np.sqrt((column**2).sum()))
        basis.append(column / length if length > 0 else column)
    return basis
