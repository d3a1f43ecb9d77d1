"""Rotation vectors, matrices and poses of six numbers: position [m] and rotation vector [rad]."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from palpate import Floats, rotation_rows

_HALF_TURN_SINE = 1e-6  # below which the antisymmetric part is rounding; the other branch errs by its square
_ROUNDING = 1e-12  # of a length, or of an angle [rad], below which a direction is not determined


def rotation_matrix(vector: Sequence[float]) -> Floats:
    """Return the rotation (3, 3) of a rotation vector [rad] (Rodrigues)."""
    return np.array(rotation_rows(vector))


def rotation_vector(matrix: Floats) -> Floats:
    """Return the rotation vector (3,) [rad] of a rotation (3, 3), up to and including half turns.

    Of R = [[a, b, c], [d, e, f], [g, h, i]] the antisymmetric part is sin(angle) times the axis, and the trace 1 + 2
    cos(angle).
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    sine, cosine = 0.5 * math.hypot(h - f, c - g, d - b), 0.5 * (a + e + i - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > _HALF_TURN_SINE:
        scale = angle / (2.0 * sine)
        return np.array(((h - f) * scale, (c - g) * scale, (d - b) * scale))
    axis = np.array((h - f, c - g, d - b))
    if cosine > 0:  # a small angle: its sine is the angle
        return 0.5 * axis
    # Near a half turn the antisymmetric part vanishes: take the largest column of R + 1.
    columns = matrix + np.eye(3)
    column = columns[:, int(np.argmax(np.diag(columns)))]
    direction = column / np.linalg.norm(column)
    return np.asarray(direction * (angle if float(direction @ axis) >= 0 else -angle))


def shortest_turn(axis: Floats) -> Floats:
    """Return the rotation vector (3,) [rad] of the shortest turn from z to a direction (3,) of length 1."""
    x, y, z = axis.tolist()
    sine = math.hypot(x, y)
    angle = math.atan2(sine, z)
    scale = angle / sine if sine > _ROUNDING else 1.0
    return np.array((-scale * y, scale * x, 0.0))


def matrix_of(pose: Sequence[float]) -> Floats:
    """Return the pose (4, 4) of six numbers: position [m] and rotation vector [rad]."""
    rows = [(*row, place) for row, place in zip(rotation_rows(pose[3:]), pose[:3], strict=True)]
    return np.array([*rows, (0.0, 0.0, 0.0, 1.0)])


def pose_of(matrix: Floats) -> list[float]:
    """Return the six numbers of a pose (4, 4)."""
    return [*matrix[:3, 3].tolist(), *rotation_vector(matrix[:3, :3]).tolist()]


def quaternion(matrix: Floats) -> Floats:
    """Return the quaternion (x, y, z, w) of a rotation (3, 3), w not negative."""
    vector = rotation_vector(matrix)
    angle = float(np.linalg.norm(vector))
    half = 0.5 * math.sin(0.5 * angle) / (0.5 * angle) if angle > _ROUNDING else 0.5
    return np.array([*(vector * half), math.cos(0.5 * angle)])
