"""One step of a filter on the inertial process, as one symbolic expression: predict, fade, update, restart, output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from palpate import Layout
from palpate_kit.kernel import Step

from palpate_filters.covariance import entry_update, mirror
from palpate_filters.process_models import InertialProcess

_LOW_LIMIT = 25  # samples in a row at depth <= 0, in contact, before the filter restarts
_BLIND_STD = 1.0  # [N], how little is known of a force that is missing
_LARGEST = 1e300  # CasADi folds z == z to 1, so NaN is detected thus
_DEEPEST = 0.1  # [m], depth
_IMPLAUSIBLE = 1e4  # first standard deviations away from 0: what a diverging filter runs through on its way


@dataclass(frozen=True)
class State:
    """What is carried from one sample to the next."""

    mean: Any  # x (n,)
    covariance: Any  # P (n, n)
    force: Any  # u [N] of the sample before; NaN where it is missing
    low: Any  # samples in a row at depth <= 0
    factor: Any  # alpha, the fading factor

    @property
    def known(self) -> Any:
        """1 where the force is known."""
        import casadi as ca

        return ca.fabs(self.force) <= _LARGEST


@dataclass(frozen=True)
class Sample:
    """One sample."""

    force: Any  # [N]
    rate: Any  # z [m/s], the measured rate of the depth; NaN where it is missing
    interval: Any  # T [s] since the sample before; 0 at the first

    @property
    def seen(self) -> Any:
        """1 where a rate was measured."""
        import casadi as ca

        return ca.fabs(self.rate) <= _LARGEST


@dataclass(frozen=True)
class Tuning:
    """Numbers that may differ from run to run."""

    force_std: Any  # sigma_u [N]
    rate_std: Any  # sigma_vel [m/s]
    fade: Any  # theta [m/s], alpha_max, step up, step down
    cap: Any  # (n,) of the variances
    start: Any  # x_0 (n,)
    start_std: Any  # s_0 (n,)


@dataclass(frozen=True)
class Predicted:
    """What a filter expects before it sees a measurement; the covariance is that of `Prediction` or has Q already."""

    mean: Any  # x- (n,)
    covariance: Any  # P- (n, n)
    spread: Any  # (n,) column that belongs to the rate without process noise; None: it is the covariance's
    stiffness: Any  # dF/dd [N/m]
    repaired: Any  # 1 where the covariance before was not positive definite


@dataclass(frozen=True)
class Updated:
    """What a filter knows after it has seen a measurement."""

    mean: Any  # x (n,)
    covariance: Any  # P (n, n)
    innovation: Any  # e/sqrt(S); 0 where no rate was measured


# process, mean, covariance, force, interval, whether the force is known -> without process noise
Prediction = Callable[[InertialProcess, Any, Any, Any, Any, Any], Predicted]


def carried(process: InertialProcess) -> Layout:
    """The filter's state: mean (n), covariance (n x n), force before [N], count of low depths, fading factor."""
    n = process.states
    return Layout(mean=n, covariance=n * n, force=1, low=1, factor=1)


