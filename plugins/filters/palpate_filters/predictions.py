"""How a filter on the inertial process looks ahead: linearised, or by sigma points."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from palpate import InertialProcess

from palpate_filters.inertial_step import Predicted, Prediction

_DEPTH_FLOOR = 1e-5  # [m]; the slope of sqrt(d) has a pole at 0, so Jacobians are taken no nearer

Points = Literal["merwe", "julier", "simplex"]


def linearised(
    process: InertialProcess, mean: Any, covariance: Any, force: Any, interval: Any, known: Any, force_std: Any
) -> Predicted:
    """The extended Kalman filter's prediction: F P F^T + B sigma_u^2 B^T with the derived Jacobian F."""
    import casadi as ca

    state = ca.vertsplit(mean)
    # A missing force is taken to be the model's: the tip goes on at its rate, with the noise that this deserves.
    driven = ca.if_else(known, force, process.force(state))
    predicted = ca.vertcat(*process.predict(state, driven, interval))
    slope = ca.jacobian(process.force(state), mean)
    jacobian = ca.jacobian(predicted, mean)
    jacobian, slope = ca.substitute([jacobian, slope], [mean], [ca.vertcat(away(mean[0]), mean[1:])])
    gain = _gain(process, interval)
    covariance_predicted = jacobian @ covariance @ jacobian.T + gain @ gain.T * force_std**2
    return Predicted(predicted, covariance_predicted, covariance_predicted[:, 1], slope[0], ca.SX(0))


def unscented(points: Points, alpha: float, beta: float, kappa: float, redraw: bool) -> Prediction:
    """The unscented Kalman filter's prediction; with `redraw` the update sees the process noise, as in filterpy."""

    def predict(
        process: InertialProcess, mean: Any, covariance: Any, force: Any, interval: Any, known: Any, force_std: Any
    ) -> Predicted:
        import casadi as ca

        directions, weight, correction = sigma_directions(points, process.states, alpha, beta, kappa)
        root, repaired = cholesky(covariance)
        ahead = _stepper(process)
        centre = ahead(mean, force, interval, known)
        # Weighting differences to the centre, not the points, loses nothing to the huge weights of a small alpha.
        drawn = [mean + root @ ca.DM(direction) for direction in directions.T]
        offsets = ca.horzcat(*(ahead(point, force, interval, known) - centre for point in drawn))
        shift = ca.sum2(offsets) * weight
        # Symmetric to the last bit, and nothing is computed twice.
        sampled = ca.triu2symm(ca.triu(offsets @ offsets.T * weight + shift @ shift.T * correction))
        gain = _gain(process, interval)
        noisy = sampled + gain @ gain.T * force_std**2
        slope = ca.jacobian(process.force(ca.vertsplit(mean)), mean[0])
        slope = ca.substitute(slope, mean, ca.vertcat(away(mean[0]), mean[1:]))
        column = noisy[:, 1] if redraw else sampled[:, 1]
        return Predicted(centre + shift, noisy, column, slope, repaired)

    return predict


def sigma_directions(
    points: Points, states: int, alpha: float, beta: float, kappa: float
) -> tuple[NDArray[np.float64], float, float]:
    """Sigma points in units of the root of the covariance (n, m), their weight, and that of the mean's shift.

    With x_i = x + L c_i, D_i = f(x_i) - f(x) and s = w sum D_i, the mean is f(x) + s and the covariance
    w sum D_i D_i^T + b s s^T: van der Merwe's 2n + 1 points (b = beta - alpha^2), Julier's (alpha 1, beta 0),
    or the simplex of n + 1 points, in filterpy's order.
    """
    n = states
    if points == "simplex":
        rows = np.zeros((n, n + 1))
        for d in range(1, n + 1):
            rows[d - 1, :d] = 1.0 / np.sqrt(d * (d + 1.0))
            rows[d - 1, d] = -d / np.sqrt(d * (d + 1.0))
        rows[0] *= -1.0
        return rows * np.sqrt(n + 1.0), 1.0 / (n + 1), -1.0
    if points == "julier":
        alpha, beta = 1.0, 0.0
    reach = alpha**2 * (n + kappa)
    unit = np.sqrt(reach) * np.eye(n)
    return np.hstack([unit, -unit]), 0.5 / reach, beta - alpha**2


def cholesky(matrix: Any) -> tuple[Any, Any]:
    """Lower root of a symmetric matrix, and whether a pivot was negative; such pivots become 0, not NaN."""
    import casadi as ca

    n = matrix.shape[0]
    root, negative = ca.SX.zeros(n, n), ca.SX(0)
    for j in range(n):
        pivot = matrix[j, j] - ca.sumsqr(root[j, :j]) if j else matrix[j, j]
        negative = ca.logic_or(negative, pivot < 0)
        diagonal = ca.sqrt(ca.fmax(pivot, 0.0))
        inverse = ca.if_else(pivot > 0, 1.0 / ca.if_else(pivot > 0, diagonal, 1.0), 0.0)
        root[j, j] = diagonal
        for i in range(j + 1, n):
            below = matrix[i, j] - ca.dot(root[i, :j], root[j, :j]) if j else matrix[i, j]
            root[i, j] = below * inverse
    return root, negative


def _stepper(process: InertialProcess) -> Any:
    def ahead(mean: Any, force: Any, interval: Any, known: Any) -> Any:
        import casadi as ca

        state = ca.vertsplit(mean)
        driven = ca.if_else(known, force, process.force(state))
        return ca.vertcat(*process.predict(state, driven, interval))

    return ahead


def away(depth: Any) -> Any:
    """The depth at which to take a Jacobian: no nearer to the pole of sqrt(d) than the floor."""
    import casadi as ca

    return ca.if_else(depth > 0, ca.fmax(depth, _DEPTH_FLOOR), depth)


def _gain(process: InertialProcess, interval: Any) -> Any:
    import casadi as ca

    return ca.vertcat(*process.gain(interval), ca.SX.zeros(process.states - 2))
