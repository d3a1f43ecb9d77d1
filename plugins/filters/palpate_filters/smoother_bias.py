"""The bias of a relinearised smoother: the effect of its assumed jerk on its estimates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import ContactModel, Floats
from palpate_engine import force_slopes

from palpate_filters.kinematic_bias import pull_on_estimates

_FREQUENCIES = 2048  # a choice: the integral over them, from 0 to Nyquist's frequency, is a sum
_RELATIVE_STEP = 1e-4  # of mean depth and RMS rate, a choice: central differences of slopes, with an error of 1e-8


@dataclass(frozen=True)
class _ForceSlopes:
    """Slopes of the force along a motion, and their own slopes by height and velocity."""

    psi: Floats  # (n, k + 1) by the constants and the surface
    by_height: Floats  # (n,)
    by_velocity: Floats  # (n,)
    psi_by_height: Floats  # (n, k + 1)
    psi_by_velocity: Floats  # (n, k + 1)


def smoother_bias(
    model: ContactModel, mass: float, values: Floats, motion: Floats, assumed: Floats, real: Floats
) -> Floats | None:
    """Return the predicted bias (k,) of the parameters along a motion (n, 5) as for `palpate_filters.kinematic_bias`.

    `assumed` (4,) are the standard deviations of force, position and velocity and the jerk's density q, `real` (3,)
    the true standard deviations. Linearised at its own smoothed motion, the smoother settles where
    sum psi (n - h_m e) / R = 0 over the forces, e the motion's error by what it is smoothed from, n the force's noise,
    h_m and psi the force's slopes by motion and constants. e is in psi, too. Where the tip has the jerk that is
    assumed, E[e n] and E[e e^T] h_m^T are one; a tip that is moved on purpose has less. In frequencies, with
    A = w^6/q + D the assumed information on the height, D of it by measurements, and D' that of D's true noise,

        information bias = sum int Re(psi_m h_m^*) (R'/R / A - D'/A^2) dw/2pi / R.

    None where the numbers do not hold.
    """
    slopes = _force_slopes(model, values, motion)
    interval = float(np.median(motion[:, 4]))
    w = np.linspace(0.0, np.pi / interval, _FREQUENCIES)[1:, None]  # [rad/s]

    # |h_m|^2 and Re(psi_m h_m^*) over the frequencies: of height, velocity and, by the mass, acceleration.
    height_square, velocity_square = np.mean(slopes.by_height**2), np.mean(slopes.by_velocity**2)
    h_h = height_square + w**2 * (velocity_square + 2 * mass * slopes.by_height.mean()) + w**4 * mass**2
    psi_h = np.mean(slopes.psi_by_height * slopes.by_height[:, None], axis=0) + w**2 * (
        mass * slopes.psi_by_height.mean(axis=0) + np.mean(slopes.psi_by_velocity * slopes.by_velocity[:, None], axis=0)
    )

    # D and D': the information of the measurements, and its true noise.
    (force, position, velocity), jerk = assumed[:3] ** 2, assumed[3]
    real_force, real_position, real_velocity = real**2
    D = (1 / position + w**2 / velocity + h_h / force) / interval
    D_real = real_position / position**2 + w**2 * real_velocity / velocity**2 + h_h * real_force / force**2
    D_real = D_real / interval
    A = w**6 / jerk + D

    step = float(w[1, 0] - w[0, 0])
    pull = np.sum(psi_h * (real_force / force / A - D_real / A**2), axis=0) * step / np.pi / force
    information = (slopes.psi / (force + slopes.by_height**2 * position)[:, None]).T @ slopes.psi
    return pull_on_estimates(information, len(motion) * pull)


def _force_slopes(model: ContactModel, values: Floats, motion: Floats) -> _ForceSlopes:
    """Return the force's slopes along a motion; their own slopes are central differences."""
    depth, rate, theta = motion[:, 0], motion[:, 1], values.tolist()
    depth_step = _RELATIVE_STEP * float(depth.mean())
    rate_step = _RELATIVE_STEP * float(np.sqrt(np.mean(rate**2)))

    def slopes(deeper: float, faster: float) -> tuple[Floats, Floats, Floats]:
        _, by_constants, by_depth, by_rate = force_slopes(model, depth + deeper, rate + faster, theta)
        return np.column_stack([by_constants, by_depth]), -by_depth, -by_rate

    psi, by_height, by_velocity = slopes(0.0, 0.0)
    # Depth falls as the height rises, and the rate as the velocity does.
    psi_by_height = -(slopes(depth_step, 0.0)[0] - slopes(-depth_step, 0.0)[0]) / (2 * depth_step)
    psi_by_velocity = -(slopes(0.0, rate_step)[0] - slopes(0.0, -rate_step)[0]) / (2 * rate_step)
    return _ForceSlopes(psi, by_height, by_velocity, psi_by_height, psi_by_velocity)
