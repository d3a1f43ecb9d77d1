"""Rotation vectors: their matrices, rotated axes, and the angular velocity of a body whose vector changes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.vectors import Floats

_SMALL = 1e-4  # [rad], a choice: below it the series in the angle, whose error is then below rounding
_NO_TURN = 1e-12  # [rad], a choice: a smaller rotation does not count

Row = tuple[float, float, float]


def rotation_rows(vector: Sequence[float]) -> tuple[Row, Row, Row]:
    """Return the rows of a rotation vector's matrix: cos(a) 1 + sin(a) [u]x + (1 - cos(a)) u u^T (Rodrigues)."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < _NO_TURN:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    x, y, z = x / angle, y / angle, z / angle
    c, s = math.cos(angle), math.sin(angle)
    k = 1.0 - c
    return (
        (c + k * (x * x), s * -z + k * (x * y), s * y + k * (x * z)),
        (s * z + k * (y * x), c + k * (y * y), s * -x + k * (y * z)),
        (s * -y + k * (z * x), s * x + k * (z * y), c + k * (z * z)),
    )


def turned_axes(rotation: Floats) -> Floats:
    """Return the z axis after rotations (n, 3) [rad]: (n, 3), the third columns of their matrices (Rodrigues)."""
    x, y, z = rotation.T
    sine, versine, _ = _coefficients(rotation)
    return np.column_stack([sine * y + versine * x * z, versine * y * z - sine * x, 1.0 - versine * (x * x + y * y)])


def angular_velocities(rotation: Floats, rate: Floats) -> Floats:
    """Return the angular velocity (n, 3) [rad/s] of bodies whose rotation vectors (n, 3) change at a rate (n, 3).

    w = r' + (1 - cos a)/a^2 r x r' + (a - sin a)/a^3 r x (r x r'), a the length of r (Bullo and Murray 1995).
    """
    _, versine, third = _coefficients(rotation)
    product = np.cross(rotation, rate)
    return np.asarray(rate + versine[:, None] * product + third[:, None] * np.cross(rotation, product))


def _coefficients(rotation: Floats) -> tuple[Floats, Floats, Floats]:
    """Return sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3 (n,) of the angles a.

    Of small ones their series, 1 - a^2/6, 1/2 - a^2/24 and 1/6 - a^2/120: the next terms are below rounding.
    """
    square = (rotation * rotation).sum(axis=1)
    small = square < _SMALL**2
    a = np.where(small, 1.0, np.sqrt(square))
    return (
        np.where(small, 1.0 - square / 6.0, np.sin(a) / a),
        np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(a)) / a**2),
        np.where(small, 1.0 / 6.0 - square / 120.0, (a - np.sin(a)) / a**3),
    )
