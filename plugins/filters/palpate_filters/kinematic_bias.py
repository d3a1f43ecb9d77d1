"""The bias of a kinematic filter by the noise of its own motion, along a known motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ContactModel, Floats, Layout
from palpate_kit.kernel import Step, compile_step

from palpate_filters.covariance import congruence
from palpate_filters.kinematic_step import jerk_covariance

_START_STD = (1e-4, 1e-2, 1.0)  # [m], [m/s], [m/s^2], a choice: the gains start from it and forget it
_MOTION_STATES = 3  # height, velocity, acceleration
_SAMPLE_ENTRIES = 5  # depth, rate, acceleration, its jump, interval
_ASSUMED_NOISES = 4  # of force, position, velocity and jerk
_NOISES = _ASSUMED_NOISES + 3  # and the real ones of force, position and velocity
_MAX_CONDITION = 1e12  # a choice: beyond it a solution of a scaled system has no four digits left of a double's 16


def kinematic_bias(
    model: ContactModel, mass: float, values: Floats, inputs: Floats, assumed: Floats, real: Floats, transient: float
) -> Floats | None:
    """Return the predicted bias (k,) of the parameters along `inputs` (n, 5) of `kinematic_bias_step`.

    `assumed` (4,) and `real` (3,) are its noises; a share `transient` of the samples is left out at the beginning. None
    where the numbers do not hold.
    """
    step, layout = kinematic_bias_step(model, mass)
    state = np.zeros(step.state.numel())
    state[: _MOTION_STATES * _MOTION_STATES] = np.diag(np.square(_START_STD)).ravel()
    _, outputs = compile_step(step).run(state, inputs, np.concatenate([values, assumed, real]))
    stationary = outputs[int(transient * len(inputs)) :]
    if not np.isfinite(stationary).all():
        return None
    q = len(values) + 1  # the parameters and the surface
    information = stationary[:, layout["information"]].sum(axis=0).reshape(q, q)
    return pull_on_estimates(information, stationary[:, layout["pull"]].sum(axis=0))


def pull_on_estimates(information: Floats, pull: Floats) -> Floats | None:
    """Return the constants' bias (k,): information^-1 pull without its last entry, the surface; None if unknown."""
    scale = np.sqrt(np.diag(information))
    if not (np.isfinite(pull).all() and np.isfinite(scale).all() and (scale > 0).all()):
        return None
    unit = information / np.outer(scale, scale)
    if np.linalg.cond(unit) > _MAX_CONDITION:
        return None
    return np.asarray(np.linalg.solve(unit, pull / scale) / scale)[:-1]


