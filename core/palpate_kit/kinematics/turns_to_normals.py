"""Turns of a tool to the normals of a surface, and how fast they change along it."""

from __future__ import annotations

import numpy as np
from palpate import Floats

_SMALL = 1e-4  # [rad]


def rotation_to(normal: Floats) -> Floats:
    """Rotation vectors (n, 3) [rad] of the shortest turns from z to normals (n, 3): a / sin(a) z x n."""
    scale, _ = _scales(normal[:, 2])
    return np.column_stack([-scale * normal[:, 1], scale * normal[:, 0], np.zeros(len(normal))])


def rotation_rate(normal: Floats, rate: Floats) -> Floats:
    """Return how fast these vectors change (n, 3) [rad/s], of normals that change at a rate (n, 3) [1/s]."""
    scale, slope = _scales(normal[:, 2])
    growth = slope * rate[:, 2]
    x, y = scale * rate[:, 0] + growth * normal[:, 0], scale * rate[:, 1] + growth * normal[:, 1]
    return np.column_stack([-y, x, np.zeros(len(normal))])


def _scales(cosine: Floats) -> tuple[Floats, Floats]:
    """a / sin(a) (n,) of angles with this cosine, and its derivative by the cosine."""
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    small = angle < _SMALL
    a = np.where(small, 1.0, angle)
    sine = np.sin(a)
    scale = np.where(small, 1.0 + angle**2 / 6.0, a / sine)
    return scale, np.where(small, -1.0 / 3.0, (a * np.cos(a) / sine - 1.0) / sine**2)
