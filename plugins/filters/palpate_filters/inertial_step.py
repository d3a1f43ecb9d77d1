"""One step of a filter on the inertial process, as one symbolic expression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from palpate import Layout

from palpate_filters.kernel import Step
from palpate_filters.process import InertialProcess
from palpate_filters.symmetric import entry_update, mirrored

_LOW_LIMIT = 25  # samples in a row at depth <= 0, in contact, before the filter restarts
_BLIND_STD = 1.0  # [N], how little is known of a force that is missing
_LARGEST = 1e300  # CasADi folds z == z to 1, so NaN is detected thus
_DEEPEST = 0.1  # [m], depth
_IMPLAUSIBLE = 1e4  # first standard deviations away from 0: what a diverging filter runs through on its way


@dataclass(frozen=True)
class Predicted:
    """What a filter expects before it sees a measurement."""

    mean: Any  # (n,)
    covariance: Any  # (n, n)
    spread: Any  # (n,) column that belongs to the rate without process noise; None: it is the covariance's
    stiffness: Any  # dF/dd [N/m]
    repaired: Any  # 1 where the covariance before was not positive definite


def carried(process: InertialProcess) -> Layout:
    """The filter's state: mean (n), covariance (n x n), force before [N], count of low depths, fading factor."""
    n = process.states
    return Layout(mean=n, covariance=n * n, force=1, low=1, factor=1)


# process, mean, covariance, force, interval, whether the force is known, its standard deviation
Prediction = Callable[[InertialProcess, Any, Any, Any, Any, Any, Any], Predicted]


def inertial_step(process: InertialProcess, prediction: Prediction, *, fading: bool, signed: bool = False) -> Step:
    """Predict from the sample before with its force, then update with this sample's velocity.

    Filter state: `carried`. Sample: force [N], rate [m/s], interval [s] since the sample before (0 at the first).
    Settings: sigma_u, sigma_vel, then of fading theta [m/s], alpha_max, step up, step down, cap (n) of the variances,
    then start mean (n) and start standard deviation (n). Output: `palpate_filters.recursion.output_layout`.
    """
    import casadi as ca

    states, depth, speed = process.states, process.layout.at("depth"), process.layout.at("rate")
    mean, square = ca.SX.sym("x", states), ca.SX.sym("P", states, states)
    covariance = mirrored(square)
    force_before, low_count, factor = ca.SX.sym("u"), ca.SX.sym("low"), ca.SX.sym("alpha")
    sample, noise = ca.SX.sym("w", 3), ca.SX.sym("sigma", 2)
    force, rate, interval = ca.vertsplit(sample)
    force_noise, rate_noise = ca.vertsplit(noise)
    fade, cap = ca.SX.sym("fade", 4), ca.SX.sym("cap", states)
    start, start_std = ca.SX.sym("x0", states), ca.SX.sym("s0", states)

    known = ca.fabs(force_before) <= _LARGEST
    seen = ca.fabs(rate) <= _LARGEST
    force_std = ca.if_else(known, force_noise, _BLIND_STD)
    predicted = prediction(process, mean, covariance, force_before, interval, known, force_std)
    next_factor = factor
    if fading:
        surprise = ca.if_else(seen, rate - predicted.mean[speed], 0.0)
        next_factor = faded(factor, surprise if signed else ca.fabs(surprise), fade)
        predicted = inflated(predicted, next_factor, cap, speed)
    updated, covariance_updated, innovation = rate_update(predicted, speed, rate, rate_noise**2, seen)
    nis = ca.if_else(seen, innovation**2, -1.0)

    low = updated[depth] <= 0
    count = ca.if_else(low, low_count + 1, 0)
    restart = count >= _LOW_LIMIT
    begin = ca.SX(start)
    begin[speed] = ca.if_else(seen, rate, 0.0)
    next_mean = ca.if_else(restart, begin, updated)
    next_covariance = ca.if_else(restart, ca.diag(start_std**2), covariance_updated)

    stiff = interval * ca.sqrt(ca.fmax(predicted.stiffness, 0) / process.mass) >= 1
    variance = ca.diag(next_covariance)
    contact = process.force(ca.vertsplit(next_mean))
    marks = [low, restart, ca.logic_not(ca.logic_and(known, seen)), stiff]
    marks += [broken(next_mean, variance, ca.fabs(start) + start_std, depth), predicted.repaired]
    values = process.parameters
    return Step(
        state=ca.vertcat(mean, ca.vec(square), force_before, low_count, factor),
        sample=sample,
        settings=ca.vertcat(noise, fade, cap, start, start_std),
        next_state=ca.vertcat(
            next_mean,
            ca.vec(next_covariance),
            force,
            ca.if_else(restart, 0, count),
            ca.if_else(restart, 1, next_factor),
        ),
        output=ca.vertcat(
            next_mean[values], variance[values], next_mean[depth], variance[depth], contact, nis, innovation, *marks
        ),
    )


def broken(mean: Any, variance: Any, scale: Any, depth: int) -> Any:
    """1 where the numbers are not finite, or further from 0 than anything that the first guess leaves possible."""
    import casadi as ca

    limit = _IMPLAUSIBLE * scale
    # A sum shows NaN, which smallest and largest would pass over; products spare the roots and quotients.
    finite = ca.logic_and(ca.sumsqr(mean) + ca.sum1(variance) <= _LARGEST, ca.mmin(variance) >= 0)
    near = ca.logic_and(ca.fabs(mean[depth]) <= _DEEPEST, ca.mmax(ca.fabs(mean) - limit) <= 0)
    return ca.logic_not(ca.logic_and(ca.logic_and(finite, near), ca.mmax(variance - limit**2) <= 0))


def faded(factor: Any, surprise: Any, settings: Any) -> Any:
    """The fading factor alpha after an innovation [m/s]: a step up beyond theta, a step down otherwise."""
    import casadi as ca

    theta, largest, up, down = ca.vertsplit(settings)
    return ca.if_else(surprise > theta, ca.fmin(largest, factor + up), ca.fmax(1.0, factor - down))


def inflated(predicted: Predicted, factor: Any, cap: Any, speed: int) -> Predicted:
    """P <- alpha P, but no variance beyond its cap: a congruence with a diagonal, so P stays positive."""
    import casadi as ca

    variance = ca.fmax(ca.diag(predicted.covariance), 1e-300)
    scale = ca.sqrt(ca.fmin(factor, ca.fmax(cap / variance, 1.0)))
    covariance = mirrored(predicted.covariance * (scale @ scale.T))
    spread = None if predicted.spread is None else predicted.spread * scale * scale[speed]
    return replace(predicted, covariance=covariance, spread=spread)


def rate_update(predicted: Predicted, speed: int, rate: Any, variance: Any, seen: Any) -> tuple[Any, Any, Any]:
    """Mean and covariance after a measured rate, which is entry `speed` of the state, and the normalised innovation.

    The innovation is 0 where no rate was measured.
    """
    import casadi as ca

    mean, column = predicted.mean, predicted.spread
    innovation = ca.if_else(seen, rate, mean[speed]) - mean[speed]
    if column is None:
        gain, updated, weight = entry_update(predicted.covariance, speed, variance, seen)
    else:  # the gain is not the one that the covariance asks for: Joseph's form
        weight = 1 / (column[speed] + variance)
        gain = column * (seen * weight)
        kept = ca.SX.eye(mean.shape[0])
        kept[:, speed] -= gain
        updated = mirrored(kept @ predicted.covariance @ kept.T + gain @ gain.T * variance)
    return mean + gain * innovation, updated, innovation * ca.sqrt(weight)
