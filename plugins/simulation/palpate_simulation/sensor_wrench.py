"""What a sensor between flange and tip feels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate import Floats

GRAVITY = 9.80665  # [m/s^2]
_FLANGE_OFFSET = (3.0, -2.0, 5.0, 0.1, -0.2, 0.05)  # [N, N m] of the sensor in an arm's flange, never zeroed
_TORQUE_NOISE = 0.02  # N*m for one newton of force noise, of the order of the real sensor's


def sensed_wrench(
    contact: Floats,
    acceleration: Floats,
    tip_mass: float,
    offset: Any,
    noise: Floats,
    noise_std: float,
    limit: float,
    down: Sequence[float] | Floats = (0.0, 0.0, -1.0),
    centre: Sequence[float] = (0.0, 0.0, 0.0),
) -> Floats:
    """Reading (n, 6) [N, N*m] = contact + inertia + weight + offset + noise, compressive positive, within the range.

    Contact force (n, 3) [N] is that on the tip, the weight acts along `down` (3,) or (n, 3), the offset [N] along z,
    acceleration (n, 3) [m/s^2] is that of the tip, `centre` [m] its centre of mass in the axes of the sensor, where
    weight and inertia act, `noise` (n, 6) is standard normal.
    """
    wrench = np.zeros((len(contact), 6))
    wrench[:, :3] = contact - tip_mass * acceleration
    weight = tip_mass * GRAVITY * np.asarray(down, np.float64)
    wrench[:, :2] += weight[..., :2]
    wrench[:, 2] += offset + weight[..., 2]
    x, y, z = map(float, centre)
    pull = weight - tip_mass * acceleration
    wrench[:, 3] = y * pull[:, 2] - z * pull[:, 1]
    wrench[:, 4] = z * pull[:, 0] - x * pull[:, 2]
    wrench[:, 5] = x * pull[:, 1] - y * pull[:, 0]
    scaled = noise * noise_std
    scaled[:, 3:] *= _TORQUE_NOISE
    return np.clip(wrench + scaled, -limit, limit)


def flange_wrench(pose: Floats, mass: float, centre: Sequence[float]) -> list[float]:
    """Reading (6,) [N, N*m] of the sensor in the flange at a pose (4, 4): the weight of a load [kg], and an offset."""
    x, y, z = (-mass * GRAVITY * pose[2, :3]).tolist()
    a, b, c = centre
    load = (x, y, z, b * z - c * y, c * x - a * z, a * y - b * x)
    return [part + offset for part, offset in zip(load, _FLANGE_OFFSET, strict=True)]
