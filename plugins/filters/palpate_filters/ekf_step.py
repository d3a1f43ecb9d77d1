"""One step of an extended Kalman filter, as one symbolic expression."""

from __future__ import annotations

from typing import Any

from palpate import InertialProcess, Step

_DEPTH_FLOOR = 1e-5  # [m]; the slope of sqrt(d) has a pole at 0, so Jacobians are taken no nearer
_LOW_LIMIT = 25  # samples in a row at depth <= 0, in contact, before the filter begins anew
_BLIND_STD = 1.0  # [N], how little is known of a force that is missing
_LARGEST = 1e300  # CasADi folds z == z to 1, so this is how NaN is told


def ekf_step(process: InertialProcess, states: int) -> Step:
    """Predict from the sample before with its force, then update with this sample's velocity.

    Filter state: mean (n), covariance (n x n, columns), force before [N], count of low depths. Sample: force [N],
    rate [m/s], interval [s] since the sample before (0 at the first). Settings: sigma_u, sigma_vel, start mean (n),
    start standard deviation (n). Output: mean (n), variances (n), contact force, NIS, and 0/1 for low depth,
    restart, blind, stiff, not finite.
    """
    import casadi as ca

    mean, covariance = ca.SX.sym("x", states), ca.SX.sym("P", states, states)
    force_before, low_count = ca.SX.sym("u"), ca.SX.sym("low")
    sample, settings = ca.SX.sym("w", 3), ca.SX.sym("p", 2 + 2 * states)
    force, rate, interval = sample[0], sample[1], sample[2]
    start, start_std = settings[2 : 2 + states], settings[2 + states :]

    known = ca.fabs(force_before) <= _LARGEST
    predicted, jacobian, stiffness = _prediction(process, mean, force_before, interval, known)
    gain = ca.vertcat(*process.gain(interval), ca.SX.zeros(states - 2))
    noise = ca.if_else(known, settings[0], _BLIND_STD)
    covariance_predicted = jacobian @ covariance @ jacobian.T + gain @ gain.T * noise**2

    seen = ca.fabs(rate) <= _LARGEST
    updated, covariance_updated, nis = _rate_update(predicted, covariance_predicted, rate, settings[1] ** 2, seen)

    low = updated[0] <= 0
    count = ca.if_else(low, low_count + 1, 0)
    restart = count >= _LOW_LIMIT
    begin = ca.vertcat(start[0], ca.if_else(seen, rate, 0.0), start[2:])
    next_mean = ca.if_else(restart, begin, updated)
    next_covariance = ca.if_else(restart, ca.diag(start_std**2), covariance_updated)

    stiff = interval * ca.sqrt(ca.fmax(stiffness, 0) / process.mass) >= 1
    variance = ca.diag(next_covariance)
    broken = ca.logic_not(ca.logic_and(ca.sumsqr(next_mean) <= _LARGEST, ca.mmin(variance) >= 0))
    contact = process.force(ca.vertsplit(next_mean))
    marks = [low, restart, ca.logic_not(ca.logic_and(known, seen)), stiff, broken]
    return Step(
        state=ca.vertcat(mean, ca.vec(covariance), force_before, low_count),
        sample=sample,
        settings=settings,
        next_state=ca.vertcat(next_mean, ca.vec(next_covariance), force, ca.if_else(restart, 0, count)),
        output=ca.vertcat(next_mean, variance, contact, nis, *marks),
    )


def _prediction(process: InertialProcess, mean: Any, force: Any, interval: Any, known: Any) -> tuple[Any, Any, Any]:
    """Predicted mean, its Jacobian, and the contact stiffness dF/dd [N/m]."""
    import casadi as ca

    state = ca.vertsplit(mean)
    # A missing force is taken to be the model's: the tip goes on at its rate, with the noise that this deserves.
    driven = ca.if_else(known, force, process.force(state))
    predicted = ca.vertcat(*process.predict(state, driven, interval))
    slope = ca.jacobian(process.force(state), mean)
    away = ca.if_else(mean[0] > 0, ca.fmax(mean[0], _DEPTH_FLOOR), mean[0])
    jacobian, slope = ca.substitute([ca.jacobian(predicted, mean), slope], [mean], [ca.vertcat(away, mean[1:])])
    return predicted, jacobian, slope[0]


def _rate_update(mean: Any, covariance: Any, rate: Any, variance: Any, seen: Any) -> tuple[Any, Any, Any]:
    """Mean and covariance after a measured rate (Joseph form), and the normalised innovation squared."""
    import casadi as ca

    innovation = ca.if_else(seen, rate - mean[1], 0.0)
    spread = covariance[1, 1] + variance
    gain = ca.if_else(seen, covariance[:, 1] / spread, 0.0)
    kept = ca.SX.eye(mean.shape[0])
    kept[:, 1] -= gain
    updated = kept @ covariance @ kept.T + gain @ gain.T * variance
    return mean + gain * innovation, (updated + updated.T) / 2, ca.if_else(seen, innovation**2 / spread, -1.0)
