"""Axes of tool and sensor in the work frame: one convention for the simulated rig and the twins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.rotations import rotation_matrix

TOOL = np.diag([1.0, -1.0, -1.0])  # of a tool that looks at the skin, in the work frame
PARALLEL_COSINE = 1e-12  # distance from -1 below which two directions are opposite, and any axis turns one to the other
MOUNTING = "rotation vector of the sensor on the tool, whose z looks at the skin; left out: its z looks out of the skin"


def mounting_matrix(mounting: Sequence[float] | None) -> Floats:
    """Return the rotation (3, 3) of a sensor on the tool: by a rotation vector (3,) [rad], or half a turn about x.

    After half a turn its z looks out of the skin.
    """
    return TOOL if mounting is None else rotation_matrix(mounting)


def rotation_matrices(vectors: Floats) -> Floats:
    """Return the rotations (n, 3, 3) of rotation vectors (n, 3) [rad]: 1 + sin(a) K + (1 - cos(a)) K^2 (Rodrigues).

    a is the angle, K the matrix of the cross product with the unit axis.
    """
    angle = np.linalg.norm(vectors, axis=1)
    axis = vectors / np.where(angle > 0, angle, 1.0)[:, None]
    K = np.zeros((len(vectors), 3, 3))
    K[:, 0, 1] = -axis[:, 2]
    K[:, 0, 2] = axis[:, 1]
    K[:, 1, 2] = -axis[:, 0]
    K -= K.transpose(0, 2, 1)
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * K + versine * (K @ K))


def turn_between(source: Floats, target: Floats) -> Floats:
    """Return the shortest rotation (3, 3) that turns one direction (3,) to another: 1 + K + K^2/(1 + cos).

    K is the matrix of the cross product with source x target. Opposite directions are turned about any axis at right
    angles to both.
    """
    source, target = source / np.linalg.norm(source), target / np.linalg.norm(target)
    axis, cosine = np.cross(source, target), float(source @ target)
    if cosine < -1.0 + PARALLEL_COSINE:
        # Half a turn about a: 2 a a^T - 1.
        half_turn_axis = np.cross(source, np.eye(3)[int(np.argmin(np.abs(source)))])
        half_turn_axis /= np.linalg.norm(half_turn_axis)
        return np.asarray(2.0 * np.outer(half_turn_axis, half_turn_axis) - np.eye(3), np.float64)
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + cosine))
