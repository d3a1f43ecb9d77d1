"""The load at the flange, weighed by the sensor in the arm's flange in several orientations."""

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

# Choices.
_MIN_SPREAD = 0.5  # second singular value of the directions of gravity, about their mean
_MAX_UNEXPLAINED = 2.0  # [N] root mean square of what a weight does not explain
_WEIGHT_SIGMAS, _MIN_MASS = 3, 1e-3  # standard deviations, and [kg], from which on a weight was felt
_GRAMS = 1e3  # per kilogram


@dataclass(frozen=True)
class FlangeLoad:
    """Mass and centre of mass on the flange, with standard uncertainties."""

    mass: float  # [kg]
    mass_std: float  # [kg]
    centre: Floats  # (3,) [m]
    centre_std: float  # [m] the largest


def weigh_flange(postures: Sequence[Posture]) -> FlangeLoad:
    """Return the load at the flange by wrenches in several orientations, by least squares for mass and centre of mass.

    The sensor's offset is unknown, and the base stands upright. A wrench has three forces [N], then three torques
    [N m]: f = s m g + f0 and t = c x s m g + t0 in the flange's frame, f0 and t0 the offsets, s = 1 or -1 by the
    sensor's convention. Raises ConfigurationError where the orientations are too much alike, or where something else
    than weight was felt.
    """
    # Gravity in the flange's frame, whose directions have to span a plane about their mean: else offset is weight.
    gravity = np.array([posture.flange[:3, :3].T @ [0.0, 0.0, -GRAVITY] for posture in postures])
    wrench = np.array([posture.wrench for posture in postures])
    spread = np.linalg.svd((gravity - gravity.mean(axis=0)) / GRAVITY, compute_uv=False)
    if spread[1] < _MIN_SPREAD:
        raise ConfigurationError(
            "the orientations are too much alike to weigh what hangs at the flange: tool down, then level, then level "
            "and turned about its own axis by 90 deg"
        )
    # Mass from the forces, whose sign is the sensor's.
    (signed_mass, *_), (std, *_), unexplained = _solve_with_offset(gravity[:, :, None], wrench[:, :3])
    if unexplained > _MAX_UNEXPLAINED:
        raise ConfigurationError(
            f"the flange felt {unexplained:.1f} N that no weight explains, over {_MAX_UNEXPLAINED:g} N: nothing may "
            "touch tool or arm while it is read"
        )
    if abs(signed_mass) < max(_WEIGHT_SIGMAS * std, _MIN_MASS):
        raise ConfigurationError(
            f"the flange felt no weight ({_GRAMS * signed_mass:.0f} g +- {_GRAMS * std:.0f} g): is ft_raw_wrench sent?"
        )
    # Centre of mass from the torques.
    torque_by_centre = np.array([_torque_matrix(signed_mass * g) for g in gravity])
    centre, centre_std, _ = _solve_with_offset(torque_by_centre, wrench[:, 3:])
    return FlangeLoad(abs(signed_mass), std, centre, float(np.max(centre_std)))


def _torque_matrix(force: Floats) -> Floats:
    """Return the matrix (3, 3) whose product with a lever c is the torque c x f."""
    x, y, z = force.tolist()
    return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])


def _solve_with_offset(matrices: Floats, readings: Floats) -> tuple[Floats, Floats, float]:
    """Return the unknowns x (k,) of readings (n, 3) = matrices (n, 3, k) x + offset, their stds, and the RMS left."""
    count, _, unknowns = matrices.shape
    offsets = np.tile(np.eye(3), (count, 1))
    matrix = np.hstack([matrices.reshape(3 * count, unknowns), offsets])
    regression = linear_regression(matrix, readings.ravel())
    return regression.weights[:unknowns], regression.errors()[:unknowns], regression.rms