def kinematic_bias_step(model: ContactModel, mass: float) -> tuple[Step, Layout]:
    """Return one sample of the filter's error statistics along a known motion, and the layout of its output.

    As `palpate_filters.noise_bias.bias_step`: a filter settles where sum psi nu / S = 0 over all that it measures, nu
    the innovations, S their variance, psi their slopes in the unknown constants, here the parameters and the surface.
    The filter's motion m = (z, z', z'') has the noise e of the measurements; so have nu = n - h_m e and, through
    h_theta(m + e), psi. With psi~ the part of psi that e makes, to second order in e,

        sum psi psi^T / S  bias = -sum (E[psi~ h_m e] + psi h_m E[e]) / S,

    e' = (1 - K h_m) e + K n and psi~' = (1 - K h_m) psi~ - K (h_theta_m + psi h_mm) e at each measurement, and both are
    carried along by the process. e has no process noise: the tip does not move by chance, whatever the filter assumes.

    Filter state: gain covariance (3 x 3), the joint covariance of e and psi~, psi (3 x q), E[e]. Sample: depth [m],
    rate [m/s], acceleration of the depth and its jump to the next sample [m/s^2], interval to it [s]. Settings:
    parameters (k); standard deviations of force, position, velocity and density of the jerk that the filter assumes;
    the real standard deviations.
    """
    import casadi as ca

    k, n = len(model.parameters), _MOTION_STATES
    q = k + 1
    size = n * (1 + q)
    P, C, psi, mean = ca.SX.sym("P", n, n), ca.SX.sym("C", size, size), ca.SX.sym("psi", n, q), ca.SX.sym("e", n)
    sample, numbers = ca.SX.sym("w", _SAMPLE_ENTRIES), ca.SX.sym("p", k + _NOISES)
    assumed, real = numbers[k : k + _ASSUMED_NOISES], numbers[k + _ASSUMED_NOISES :]

    # Update with position, velocity and force, and add each to both sums of the bias.
    information, pull = ca.SX.zeros(q, q), ca.SX.zeros(q)
    statistics = ErrorStatistics(P, C, psi, mean)
    for measured in _measurements(model, mass, sample, theta=numbers[:k], assumed=assumed, real=real):
        statistics, measured_information, measured_pull = _update(statistics, measured)
        information += measured_information
        pull -= measured_pull
    after = _predict(statistics, interval=sample[4], jump=sample[3], jerk=assumed[3])
    return Step(
        state=ca.vertcat(ca.vec(P), ca.vec(C), ca.vec(psi), mean),
        sample=sample,
        settings=numbers,
        next_state=ca.vertcat(ca.vec(after.P), ca.vec(after.C), ca.vec(after.psi), after.mean),
        output=ca.vertcat(ca.vec(information), pull),
    ), Layout(information=q * q, pull=q)


@dataclass(frozen=True)
class ErrorStatistics:
    """The covariance that gives the gain, and the statistics of the filter's errors."""

    P: Any  # (n, n) as the filter assumes it, of n states
    C: Any  # (n (1 + q), n (1 + q)) covariance of e and psi~ together, by q constants
    psi: Any  # (n, q)
    mean: Any  # (n,) E[e]


def _update(before: ErrorStatistics, measured: _Measurement) -> tuple[ErrorStatistics, Any, Any]:
    """Return the statistics after a measurement, its psi psi^T/S (q, q), and its (E[psi~ h_m e] + psi h_m E[e])/S.

    The statistics are the gain covariance P, the joint covariance C of e and psi~, psi, and the mean E[e].
    """
    import casadi as ca

    n, q, row = _MOTION_STATES, before.psi.shape[1], measured.row
    # Gain, and slopes of the innovation in the constants and of these in the error.
    column = before.P @ row.T
    S = ca.dot(row.T, column) + measured.assumed_std**2
    K = column / S
    slopes = measured.by_constants + row @ before.psi  # (1, q)
    slopes_by_error = measured.mixed + before.psi.T @ measured.curvature  # (q, n): h_theta_m + psi h_mm

    # Both sums of the bias. C has blocks of n rows and columns: e first, then psi~ of each of the q constants.
    products = ca.vertcat(*[row @ before.C[n * (1 + i) : n * (2 + i), :n] for i in range(q)])
    products += slopes_by_error @ before.C[:n, :n]
    information = slopes.T @ slopes / S
    pull = (products @ row.T + slopes.T * (row @ before.mean)) / S

    # e' = (1 - K h_m) e + K n and psi~' = (1 - K h_m) psi~ - K (h_theta_m + psi h_mm) e.
    reduction = ca.SX.eye(n) - K @ row
    joint = ca.kron(ca.SX.eye(1 + q), reduction)
    for i in range(q):
        joint[n * (1 + i) : n * (2 + i), :n] = -K @ slopes_by_error[i, :]
    C = congruence(joint, before.C)
    C[:n, :n] += K @ K.T * measured.real_std**2
    P = congruence(reduction, before.P) + K @ K.T * measured.assumed_std**2
    return ErrorStatistics(P, C, before.psi - K @ slopes, reduction @ before.mean), information, pull


