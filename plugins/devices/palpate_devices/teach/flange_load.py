"""What hangs at the flange, weighed by the sensor in the arm's own flange in several orientations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_engine import GRAVITY
from palpate_kit.numerics.normal_equations import linear_regression

if TYPE_CHECKING:
    from palpate_arms.arm_by_hand import Posture

_SPREAD = 0.5  # least singular value of the directions of gravity, about their mean
_HELD = 2.0  # [N] root mean square of what a weight does not explain


@dataclass(frozen=True)
class FlangeLoad:
    """Mass and centre of mass on the flange, with standard uncertainties."""

    mass: float  # [kg]
    mass_std: float  # [kg]
    centre: Floats  # (3,) [m]
    centre_std: float  # [m] the largest


def weigh_flange(postures: Sequence[Posture]) -> FlangeLoad:
    """Return the load from wrenches in several orientations, the sensor's offset unknown; the base stands upright.

    f = m g + f0 and t = c x m g + t0 in the flange's frame. Raises ConfigurationError where the orientations are too
    much alike, or where something else than weight was felt.
    """
    down = np.array([posture.flange[:3, :3].T @ [0.0, 0.0, -GRAVITY] for posture in postures])
    wrench = np.array([posture.wrench for posture in postures])
    spread = np.linalg.svd((down - down.mean(axis=0)) / GRAVITY, compute_uv=False)
    if spread[1] < _SPREAD:
        raise ConfigurationError(
            "the orientations are too much alike to weigh what hangs at the flange: tool down, then level, then level "
            "and turned about its own axis by 90 deg"
        )
    (signed, *_), (std, *_), rest = _solved(down[:, :, None], wrench[:, :3])
    if rest > _HELD:
        raise ConfigurationError(
            f"the flange felt {rest:.1f} N that no weight explains, over {_HELD:g} N: nothing may touch tool or arm "
            "while it is read"
        )
    if abs(signed) < max(3 * std, 1e-3):
        raise ConfigurationError(
            f"the flange felt no weight ({1e3 * signed:.0f} g +- {1e3 * std:.0f} g): is ft_raw_wrench sent?"
        )
    lever = np.array([_cross(signed * direction) for direction in down])
    centre, centre_std, _ = _solved(lever, wrench[:, 3:])
    return FlangeLoad(abs(signed), std, centre, float(np.max(centre_std)))


def _cross(force: Floats) -> Floats:
    """Matrix (3, 3) that makes a lever c into the torque c x f."""
    x, y, z = force.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def _solved(matrices: Floats, readings: Floats) -> tuple[Floats, Floats, float]:
    """Unknowns (k,) of readings (n, 3) = matrices (n, 3, k) unknowns + offset, their stds, and the residual's RMS."""
    count, _, unknowns = matrices.shape
    offsets = np.tile(np.eye(3), (count, 1))
    matrix = np.hstack([matrices.reshape(3 * count, unknowns), offsets])
    regression = linear_regression(matrix, readings.ravel())
    return regression.weights[:unknowns], regression.errors()[:unknowns], regression.rms
