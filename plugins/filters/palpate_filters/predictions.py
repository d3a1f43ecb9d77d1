"""Predictions of a filter on the inertial process: linearised, or by sigma points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from palpate import Floats

from palpate_filters.covariance import cholesky, congruence, mirror
from palpate_filters.inertial_step import PredictedState, Prediction, input_gain
from palpate_filters.process_models import InertialProcess
from palpate_filters.step_limits import DEPTH_FLOOR

Points = Literal["merwe", "julier", "simplex"]
Directions = tuple[Floats, float, float]  # of `sigma_directions`


def linearised(
    process: InertialProcess, mean: Any, covariance: Any, force: Any, interval: Any, has_force: Any
) -> PredictedState:
    """Return the extended Kalman filter's prediction: f(x) and F P F^T with the derived Jacobian F.

    `mean` x and `covariance` P are those before, `force` [N] acts over the `interval` [s] where `has_force` is 1.
    """
    import casadi as ca

    slope = _force_slope(process, mean)
    ahead = _stepper(process)(mean, force, interval, has_force)
    # Internal states depend on depth and rate, so that the whole step is differentiated; else it is linear but for F.
    if process.model.memory:
        symbols = ca.SX.sym("x", process.states)
        jacobian = ca.jacobian(_stepper(process)(symbols, force, interval, has_force), symbols)
        jacobian = ca.substitute(jacobian, symbols, floor_depth(process, mean))
    else:
        jacobian = _transition(process, interval) - (input_gain(process, interval) * has_force) @ slope.T
    return PredictedState(
        mean=ahead,
        covariance=congruence(jacobian, covariance),
        rate_column=None,
        stiffness=slope[process.layout.at("depth")],
        repaired=ca.SX(0),
    )


def unscented(points: Points, alpha: float, beta: float, kappa: float, redraw: bool) -> Prediction:
    """Return the unscented Kalman filter's prediction; with `redraw` the update sees the process noise, as in filterpy.

    `points`, `alpha`, `beta` and `kappa` are the kind and the scaling of the sigma points, see `sigma_directions`.
    """

    def predict(
        process: InertialProcess, mean: Any, covariance: Any, force: Any, interval: Any, has_force: Any
    ) -> PredictedState:
        """Return mean and covariance one interval later, from sigma points."""
        directions = sigma_directions(points, process.states, alpha, beta, kappa)
        root, repaired = cholesky(covariance)
        ahead = _stepper(process)
        if process.model.memory:
            moments = _moments(lambda point: ahead(point, force, interval, has_force), mean, root, directions)
        else:
            moments = _excess_moments(process, mean, covariance, root, directions, sample=(force, interval, has_force))
        # Without new points, the gain uses the covariance of the propagated ones, which has no process noise.
        column = None if redraw else moments[1][:, process.layout.at("rate")]
        stiffness = _force_slope(process, mean)[process.layout.at("depth")]
        return PredictedState(
            mean=moments[0], covariance=moments[1], rate_column=column, stiffness=stiffness, repaired=repaired
        )

    return predict


def _moments(ahead: Callable[[Any], Any], mean: Any, root: Any, directions: Directions) -> tuple[Any, Any]:
    """Return mean (n,) and covariance (n, n) of a function of sigma points.

    Differences to the centre are weighted, and not the points: the huge weights of a small alpha then cost no digits.
    """
    import casadi as ca

    unit_points, weight, correction = directions
    centre = ahead(mean)
    offsets = ca.horzcat(*(ahead(mean + root @ ca.DM(direction)) - centre for direction in unit_points.T))
    shift = ca.sum2(offsets) * weight
    return centre + shift, mirror(offsets @ offsets.T * weight + shift @ shift.T * correction)


def _excess_moments(
    process: InertialProcess, mean: Any, covariance: Any, root: Any, directions: Directions, sample: tuple[Any, ...]
) -> tuple[Any, Any]:
    """Return mean and covariance one interval later for a process without memory, by sigma points of one number.

    This number is the excess of force e, measured less contact force, with b the input gain. `root` is the Cholesky
    root of the covariance, `directions` are those of `sigma_directions`, `sample` is (force, interval, has_force).
    x' = A x + b e(x) is linear but for e, so that the points' covariance of x' is A P A^T + b (A c)^T + (A c) b^T +
    b b^T v with c = cov(x, e) and v = var(e) over the points, and their sum over A x needs no points at all.
    """
    import casadi as ca

    unit_points, weight, correction = directions
    force, interval, has_force = sample
    force_states = process.parameters.stop  # the contact force depends on no later state

    def contact(point: Any) -> Any:
        return process.force(ca.vertsplit(point))

    # e at each point, less e at the centre; a point that moves no state of the force has none.
    centre = contact(mean)
    offsets = []
    for direction in unit_points.T:
        displacement = root @ ca.DM(direction)
        if displacement[:force_states].is_zero():
            offsets.append(ca.SX(0))
        else:
            offsets.append(centre - contact(mean + displacement))

    # Moments of e: mean shift s, v = var(e), A c with c = cov(x, e).
    differences = ca.horzcat(*offsets)
    shift = ca.sum2(differences) * weight
    transition, gain = _transition(process, interval), input_gain(process, interval) * has_force
    cross = transition @ (root @ (ca.DM(unit_points) @ differences.T)) * weight
    variance = ca.sumsqr(differences) * weight + shift**2 * correction

    # Moments of x' = A x + b e.
    excess = ca.if_else(has_force, force, 0.0) - centre + shift
    ahead = ca.vertcat(*process.advance(ca.vertsplit(mean), 0.0, interval)) + gain * excess
    mixed = gain @ cross.T
    return ahead, mirror(congruence(transition, covariance) + mixed + mixed.T + gain @ gain.T * variance)


def sigma_directions(points: Points, states: int, alpha: float, beta: float, kappa: float) -> Directions:
    """Return sigma points in units of the covariance's root (n, m), their weight, and that of the mean's shift.

    With x_i = x + L c_i, D_i = f(x_i) - f(x) and s = w sum D_i, the mean is f(x) + s and the covariance
    w sum D_i D_i^T + b s s^T: van der Merwe's 2n + 1 points (w = 1/(2 alpha^2 (n + kappa)), b = beta - alpha^2),
    Julier's (alpha 1, beta 0), or the simplex of n + 1 points (w = 1/(n + 1), b = -1), in filterpy's order.
    """
    n = states
    # The simplex: each point is as far from the centre as from every other, built one dimension at a time. Column j of
    # row d has 1, -d or 0 for j below, at and above d, over the length sqrt(d + d^2) of the row.
    if points == "simplex":
        directions = np.zeros((n, n + 1))
        for d in range(1, n + 1):
            directions[d - 1, :d] = 1.0 / np.sqrt(d * (d + 1.0))
            directions[d - 1, d] = -d / np.sqrt(d * (d + 1.0))
        directions[0] *= -1.0  # as filterpy has it
        return directions * np.sqrt(n + 1.0), 1.0 / (n + 1), -1.0
    if points == "julier":
        alpha, beta = 1.0, 0.0
    reach = alpha**2 * (n + kappa)
    unit = np.sqrt(reach) * np.eye(n)
    return np.hstack([unit, -unit]), 0.5 / reach, beta - alpha**2


def _stepper(process: InertialProcess) -> Any:
    """Return a function of mean, force, interval and has_force: the state one interval later."""

    def ahead(mean: Any, force: Any, interval: Any, has_force: Any) -> Any:
        import casadi as ca

        state = ca.vertsplit(mean)
        # A missing force counts as the model's own: the tip keeps its rate.
        excess = (ca.if_else(has_force, force, 0.0) - process.force(state)) * has_force
        return ca.vertcat(*process.advance(state, excess, interval))

    return ahead


def _transition(process: InertialProcess, interval: Any) -> Any:
    """Return A, the process without excess force, which is linear."""
    import casadi as ca

    symbols = ca.SX.sym("x", process.states)
    return ca.jacobian(ca.vertcat(*process.advance(ca.vertsplit(symbols), 0.0, interval)), symbols)


def _force_slope(process: InertialProcess, mean: Any) -> Any:
    """Return the slope (n,) of the contact force in a state; 0 out of contact."""
    import casadi as ca

    symbols = ca.SX.sym("x", process.states)
    parts, layout = ca.vertsplit(symbols), process.layout
    # The slope is taken in symbols, without the force's branch at depth 0.
    depth, rate = parts[layout.at("depth")], parts[layout.at("rate")]
    force = process.model.force(depth, rate, parts[layout["parameters"]], parts[layout["memory"]])
    slope = ca.jacobian(force, symbols).T
    # It is evaluated no nearer to the pole of sqrt(d) than the floor.
    depth, floored_mean = mean[layout.at("depth")], ca.SX(mean)
    floored_mean[layout.at("depth")] = ca.fmax(depth, DEPTH_FLOOR)
    return ca.substitute(slope, symbols, floored_mean) * (depth > 0)


def floor_depth(process: InertialProcess, mean: Any) -> Any:
    """Return the state at which to take a Jacobian: its depth no nearer to the pole of sqrt(d) than the floor."""
    import casadi as ca

    depth, floored_mean = process.layout.at("depth"), ca.SX(mean)
    floored_mean[depth] = ca.if_else(mean[depth] > 0, ca.fmax(mean[depth], DEPTH_FLOOR), mean[depth])
    return floored_mean
