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

    `assumed` (4,) are the standard deviations of force, position and velocity and the jerk's density q by which the
    motion is smoothed, `real` (3,) the true standard deviations. None where the numbers do not hold.

    A relinearised smoother takes the slopes of its force at its own smoothed motion. This motion has an error e, and
    the force a noise n of the assumed variance R. With the force's slopes h_m in the motion (height, velocity,
    acceleration) and psi in the constants, the estimate solves

        sum (psi + psi_m e) (n - h_m e) / R = 0,    psi_m the slopes of psi in the motion.

    The mean of psi_m e (n - h_m e) pulls the estimate. It would be 0 for a tip that has the assumed jerk, where
    E[e n] = E[e e^T] h_m^T; a tip that is moved on purpose has less jerk. At an angular frequency w the smoother takes
    the height's information for A = w^6/q + D, in which D is that of the measurements. With the real noises in place
    of the assumed ones, R' and D', the bias follows from

        sum psi psi^T / R  bias = n int Re(psi_m h_m^*) (R'/R / A - D'/A^2) dw/2pi / R.
    """
    slopes = _force_slopes(model, values, motion)
    pull = len(motion) * _mean_pull(slopes, mass, float(np.median(motion[:, 4])), assumed, real)
    # A force at a measured height has the noise of both.
    force, position = assumed[:2] ** 2
    variance = force + slopes.by_height**2 * position
    information = (slopes.psi / variance[:, None]).T @ slopes.psi
    return pull_on_estimates(information, pull)


def _mean_pull(slopes: _ForceSlopes, mass: float, interval: float, assumed: Floats, real: Floats) -> Floats:
    """Return the pull (k + 1,) of a sample on the constants: the integral over the frequencies."""
    w = np.linspace(0.0, np.pi / interval, _FREQUENCIES)[1:, None]  # [rad/s]
    force, position, velocity = assumed[:3] ** 2
    real_force, real_position, real_velocity = real**2

    # D and D': the information of the measurements, and its true noise.
    power = _motion_power(slopes, mass, w)
    D = (1 / position + w**2 / velocity + power / force) / interval
    D_real = real_position / position**2 + w**2 * real_velocity / velocity**2 + power * real_force / force**2
    D_real = D_real / interval
    A = w**6 / assumed[3] + D

    # The integral over both signs of w is twice that over the positive ones.
    integrand = _cross_power(slopes, mass, w) * (real_force / force / A - D_real / A**2)
    step = float(w[1, 0] - w[0, 0])
    return np.asarray(np.sum(integrand, axis=0) * step / np.pi / force)


def _motion_power(slopes: _ForceSlopes, mass: float, w: Floats) -> Floats:
    """Return |h_m|^2 (m, 1) at the frequencies w (m, 1) [rad/s], where h_m = h_z + i w h_v + w^2 mass.

    The inertia, -mass z'', adds w^2 mass z to the force of the contact.
    """
    height_square, velocity_square = np.mean(slopes.by_height**2), np.mean(slopes.by_velocity**2)
    return np.asarray(height_square + w**2 * (velocity_square + 2 * mass * slopes.by_height.mean()) + w**4 * mass**2)


def _cross_power(slopes: _ForceSlopes, mass: float, w: Floats) -> Floats:
    """Return Re(psi_m h_m^*) (m, k + 1) at the frequencies w (m, 1) [rad/s], where psi_m = psi_z + i w psi_v."""
    by_height = np.mean(slopes.psi_by_height * slopes.by_height[:, None], axis=0)
    by_velocity = np.mean(slopes.psi_by_velocity * slopes.by_velocity[:, None], axis=0)
    return np.asarray(by_height + w**2 * (mass * slopes.psi_by_height.mean(axis=0) + by_velocity))


def _force_slopes(model: ContactModel, values: Floats, motion: Floats) -> _ForceSlopes:
    """Return the force's slopes along a motion; their own slopes are central differences."""
    depth, rate, theta = motion[:, 0], motion[:, 1], values.tolist()
    depth_step = _RELATIVE_STEP * float(depth.mean())
    rate_step = _RELATIVE_STEP * float(np.sqrt(np.mean(rate**2)))

    def slopes(deeper: float, faster: float) -> tuple[Floats, Floats, Floats]:
        """Return psi and the slopes by height and velocity at a motion that is deeper [m] and faster [m/s]."""
        _, by_constants, by_depth, by_rate = force_slopes(model, depth + deeper, rate + faster, theta)
        return np.column_stack([by_constants, by_depth]), -by_depth, -by_rate

    psi, by_height, by_velocity = slopes(0.0, 0.0)
    # Depth falls as the height rises, and the rate as the velocity does.
    psi_by_height = -(slopes(depth_step, 0.0)[0] - slopes(-depth_step, 0.0)[0]) / (2 * depth_step)
    psi_by_velocity = -(slopes(0.0, rate_step)[0] - slopes(0.0, -rate_step)[0]) / (2 * rate_step)
    return _ForceSlopes(psi, by_height, by_velocity, psi_by_height, psi_by_velocity)