def inertial_step(process: InertialProcess, prediction: Prediction, *, fading: bool, signed: bool = False) -> Step:
    """Predict from the sample before with its force u, then update with this sample's rate z.

    The state x = [d, d', ...] is that of `InertialProcess`, whose step f has Jacobian F; c is the column of P- that
    belongs to d', without Q where sigma points are not drawn again after the prediction::

        predict   x- = f(x, u, T)             P- = F P F^T + Q             Q = B sigma_u^2 B^T
                  B  = [T^2/(2 m), T/m, 0, ...]
        fade      alpha = min(alpha_max, alpha + up) where |z - d'-| > theta, else max(1, alpha - down)
                  P- = alpha P-, no variance beyond its cap
        update    e = z - d'-                 S = c_d' + sigma_vel^2       K = c/S
                  x = x- + K e                P = (I - K H) P- (I - K H)^T + K sigma_vel^2 K^T
        restart   x = x_0 with d' = z, P = diag(s_0^2), alpha = 1 after 25 samples in a row with d <= 0
        output    parameters, depth, their variances, contact force, e^2/S, e/sqrt(S), marks

    The linearised prediction takes F P F^T as it is written, the unscented one the covariance of its sigma points. A
    missing u counts as the model's own force with sigma_u = 1 N, and without z the state is not updated. Filter state:
    `carried`. Sample: force, rate, interval. Settings: the numbers of `Tuning` in their order. Output:
    `palpate_filters.recursion.output_layout`.
    """
    import casadi as ca

    n = process.states
    square, sample = ca.SX.sym("P", n, n), ca.SX.sym("w", 3)
    noise, fade_numbers = ca.SX.sym("r", 2), ca.SX.sym("a", 4)
    mean, force, low, factor = ca.SX.sym("x", n), ca.SX.sym("u"), ca.SX.sym("low"), ca.SX.sym("alpha")
    cap, start, start_std = ca.SX.sym("cap", n), ca.SX.sym("x0", n), ca.SX.sym("s0", n)
    before = State(mean, mirror(square), force, low, factor)
    now = Sample(*ca.vertsplit(sample))
    force_std, rate_std = ca.vertsplit(noise)
    tuning = Tuning(force_std, rate_std, fade_numbers, cap, start, start_std)

    predicted = predict(process, prediction, before, now, tuning)
    if fading:
        predicted, factor = fade(process, predicted, factor, now, tuning, signed)
    updated = update(process, predicted, now, tuning)
    after, restarts = restart(process, updated, replace(before, factor=factor), now, tuning)
    return Step(
        state=ca.vertcat(mean, ca.vec(square), force, low, before.factor),
        sample=sample,
        settings=ca.vertcat(noise, fade_numbers, cap, start, start_std),
        next_state=ca.vertcat(after.mean, ca.vec(after.covariance), after.force, after.low, after.factor),
        output=output(process, before, now, predicted, updated, after, restarts, tuning),
    )


def input_gain(process: InertialProcess, interval: Any) -> Any:
    """B (n,): what one newton adds to the state over an interval [s]."""
    import casadi as ca

    return ca.vertcat(*process.gain(interval), ca.SX.zeros(process.states - process.layout.span("depth", "rate").stop))


def process_noise(process: InertialProcess, interval: Any, force_std: Any) -> Any:
    """Q = B sigma_u^2 B^T (n, n): the noise of the measured force over an interval [s]."""
    gain = input_gain(process, interval)
    return gain @ gain.T * force_std**2


def predict(
    process: InertialProcess, prediction: Prediction, before: State, sample: Sample, tuning: Tuning
) -> Predicted:
    """x- and P-, Q included; a missing force leaves little known of it."""
    import casadi as ca

    known = before.known
    force_std = ca.if_else(known, tuning.force_std, _BLIND_STD)
    free = prediction(process, before.mean, before.covariance, before.force, sample.interval, known)
    return replace(free, covariance=free.covariance + process_noise(process, sample.interval, force_std))


def fade(
    process: InertialProcess, predicted: Predicted, factor: Any, sample: Sample, tuning: Tuning, signed: bool
) -> tuple[Predicted, Any]:
    """P- <- alpha P- and the alpha of this step: a step up where the innovation is large, a step down otherwise.

    No variance is raised beyond its cap: a congruence with a diagonal, so P- stays positive.
    """
    import casadi as ca

    speed = process.layout.at("rate")
    surprise = ca.if_else(sample.seen, sample.rate - predicted.mean[speed], 0.0)
    theta, largest, up, down = ca.vertsplit(tuning.fade)
    is_large = (surprise if signed else ca.fabs(surprise)) > theta
    factor = ca.if_else(is_large, ca.fmin(largest, factor + up), ca.fmax(1.0, factor - down))
    variance = ca.fmax(ca.diag(predicted.covariance), 1e-300)
    scale = ca.sqrt(ca.fmin(factor, ca.fmax(tuning.cap / variance, 1.0)))
    covariance = mirror(predicted.covariance * (scale @ scale.T))
    spread = None if predicted.spread is None else predicted.spread * scale * scale[speed]
    return replace(predicted, covariance=covariance, spread=spread), factor


