"""The bias of a kinematic filter: what the noise of its own motion does to its estimates, along a known motion."""

from __future__ import annotations

import numpy as np
from palpate import ContactModel, Floats, Layout
from palpate_kit.kernel import Step, compile_step

from palpate_filters.covariance import congruence

_FIRST = (1e-4, 1e-2, 1.0)  # [m], [m/s], [m/s^2], what the gains begin from
_MOTION = 3  # height, velocity, acceleration


def kinematic_bias(
    model: ContactModel, mass: float, values: Floats, inputs: Floats, believed: Floats, real: Floats, warm: float
) -> Floats | None:
    """Predicted bias (k,) of the parameters along `inputs` (n, 5) of `kinematic_bias_step`.

    `believed` (4,) and `real` (3,) are its noises; a share `warm` of the samples is left out at the beginning. None
    where the numbers do not hold.
    """
    step, place = kinematic_bias_step(model, mass)
    state = np.zeros(step.state.numel())
    state[: _MOTION * _MOTION] = np.diag(np.square(_FIRST)).ravel()
    _, outputs = compile_step(step).run(state, inputs, np.concatenate([values, believed, real]))
    late, q = outputs[int(warm * len(inputs)) :], len(values) + 1
    information = late[:, place["information"]].sum(axis=0).reshape(q, q)
    return pull_on_estimates(information, late[:, place["pull"]].sum(axis=0)) if np.isfinite(late).all() else None


def pull_on_estimates(information: Floats, pull: Floats) -> Floats | None:
    """Where constants (k,) and the surface settle, information^-1 pull, but for the surface; None if unknown."""
    scale = np.sqrt(np.diag(information))
    if not (np.isfinite(pull).all() and np.isfinite(scale).all() and (scale > 0).all()):
        return None
    unit = information / np.outer(scale, scale)
    if np.linalg.cond(unit) > 1e12:
        return None
    return np.asarray(np.linalg.solve(unit, pull / scale) / scale)[:-1]


def kinematic_bias_step(model: ContactModel, mass: float) -> tuple[Step, Layout]:
    """One sample of the filter's error statistics along a known motion, and how its output is laid out.

    As `palpate_filters.noise_bias.bias_step`: a filter settles where sum psi nu / S = 0 over all that it measures, nu
    the innovations, S their variance, psi their slopes in the unknown constants, here the parameters and the surface.
    The filter's motion m = (z, z', z'') has the noise e of the measurements; so have nu = n - h_m e and, through
    h_theta(m + e), psi. With psi~ the part of psi that e makes, to second order in e,

        sum psi psi^T / S  bias = -sum (E[psi~ h_m e] + psi h_m E[e]) / S,

    e' = (1 - K h_m) e + K n and psi~' = (1 - K h_m) psi~ - K (h_theta_m + psi h_mm) e at each measurement, and both are
    carried along by the process. e has no process noise: the tip does not move by chance, whatever the filter assumes.

    Filter state: gain covariance (3 x 3), the joint covariance of e and psi~, psi (3 x q), E[e]. Sample: depth [m],
    rate [m/s], acceleration of the depth and its jump to the next sample [m/s^2], interval to it [s]. Settings:
    parameters (k); standard deviations of force, position, velocity and density of the jerk that the filter assumes
    in; the real standard deviations.
    """
    import casadi as ca

    k = len(model.parameters)
    q, n = k + 1, _MOTION
    size = n * (1 + q)
    P, C, psi, mean = ca.SX.sym("P", n, n), ca.SX.sym("C", size, size), ca.SX.sym("psi", n, q), ca.SX.sym("e", n)
    state = ca.vertcat(ca.vec(P), ca.vec(C), ca.vec(psi), mean)
    sample, numbers = ca.SX.sym("w", 5), ca.SX.sym("p", k + 7)
    depth, rate, bend, jump, interval = ca.vertsplit(sample)
    theta, believed, real = numbers[:k], numbers[k : k + 4], numbers[k + 4 :]

    m, t, s = ca.SX.sym("m", n), ca.SX.sym("t", k), ca.SX.sym("s")
    force = model.force(s - m[0], -m[1], ca.vertsplit(t), []) - mass * m[2]
    by_motion, by_constants = ca.jacobian(force, m), ca.jacobian(force, ca.vertcat(t, s))
    found = [by_motion, by_constants, ca.jacobian(by_constants.T, m), ca.hessian(force, m)[0]]
    here = [ca.vertcat(0.0, -rate, -bend), theta, depth]
    h_m, h_c, h_cm, h_mm = ca.substitute(found, [m, t, s], here)
    unit, flat = ca.SX.eye(n), (ca.SX.zeros(1, q), ca.SX.zeros(q, n), ca.SX.zeros(n, n))
    looks = [
        (unit[0, :], *flat, believed[1], real[1]),
        (unit[1, :], *flat, believed[2], real[2]),
        (h_m, h_c, h_cm, h_mm, believed[0], real[0]),
    ]
    information, pull = ca.SX.zeros(q, q), ca.SX.zeros(q)
    for row, constants, mixed, curved, std, noise in looks:
        column = P @ row.T
        S = ca.dot(row.T, column) + std**2
        K = column / S
        slopes = constants + row @ psi  # (1, q)
        noisy = mixed + psi.T @ curved  # (q, n): what e makes of the slopes at once
        parts = ca.vertcat(*[row @ C[n * (1 + i) : n * (2 + i), :n] for i in range(q)]) + noisy @ C[:n, :n]
        information += slopes.T @ slopes / S
        pull -= (parts @ row.T + slopes.T * (row @ mean)) / S
        kept = unit - K @ row
        whole = ca.kron(ca.SX.eye(1 + q), kept)
        for i in range(q):
            whole[n * (1 + i) : n * (2 + i), :n] = -K @ noisy[i, :]
        C = congruence(whole, C)
        C[:n, :n] += K @ K.T * noise**2
        psi, mean, P = psi - K @ slopes, kept @ mean, congruence(kept, P) + K @ K.T * std**2
    T = interval
    A = ca.vertcat(ca.horzcat(1, T, T**2 / 2), ca.horzcat(0, 1, T), ca.horzcat(0, 0, 1))
    every = ca.kron(ca.SX.eye(1 + q), A)
    powers = [[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]]
    driven = believed[3] * ca.vertcat(*[ca.horzcat(*row) for row in powers])
    missed = jump * ca.vertcat(T**2 / 6, T / 2, 1)  # height falls as depth grows
    return Step(
        state=state,
        sample=sample,
        settings=numbers,
        next_state=ca.vertcat(
            ca.vec(congruence(A, P) + driven), ca.vec(congruence(every, C)), ca.vec(A @ psi), A @ mean + missed
        ),
        output=ca.vertcat(ca.vec(information), pull),
    ), Layout(information=q * q, pull=q)
