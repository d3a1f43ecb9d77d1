"""The bias of a relinearised smoother: the effect of its assumed jerk on its estimates."""

from __future__ import annotations

import numpy as np
from palpate import ContactModel, Floats
from palpate_engine import force_slopes

from palpate_filters.kinematic_bias import pull_on_estimates

_FREQUENCIES = 2048
_STEP = 1e-4  # of depth and rate, for the slopes' own slopes


def smoother_bias(
    model: ContactModel, mass: float, values: Floats, motion: Floats, believed: Floats, real: Floats
) -> Floats | None:
    """Predicted bias (k,) of the parameters along a motion (n, 5) as for `palpate_filters.kinematic_bias`.

    `believed` (4,) are the standard deviations of force, position and velocity and the jerk's density q, `real` (3,)
    the true standard deviations. Linearised at its own smoothed motion, the smoother settles where
    sum psi (n - h_m e) / R = 0 over the forces, e the motion's error by what it is smoothed from, n the force's noise,
    h_m and psi the force's slopes by motion and constants. e is in psi, too. Where the tip has the jerk that is
    believed in, E[e n] and E[e e^T] h_m^T are one; a tip that is moved on purpose has less. In frequencies, with
    A = w^6/q + D what is believed of the height, D of it by measurements, and D' = D's noise as it really is,

        information bias = sum int Re(psi_m h_m^*) (R'/R / A - D'/A^2) dw/2pi / R.

    None where the numbers do not hold.
    """
    depth, rate, interval = motion[:, 0], motion[:, 1], float(np.median(motion[:, 4]))
    theta, steps = values.tolist(), (_STEP * float(depth.mean()), _STEP * float(np.sqrt(np.mean(rate**2))))

    def slopes(deeper: float, faster: float) -> tuple[Floats, Floats, Floats]:
        _, by_constants, by_depth, by_rate = force_slopes(model, depth + deeper, rate + faster, theta)
        return np.column_stack([by_constants, by_depth]), -by_depth, -by_rate

    psi, by_height, by_velocity = slopes(0.0, 0.0)
    psi_z = -(slopes(steps[0], 0.0)[0] - slopes(-steps[0], 0.0)[0]) / (2 * steps[0])
    psi_v = -(slopes(0.0, steps[1])[0] - slopes(0.0, -steps[1])[0]) / (2 * steps[1])
    w = np.linspace(0.0, np.pi / interval, _FREQUENCIES)[1:, None]
    h_h = np.mean(by_height**2) + w**2 * (np.mean(by_velocity**2) + 2 * mass * by_height.mean()) + w**4 * mass**2
    across = np.mean(psi_z * by_height[:, None], axis=0) + w**2 * (
        mass * psi_z.mean(axis=0) + np.mean(psi_v * by_velocity[:, None], axis=0)
    )
    (force, position, velocity), jerk = believed[:3] ** 2, believed[3]
    force_, position_, velocity_ = real**2
    measured = (1 / position + w**2 / velocity + h_h / force) / interval
    told_ = (position_ / position**2 + w**2 * velocity_ / velocity**2 + h_h * force_ / force**2) / interval
    whole = w**6 / jerk + measured
    pull = (
        np.sum(across * (force_ / force / whole - told_ / whole**2), axis=0) * float(w[1, 0] - w[0, 0]) / np.pi / force
    )
    information = (psi / (force + by_height**2 * position)[:, None]).T @ psi
    return pull_on_estimates(information, len(depth) * pull)
