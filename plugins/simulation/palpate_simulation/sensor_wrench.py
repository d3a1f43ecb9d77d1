"""The wrench that a sensor between flange and tip feels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate import Floats

GRAVITY = 9.80665  # [m/s^2], standard gravity
# Offset [N, N m] of the sensor in an arm's flange, which nobody zeroes (a choice: each axis has another one).
_FLANGE_OFFSET = (3.0, -2.0, 5.0, 0.1, -0.2, 0.05)
_TORQUE_NOISE = 0.02  # [N m] for one newton of force noise, of the order of the real sensor's


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
    """Return the reading (n, 6) [N, N*m] = contact + inertia + weight + offset + noise, within +-`limit`.

    All vectors are in the axes of the sensor; a force that presses on the tip is positive. `contact` (n, 3) [N] acts on
    the tip, `acceleration` (n, 3) [m/s^2] is that of the tip, `tip_mass` [kg] acts at its centre of mass `centre` (3,)
    [m], the weight along the direction `down` (3,) or (n, 3), `offset` (n,) [N] is along z alone. `noise` (n, 6) is
    standard normal, `noise_std` [N] that of a force.
    """
    wrench = np.zeros((len(contact), 6))
    # Force: contact - m a + m g, and the offset along z.
    wrench[:, :3] = contact - tip_mass * acceleration
    weight = tip_mass * GRAVITY * np.asarray(down, np.float64)
    wrench[:, :2] += weight[..., :2]
    wrench[:, 2] += offset + weight[..., 2]
    # Torque: the lever of the centre of mass times weight and inertia.
    x, y, z = map(float, centre)
    pull = weight - tip_mass * acceleration
    wrench[:, 3] = y * pull[:, 2] - z * pull[:, 1]
    wrench[:, 4] = z * pull[:, 0] - x * pull[:, 2]
    wrench[:, 5] = x * pull[:, 1] - y * pull[:, 0]
    error = noise * noise_std
    error[:, 3:] *= _TORQUE_NOISE
    return np.clip(wrench + error, -limit, limit)


def flange_wrench(pose: Floats, mass: float, centre: Sequence[float]) -> list[float]:
    """Return the reading (6,) [N, N*m] of the sensor in an arm's flange: the weight of a load, and a constant offset.

    `pose` (4, 4) is the flange in the base, whose z is up; `mass` [kg] hangs at `centre` (3,) [m] from the flange.
    """
    # Weight in the axes of the flange, and its torque centre x force.
    force_x, force_y, force_z = (-mass * GRAVITY * pose[2, :3]).tolist()
    x, y, z = centre
    torque_x = y * force_z - z * force_y
    torque_y = z * force_x - x * force_z
    torque_z = x * force_y - y * force_x
    load = (force_x, force_y, force_z, torque_x, torque_y, torque_z)
    return [component + offset for component, offset in zip(load, _FLANGE_OFFSET, strict=True)]
