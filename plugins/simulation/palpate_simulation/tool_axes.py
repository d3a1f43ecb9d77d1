"""How tool and sensor stand in the work frame: one convention for the simulated rig and the twins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.rotations import rotation_matrix

TOOL = np.diag([1.0, -1.0, -1.0])  # of a tool that looks at the skin, in the work frame
MOUNTING = "rotation vector of the sensor on the tool, whose z looks at the skin; left out: its z looks out of the skin"


def mounting_matrix(mounting: Sequence[float] | None) -> Floats:
    """Rotation (3, 3) of a sensor on the tool: as stated, or half a turn about x, so that it looks out of the skin."""
    return TOOL if mounting is None else rotation_matrix(mounting)


def rotation_matrices(vectors: Floats) -> Floats:
    """Rotations (n, 3, 3) of rotation vectors (n, 3) [rad] (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)
    unit = vectors / np.where(angle > 0, angle, 1.0)[:, None]
    cross = np.zeros((len(vectors), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -unit[:, 2], unit[:, 1], -unit[:, 0]
    cross -= cross.transpose(0, 2, 1)
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def turn_between(one: Floats, other: Floats) -> Floats:
    """Return the shortest rotation (3, 3) that turns one direction (3,) to another; about any axis at right angles
    to both."""
    one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
    axis, cosine = np.cross(one, other), float(one @ other)
    if cosine < -1.0 + 1e-12:
        side = np.cross(one, np.eye(3)[int(np.argmin(np.abs(one)))])
        side /= np.linalg.norm(side)
        return np.asarray(2.0 * np.outer(side, side) - np.eye(3), np.float64)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