def update(process: InertialProcess, predicted: Predicted, sample: Sample, tuning: Tuning) -> Updated:
    """x and P after a measured rate, which is the entry d' of the state."""
    import casadi as ca

    speed, seen, variance = process.layout.at("rate"), sample.seen, tuning.rate_std**2
    mean, column = predicted.mean, predicted.spread
    innovation = ca.if_else(seen, sample.rate, mean[speed]) - mean[speed]
    if column is None:
        gain, covariance, weight = entry_update(predicted.covariance, speed, variance, seen)
    else:  # the gain is not the one that the covariance asks for: Joseph's form
        weight = 1 / (column[speed] + variance)
        gain = column * (seen * weight)
        left = ca.SX.eye(process.states)
        left[:, speed] -= gain
        covariance = mirror(left @ predicted.covariance @ left.T + gain @ gain.T * variance)
    return Updated(mean + gain * innovation, covariance, innovation * ca.sqrt(weight))


def restart(
    process: InertialProcess, updated: Updated, before: State, sample: Sample, tuning: Tuning
) -> tuple[State, Any]:
    """The state to carry on, and whether it is a fresh start since the depth has been low for long."""
    import casadi as ca

    count = ca.if_else(updated.mean[process.layout.at("depth")] <= 0, before.low + 1, 0)
    restarts = count >= _LOW_LIMIT
    start = ca.SX(tuning.start)
    start[process.layout.at("rate")] = ca.if_else(sample.seen, sample.rate, 0.0)
    mean = ca.if_else(restarts, start, updated.mean)
    covariance = ca.if_else(restarts, ca.diag(tuning.start_std**2), updated.covariance)
    low, factor = ca.if_else(restarts, 0, count), ca.if_else(restarts, 1, before.factor)
    return State(mean, covariance, sample.force, low, factor), restarts


def output(
    process: InertialProcess,
    before: State,
    sample: Sample,
    predicted: Predicted,
    updated: Updated,
    after: State,
    restarts: Any,
    tuning: Tuning,
) -> Any:
    """The row of `palpate_filters.recursion.output_layout`."""
    import casadi as ca

    depth, values, variance = process.layout.at("depth"), process.parameters, ca.diag(after.covariance)
    stiff = sample.interval * ca.sqrt(ca.fmax(predicted.stiffness, 0) / process.mass) >= 1
    blind = ca.logic_not(ca.logic_and(before.known, sample.seen))
    broken = _is_broken(after.mean, variance, ca.fabs(tuning.start) + tuning.start_std, depth)
    return ca.vertcat(
        *(after.mean[values], variance[values], after.mean[depth], variance[depth]),
        process.force(ca.vertsplit(after.mean)),
        ca.if_else(sample.seen, updated.innovation**2, -1.0),
        updated.innovation,
        *(updated.mean[depth] <= 0, restarts, blind, stiff, broken, predicted.repaired),
    )


def _is_broken(mean: Any, variance: Any, scale: Any, depth: int) -> Any:
    """1 where the numbers are not finite, or further from 0 than anything that the first guess leaves possible."""
    import casadi as ca

    limit = _IMPLAUSIBLE * scale
    # A sum shows NaN, which smallest and largest would pass over; products spare the roots and quotients.
    finite = ca.logic_and(ca.sumsqr(mean) + ca.sum1(variance) <= _LARGEST, ca.mmin(variance) >= 0)
    near = ca.logic_and(ca.fabs(mean[depth]) <= _DEEPEST, ca.mmax(ca.fabs(mean) - limit) <= 0)
    return ca.logic_not(ca.logic_and(ca.logic_and(finite, near), ca.mmax(variance - limit**2) <= 0))
