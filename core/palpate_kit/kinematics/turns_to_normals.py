"""Turns of a tool to the normals of a surface, and how fast they change along it."""

from __future__ import annotations

import numpy as np
from palpate import Floats

_SMALL = 1e-4  # [rad]; below it the series a/sin(a) = 1 + a^2/6 + ... errs by 2e-18
_SERIES = 6.0  # of the square


def rotation_to(normal: Floats) -> Floats:
    """Return rotation vectors (n, 3) [rad] of the shortest turns from z to normals (n, 3): a / sin(a) z x n."""
    scale, _ = _scales(normal[:, 2])
    return np.column_stack([-scale * normal[:, 1], scale * normal[:, 0], np.zeros(len(normal))])


def rotation_rate(normal: Floats, rate: Floats) -> Floats:
    """Return how fast these vectors change (n, 3) [rad/s], of normals that change at a rate (n, 3) [1/s]."""
    scale, slope = _scales(normal[:, 2])
    growth = slope * rate[:, 2]
    x, y = scale * rate[:, 0] + growth * normal[:, 0], scale * rate[:, 1] + growth * normal[:, 1]
    return np.column_stack([-y, x, np.zeros(len(normal))])


def _scales(cosine: Floats) -> tuple[Floats, Floats]:
    """Return a / sin(a) (n,) of angles with this cosine, and its derivative by the cosine."""
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    is_small = angle < _SMALL
    safe_angle = np.where(is_small, 1.0, angle)
    sine = np.sin(safe_angle)
    scale = np.where(is_small, 1.0 + angle**2 / _SERIES, safe_angle / sine)
    # d(a/sin a)/d(cos a) = (a cos a/sin a - 1)/sin^2 a, which is -1/3 at 0.
    return scale, np.where(is_small, -1.0 / 3.0, (safe_angle * np.cos(safe_angle) / sine - 1.0) / sine**2)
