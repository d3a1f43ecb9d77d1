"""How a filter on the inertial process looks ahead: linearised, or by sigma points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from palpate import Floats

from palpate_filters.covariance import cholesky, congruence, mirror
from palpate_filters.inertial_step import Predicted, Prediction, input_gain
from palpate_filters.process_models import InertialProcess

_DEPTH_FLOOR = 1e-5  # [m]; the slope of sqrt(d) has a pole at 0, so Jacobians are taken no nearer

Points = Literal["merwe", "julier", "simplex"]
Directions = tuple[Floats, float, float]


def linearised(
    process: InertialProcess, mean: Any, covariance: Any, force: Any, interval: Any, known: Any
) -> Predicted:
    """The extended Kalman filter's prediction: f(x) and F P F^T with the derived Jacobian F."""
    import casadi as ca

    slope = _force_slope(process, mean)
    ahead = _stepper(process)(mean, force, interval, known)
    if process.model.memory:
        symbols = ca.SX.sym("x", process.states)
        jacobian = ca.jacobian(_stepper(process)(symbols, force, interval, known), symbols)
        jacobian = ca.substitute(jacobian, symbols, away(process, mean))
    else:
        jacobian = _transition(process, interval) - (input_gain(process, interval) * known) @ slope.T
    return Predicted(ahead, congruence(jacobian, covariance), None, slope[process.layout.at("depth")], ca.SX(0))


def unscented(points: Points, alpha: float, beta: float, kappa: float, redraw: bool) -> Prediction:
    """The unscented Kalman filter's prediction; with `redraw` the update sees the process noise, as in filterpy."""

    def predict(
        process: InertialProcess, mean: Any, covariance: Any, force: Any, interval: Any, known: Any
    ) -> Predicted:
        directions = sigma_directions(points, process.states, alpha, beta, kappa)
        root, repaired = cholesky(covariance)
        ahead = _stepper(process)
        if process.model.memory:
            moments = _moments(lambda point: ahead(point, force, interval, known), mean, root, directions)
        else:
            moments = _excess_moments(process, mean, covariance, root, directions, (force, interval, known))
        column = None if redraw else moments[1][:, process.layout.at("rate")]
        stiffness = _force_slope(process, mean)[process.layout.at("depth")]
        return Predicted(moments[0], moments[1], column, stiffness, repaired)

    return predict


def _moments(ahead: Callable[[Any], Any], mean: Any, root: Any, directions: Directions) -> tuple[Any, Any]:
    """Mean and covariance of what a function makes of sigma points."""
    import casadi as ca

    drawn, weight, correction = directions
    centre = ahead(mean)
    # Weighting differences to the centre, not the points, loses nothing to the huge weights of a small alpha.
    offsets = ca.horzcat(*(ahead(mean + root @ ca.DM(direction)) - centre for direction in drawn.T))
    shift = ca.sum2(offsets) * weight
    return centre + shift, mirror(offsets @ offsets.T * weight + shift @ shift.T * correction)


def _excess_moments(
    process: InertialProcess, mean: Any, covariance: Any, root: Any, directions: Directions, sample: tuple[Any, ...]
) -> tuple[Any, Any]:
    """The same for the process without memory, where sigma points are only needed for the excess of force e.

    x' = A x + b e(x) is linear but for e, so that the points' covariance of x' is A P A^T + b (A c)^T + (A c) b^T +
    b b^T v with c = cov(x, e) and v = var(e) over the points, and their sum over A x needs no points at all.
    """
    import casadi as ca

    drawn, weight, correction = directions
    force, interval, known = sample
    reached = process.parameters.stop  # the contact force depends on no later state

    def contact(point: Any) -> Any:
        return process.force(ca.vertsplit(point))

    centre = contact(mean)
    offsets = []
    for direction in drawn.T:
        moved = root @ ca.DM(direction)
        offsets.append(ca.SX(0) if moved[:reached].is_zero() else centre - contact(mean + moved))
    differences = ca.horzcat(*offsets)
    shift = ca.sum2(differences) * weight
    transition, gain = _transition(process, interval), input_gain(process, interval) * known
    cross = transition @ (root @ (ca.DM(drawn) @ differences.T)) * weight
    variance = ca.sumsqr(differences) * weight + shift**2 * correction
    excess = ca.if_else(known, force, 0.0) - centre + shift
    ahead = ca.vertcat(*process.advance(ca.vertsplit(mean), 0.0, interval)) + gain * excess
    mixed = gain @ cross.T
    return ahead, mirror(congruence(transition, covariance) + mixed + mixed.T + gain @ gain.T * variance)


def sigma_directions(points: Points, states: int, alpha: float, beta: float, kappa: float) -> Directions:
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


def _stepper(process: InertialProcess) -> Any:
    def ahead(mean: Any, force: Any, interval: Any, known: Any) -> Any:
        import casadi as ca

        state = ca.vertsplit(mean)
        # A missing force is taken to be the model's: the tip goes on at its rate, with the noise that this deserves.
        excess = (ca.if_else(known, force, 0.0) - process.force(state)) * known
        return ca.vertcat(*process.advance(state, excess, interval))

    return ahead


def _transition(process: InertialProcess, interval: Any) -> Any:
    """A: the process without excess force, which is linear."""
    import casadi as ca

    symbols = ca.SX.sym("x", process.states)
    return ca.jacobian(ca.vertcat(*process.advance(ca.vertsplit(symbols), 0.0, interval)), symbols)


def _force_slope(process: InertialProcess, mean: Any) -> Any:
    """Slope (n,) of the contact force in a state; 0 out of contact."""
    import casadi as ca

    symbols = ca.SX.sym("x", process.states)
    parts, place = ca.vertsplit(symbols), process.layout
    depth, rate = parts[place.at("depth")], parts[place.at("rate")]
    force = process.model.force(depth, rate, parts[place["parameters"]], parts[place["memory"]])
    slope = ca.jacobian(force, symbols).T
    here, inside = mean[place.at("depth")], ca.SX(mean)
    inside[place.at("depth")] = ca.fmax(here, _DEPTH_FLOOR)
    return ca.substitute(slope, symbols, inside) * (here > 0)


def away(process: InertialProcess, mean: Any) -> Any:
    """The state at which to take a Jacobian: its depth no nearer to the pole of sqrt(d) than the floor."""
    import casadi as ca

    at, inside = process.layout.at("depth"), ca.SX(mean)
    inside[at] = ca.if_else(mean[at] > 0, ca.fmax(mean[at], _DEPTH_FLOOR), mean[at])
    return inside
