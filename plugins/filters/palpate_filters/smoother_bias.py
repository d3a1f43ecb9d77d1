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
    """Slopes of the force F along a motion of N samples, and their own slopes by height z and velocity v.

    q = k + 1 constants: the k parameters and the surface.
    """

    psi: Floats  # (N, q) slopes of F by the constants
    by_height: Floats  # (N,) dF/dz
    by_velocity: Floats  # (N,) dF/dv
    psi_by_height: Floats  # (N, q) d psi/dz
    psi_by_velocity: Floats  # (N, q) d psi/dv


@dataclass(frozen=True)
class _NoiseVariances:
    """Variances of the noise of the three measurements."""

    force: float  # [N^2]
    position: float  # [m^2]
    velocity: float  # [m^2/s^2]

    @classmethod
    def of(cls, stds: Floats) -> _NoiseVariances:
        """Return the variances of standard deviations (3,) of force, position and velocity."""
        force_variance, position_variance, velocity_variance = stds**2
        return cls(force=force_variance, position=position_variance, velocity=velocity_variance)


def smoother_bias(
    model: ContactModel, mass: float, theta: Floats, motion: Floats, assumed: Floats, real: Floats
) -> Floats | None:
    """Return the predicted bias (k,) of a smoother's parameters theta (k,) along a motion of N samples.

    `motion` (N, 5): depth [m], its rate [m/s] and acceleration [m/s^2], the jump of the latter to the next sample, and
    the interval T to that sample [s]. `assumed` (4,): the standard deviations of force [N], position [m] and velocity
    [m/s], and the density q of the jerk, by which the motion is smoothed. `real` (3,): the true standard deviations.
    `mass` [kg] of the tip. None where the constants are not determined, or a number is not finite.

    A relinearised smoother takes the slopes of its force at its own smoothed motion. This motion has an error e, and
    the force a noise n of the assumed variance R. With the force's slopes h_m in the motion (height, velocity,
    acceleration) and psi in the constants, the estimate solves

        sum (psi + psi_m e) (n - h_m e) / R = 0,    psi_m the slopes of psi in the motion.

    The mean of psi_m e (n - h_m e) pulls the estimate. It would be 0 for a tip that has the assumed jerk, where
    E[e n] = E[e e^T] h_m^T; a tip that is moved on purpose has less jerk. At an angular frequency w the smoother takes
    the height's information for A = w^6/q + D, in which D is that of the measurements. With the real noises in place
    of the assumed ones, R' and D', the bias follows from

        sum psi psi^T / R  bias = N int Re(psi_m h_m^*) (R'/R / A - D'/A^2) dw/2pi / R.
    """
    depth, rate, _, _, intervals = motion.T
    slopes = _force_slopes(model, theta, depth, rate)
    assumed_noise = _NoiseVariances.of(assumed[:3])
    pull_of_sample = _mean_pull(
        slopes,
        mass,
        interval=float(np.median(intervals)),
        assumed=assumed_noise,
        jerk_density=float(assumed[3]),
        real=_NoiseVariances.of(real),
    )
    # The residual of the force at a measured height has the noise of both.
    residual_variance = assumed_noise.force + slopes.by_height**2 * assumed_noise.position
    information = (slopes.psi / residual_variance[:, None]).T @ slopes.psi
    return pull_on_estimates(information, len(motion) * pull_of_sample)


def _mean_pull(
    slopes: _ForceSlopes,
    mass: float,
    interval: float,
    assumed: _NoiseVariances,
    jerk_density: float,
    real: _NoiseVariances,
) -> Floats:
    """Return the mean pull (q,) of one sample on the constants: the right side of `smoother_bias`, over N.

    Per frequency, with the variances R_z of the position, R_v of the velocity and R of the force at an interval T:

        D  = (1/R_z + w^2/R_v + |h_m|^2/R) / T                    information of the measurements on the height
        D' = (R_z'/R_z^2 + w^2 R_v'/R_v^2 + |h_m|^2 R'/R^2) / T   and its variance under the real noise
    """
    w = np.linspace(0.0, np.pi / interval, _FREQUENCIES)[1:, None]  # [rad/s] up to Nyquist's frequency
    power = _motion_power(slopes, mass, w)  # |h_m|^2
    D = (1 / assumed.position + w**2 / assumed.velocity + power / assumed.force) / interval
    D_real = real.position / assumed.position**2 + w**2 * real.velocity / assumed.velocity**2
    D_real = (D_real + power * real.force / assumed.force**2) / interval
    A = w**6 / jerk_density + D

    # The integral over both signs of w is twice that over the positive ones: dw/2pi becomes dw/pi.
    # The cross power is Re(psi_m h_m^*).
    integrand = _cross_power(slopes, mass, w) * (real.force / assumed.force / A - D_real / A**2)
    frequency_step = float(w[1, 0] - w[0, 0])
    return np.asarray(np.sum(integrand, axis=0) * frequency_step / np.pi / assumed.force)


def _motion_power(slopes: _ForceSlopes, mass: float, w: Floats) -> Floats:
    """Return |h_m|^2 (m, 1), the mean over the motion, at the frequencies w (m, 1) [rad/s].

    h_m = h_z + i w h_v + w^2 mass: the inertia, -mass z'', adds w^2 mass z to the force of the contact.
    """
    height_square, velocity_square = np.mean(slopes.by_height**2), np.mean(slopes.by_velocity**2)
    return np.asarray(height_square + w**2 * (velocity_square + 2 * mass * slopes.by_height.mean()) + w**4 * mass**2)


def _cross_power(slopes: _ForceSlopes, mass: float, w: Floats) -> Floats:
    """Return Re(psi_m h_m^*) (m, q), the mean over the motion, at the frequencies w (m, 1) [rad/s].

    psi_m = psi_z + i w psi_v, and h_m as in `_motion_power`.
    """
    by_height = np.mean(slopes.psi_by_height * slopes.by_height[:, None], axis=0)
    by_velocity = np.mean(slopes.psi_by_velocity * slopes.by_velocity[:, None], axis=0)
    return np.asarray(by_height + w**2 * (mass * slopes.psi_by_height.mean(axis=0) + by_velocity))


def _force_slopes(model: ContactModel, theta: Floats, depth: Floats, rate: Floats) -> _ForceSlopes:
    """Return the force's slopes at depths (N,) [m] and rates (N,) [m/s]; their own slopes are central differences."""
    depth_step = _RELATIVE_STEP * float(depth.mean())
    rate_step = _RELATIVE_STEP * float(np.sqrt(np.mean(rate**2)))

    def slopes(deeper: float, faster: float) -> tuple[Floats, Floats, Floats]:
        """Return psi and the slopes by height and velocity at a motion that is deeper [m] and faster [m/s]."""
        _, by_constants, by_depth, by_rate = force_slopes(model, depth + deeper, rate + faster, theta.tolist())
        return np.column_stack([by_constants, by_depth]), -by_depth, -by_rate

    psi, by_height, by_velocity = slopes(0.0, 0.0)
    # Depth falls as the height rises, and the rate as the velocity does.
    psi_by_height = -(slopes(depth_step, 0.0)[0] - slopes(-depth_step, 0.0)[0]) / (2 * depth_step)
    psi_by_velocity = -(slopes(0.0, rate_step)[0] - slopes(0.0, -rate_step)[0]) / (2 * rate_step)
    return _ForceSlopes(psi, by_height, by_velocity, psi_by_height, psi_by_velocity)