def _predict(before: ErrorStatistics, interval: Any, jump: Any, jerk: Any) -> ErrorStatistics:
    """Return the statistics an interval [s] later, with a jump of the acceleration and the assumed density of jerk.

    White jerk drives the filter's gain alone; a constant acceleration misses its jump.
    """
    import casadi as ca

    T = interval
    A = ca.vertcat(ca.horzcat(1, T, T**2 / 2), ca.horzcat(0, 1, T), ca.horzcat(0, 0, 1))
    driven = jerk * ca.vertcat(*[ca.horzcat(*powers) for powers in jerk_covariance(T)])
    defect = jump * ca.vertcat(T**2 / 6, T / 2, 1)  # height falls as depth grows
    C = congruence(ca.kron(ca.SX.eye(1 + before.psi.shape[1]), A), before.C)
    return ErrorStatistics(congruence(A, before.P) + driven, C, A @ before.psi, A @ before.mean + defect)


@dataclass(frozen=True)
class _Measurement:
    """Slopes of one measurement in the motion m and the q constants, and its noise."""

    row: Any  # h_m (1, n)
    by_constants: Any  # h_theta (1, q)
    mixed: Any  # h_theta_m (q, n)
    curvature: Any  # h_mm (n, n)
    assumed_std: Any
    real_std: Any


def _measurements(
    model: ContactModel, mass: float, sample: Any, theta: Any, assumed: Any, real: Any
) -> tuple[_Measurement, _Measurement, _Measurement]:
    """Return position, velocity and force; the noises `assumed` and `real` are those of force, position, velocity."""
    force_noise, position_noise, velocity_noise = ((assumed[i], real[i]) for i in range(3))
    constants = len(model.parameters) + 1  # with the surface
    return (
        _motion_measurement(0, constants, *position_noise),
        _motion_measurement(1, constants, *velocity_noise),
        _force_measurement(model, mass, sample, theta, *force_noise),
    )


def _motion_measurement(entry: int, constants: int, assumed_std: Any, real_std: Any) -> _Measurement:
    """Return the measurement of an entry of the motion, height or velocity, which has no other slopes."""
    import casadi as ca

    return _Measurement(
        row=ca.SX.eye(_MOTION_STATES)[entry, :],
        by_constants=ca.SX.zeros(1, constants),
        mixed=ca.SX.zeros(constants, _MOTION_STATES),
        curvature=ca.SX.zeros(_MOTION_STATES, _MOTION_STATES),
        assumed_std=assumed_std,
        real_std=real_std,
    )


def _force_measurement(
    model: ContactModel, mass: float, sample: Any, theta: Any, assumed_std: Any, real_std: Any
) -> _Measurement:
    """Return the measurement of the force F(s - z, -z') - m z'', with its slopes along the motion of a sample.

    `theta` (k,) are the model's parameters; the noise [N] is `assumed_std` by the filter, `real_std` in truth.
    """
    import casadi as ca

    # The slopes by the motion m = (z, z', z''), the parameters t and the surface s, as symbols.
    m, t, s = ca.SX.sym("m", _MOTION_STATES), ca.SX.sym("t", len(model.parameters)), ca.SX.sym("s")
    force = model.force(s - m[0], -m[1], ca.vertsplit(t), []) - mass * m[2]
    by_constants = ca.jacobian(force, ca.vertcat(t, s))
    slopes = [ca.jacobian(force, m), by_constants, ca.jacobian(by_constants.T, m), ca.hessian(force, m)[0]]
    # The height is counted from the tip, so that the surface stands at the depth.
    depth, rate, acceleration = sample[0], sample[1], sample[2]
    point = [ca.vertcat(0.0, -rate, -acceleration), theta, depth]
    row, by_constants, mixed, curvature = ca.substitute(slopes, [m, t, s], point)
    return _Measurement(
        row=row,
        by_constants=by_constants,
        mixed=mixed,
        curvature=curvature,
        assumed_std=assumed_std,
        real_std=real_std,
    )
