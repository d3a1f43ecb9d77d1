"""One step of a filter on the inertial process, as one symbolic expression: predict, fade, update, restart, output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from palpate import Layout
from palpate_kit.kernel import Step

from palpate_filters.covariance import entry_update, mirror
from palpate_filters.process_models import InertialProcess
from palpate_filters.step_limits import (
    MAX_DEPTH,
    MAX_LOW_SAMPLES,
    MISSING_ABOVE,
    SMALLEST_VARIANCE,
    UNKNOWN_FORCE_STD,
)

_MAX_DEVIATION = 1e4  # first standard deviations from 0, a choice: a diverging filter passes it on its way to infinity


@dataclass(frozen=True)
class State:
    """The filter's memory from one sample to the next."""

    mean: Any  # x (n,)
    covariance: Any  # P (n, n)
    force: Any  # u [N] of the sample before; NaN where it is missing
    low_count: Any  # consecutive samples at depth <= 0
    factor: Any  # alpha, the fading factor

    @property
    def has_force(self) -> Any:
        """1 where the force is known."""
        import casadi as ca

        return ca.fabs(self.force) <= MISSING_ABOVE

    def column(self) -> Any:
        """Return all entries in one column, laid out as `state_layout`."""
        import casadi as ca

        return ca.vertcat(self.mean, ca.vec(self.covariance), self.force, self.low_count, self.factor)


@dataclass(frozen=True)
class Sample:
    """One sample."""

    force: Any  # [N]
    rate: Any  # z [m/s], the measured rate of the depth; NaN where it is missing
    interval: Any  # T [s] since the sample before; 0 at the first

    @property
    def has_rate(self) -> Any:
        """1 where a rate was measured."""
        import casadi as ca

        return ca.fabs(self.rate) <= MISSING_ABOVE


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
class PredictedState:
    """A filter's expectation before a measurement; its covariance excludes Q from a `Prediction`, else includes it."""

    mean: Any  # x- (n,)
    covariance: Any  # P- (n, n)
    rate_column: Any  # (n,) cov(x-, d') without process noise; None: it is the covariance's own column
    stiffness: Any  # dF/dd [N/m]
    repaired: Any  # 1 where the covariance before was not positive definite


@dataclass(frozen=True)
class UpdatedState:
    """A filter's estimate after a measurement."""

    mean: Any  # x (n,)
    covariance: Any  # P (n, n)
    innovation: Any  # e/sqrt(S); 0 where no rate was measured


# process, mean, covariance, force, interval, 1 where the force is known -> the state without process noise
Prediction = Callable[[InertialProcess, Any, Any, Any, Any, Any], PredictedState]


def state_layout(process: InertialProcess) -> Layout:
    """Return the layout of a `State`: mean (n), covariance (n x n), force before [N], low depths, fading factor."""
    n = process.states
    return Layout(mean=n, covariance=n * n, force=1, low=1, factor=1)


def inertial_step(process: InertialProcess, prediction: Prediction, *, fading: bool, signed: bool = False) -> Step:
    """Predict from the sample before with its force u, then update with this sample's rate z.

    The state x = [d, d', ...] is that of `InertialProcess`, whose step f has Jacobian F; c is the column of P- that
    belongs to d', without Q where sigma points are not drawn again after the prediction::

        predict   x- = f(x, u, T)             P- = F P F^T + Q             Q = B sigma_u^2 B^T
                  B  = [T^2/(2 m), T/m, 0, ...]
        fade      alpha = min(alpha_max, alpha + up) where |z - d'-| > theta, else max(1, alpha - down)
                  P- = alpha P-, no variance beyond its cap; `signed` compares z - d'- itself with theta
        update    e = z - d'-                 S = c_d' + sigma_vel^2       K = c/S
                  x = x- + K e                P = (I - K H) P- (I - K H)^T + K sigma_vel^2 K^T
        restart   x = x_0 with d' = z, P = diag(s_0^2), alpha = 1 after 25 samples in a row with d <= 0
        output    parameters, depth, their variances, contact force, e^2/S, e/sqrt(S), marks

    The linearised prediction takes F P F^T as it is written, the unscented one the covariance of its sigma points. A
    missing u counts as the model's own force with sigma_u = 1 N, and without z the state is not updated. Filter state:
    `state_layout`. Sample: force, rate, interval. Settings: the numbers of `Tuning` in their order. Output:
    `palpate_filters.recursion.output_layout`.
    """
    import casadi as ca

    # The symbols of state, settings and sample.
    symbols, settings = _state_symbols(process), _tuning_symbols(process)
    before = replace(symbols, covariance=mirror(symbols.covariance))
    sample = ca.SX.sym("w", 3)  # force, rate, interval
    now = Sample(*ca.vertsplit(sample))

    # The five parts of a step, in the order of the equations above.
    predicted, factor = predict(process, prediction, before, now, settings), before.factor
    if fading:
        predicted, factor = fade(process, predicted, factor, sample=now, tuning=settings, signed=signed)
    updated = update(process, predicted, now, settings)
    after, restarts = restart(process, updated, replace(before, factor=factor), now, settings)

    numbers = [settings.force_std, settings.rate_std, settings.fade, settings.cap, settings.start, settings.start_std]
    return Step(
        state=symbols.column(),
        sample=sample,
        settings=ca.vertcat(*numbers),
        next_state=after.column(),
        output=output(
            process,
            before,
            sample=now,
            predicted=predicted,
            updated=updated,
            after=after,
            restarts=restarts,
            tuning=settings,
        ),
    )


def _state_symbols(process: InertialProcess) -> State:
    """Return a filter's state before a sample, as symbols; its covariance has all n x n entries."""
    import casadi as ca

    n = process.states
    mean, covariance = ca.SX.sym("x", n), ca.SX.sym("P", n, n)
    return State(
        mean=mean, covariance=covariance, force=ca.SX.sym("u"), low_count=ca.SX.sym("low"), factor=ca.SX.sym("alpha")
    )


def _tuning_symbols(process: InertialProcess) -> Tuning:
    """Return the numbers of a run as symbols."""
    import casadi as ca

    n = process.states
    force_std, rate_std = ca.vertsplit(ca.SX.sym("r", 2))
    cap, start, start_std = ca.SX.sym("cap", n), ca.SX.sym("x0", n), ca.SX.sym("s0", n)
    return Tuning(
        force_std=force_std, rate_std=rate_std, fade=ca.SX.sym("a", 4), cap=cap, start=start, start_std=start_std
    )


def input_gain(process: InertialProcess, interval: Any) -> Any:
    """Return B (n,), what one newton adds to the state over an interval [s]."""
    import casadi as ca

    return ca.vertcat(*process.gain(interval), ca.SX.zeros(process.states - process.layout.span("depth", "rate").stop))


def process_noise(process: InertialProcess, interval: Any, force_std: Any) -> Any:
    """Return Q = B sigma_u^2 B^T (n, n), the noise of the measured force over an interval [s]."""
    gain = input_gain(process, interval)
    return gain @ gain.T * force_std**2


def predict(
    process: InertialProcess, prediction: Prediction, before: State, sample: Sample, tuning: Tuning
) -> PredictedState:
    """Return x- and P-, Q included; a missing force enters with `UNKNOWN_FORCE_STD`."""
    import casadi as ca

    has_force = before.has_force
    force_std = ca.if_else(has_force, tuning.force_std, UNKNOWN_FORCE_STD)
    noiseless = prediction(process, before.mean, before.covariance, before.force, sample.interval, has_force)
    return replace(noiseless, covariance=noiseless.covariance + process_noise(process, sample.interval, force_std))


def fade(
    process: InertialProcess, predicted: PredictedState, factor: Any, sample: Sample, tuning: Tuning, signed: bool
) -> tuple[PredictedState, Any]:
    """Return alpha P- and this step's alpha: a step up where the innovation is large, a step down otherwise.

    `factor` is the last step's alpha; with `signed` an innovation is large only where it is positive.
    No variance is raised beyond its cap: a congruence with a diagonal, so P- stays positive
    (docs/decisions/0043-fading-is-capped.md).
    """
    import casadi as ca

    # The factor follows the innovation, against the threshold theta.
    rate = process.layout.at("rate")
    innovation = ca.if_else(sample.has_rate, sample.rate - predicted.mean[rate], 0.0)
    theta, max_factor, step_up, step_down = ca.vertsplit(tuning.fade)
    is_large = (innovation if signed else ca.fabs(innovation)) > theta
    factor = ca.if_else(is_large, ca.fmin(max_factor, factor + step_up), ca.fmax(1.0, factor - step_down))

    # Each entry is scaled by the roots of its own two factors, which are smaller where a variance reaches its cap.
    variance = ca.fmax(ca.diag(predicted.covariance), SMALLEST_VARIANCE)
    scale = ca.sqrt(ca.fmin(factor, ca.fmax(tuning.cap / variance, 1.0)))
    covariance = mirror(predicted.covariance * (scale @ scale.T))
    column = predicted.rate_column
    if column is not None:
        column = column * scale * scale[rate]
    return replace(predicted, covariance=covariance, rate_column=column), factor


def update(process: InertialProcess, predicted: PredictedState, sample: Sample, tuning: Tuning) -> UpdatedState:
    """Return x and P after a measured rate, which is the entry d' of the state.

    `predicted.rate_column` is the column c of the gain where it is not that of P-, else None.
    """
    import casadi as ca

    rate, variance = process.layout.at("rate"), tuning.rate_std**2
    mean, column = predicted.mean, predicted.rate_column
    innovation = ca.if_else(sample.has_rate, sample.rate, mean[rate]) - mean[rate]
    if column is None:
        gain, covariance, weight = entry_update(predicted.covariance, rate, variance, sample.has_rate)
    else:  # the gain is not the optimal one of this covariance: Joseph's form
        weight = 1 / (column[rate] + variance)
        gain = column * (sample.has_rate * weight)
        reduction = ca.SX.eye(process.states)  # I - K H
        reduction[:, rate] -= gain
        covariance = mirror(reduction @ predicted.covariance @ reduction.T + gain @ gain.T * variance)
    return UpdatedState(mean + gain * innovation, covariance, innovation * ca.sqrt(weight))


def restart(
    process: InertialProcess, updated: UpdatedState, before: State, sample: Sample, tuning: Tuning
) -> tuple[State, Any]:
    """Return the state for the next sample, and 1 where it is the first state again.

    It is after `MAX_LOW_SAMPLES` samples in a row out of contact. `before` has the count so far, and alpha.
    """
    import casadi as ca

    low_count = ca.if_else(updated.mean[process.layout.at("depth")] <= 0, before.low_count + 1, 0)
    restarts = low_count >= MAX_LOW_SAMPLES
    start = ca.SX(tuning.start)
    start[process.layout.at("rate")] = ca.if_else(sample.has_rate, sample.rate, 0.0)
    after = State(
        mean=ca.if_else(restarts, start, updated.mean),
        covariance=ca.if_else(restarts, ca.diag(tuning.start_std**2), updated.covariance),
        force=sample.force,
        low_count=ca.if_else(restarts, 0, low_count),
        factor=ca.if_else(restarts, 1, before.factor),
    )
    return after, restarts


def output(
    process: InertialProcess,
    before: State,
    sample: Sample,
    predicted: PredictedState,
    updated: UpdatedState,
    after: State,
    restarts: Any,
    tuning: Tuning,
) -> Any:
    """Return the row of `palpate_filters.recursion.output_layout`: parameters first, marks of 0 or 1 last.

    The squared innovation is -1 where no rate was measured.
    """
    import casadi as ca

    depth, values, variance = process.layout.at("depth"), process.parameters, ca.diag(after.covariance)
    # The step is too coarse for the contact once its natural frequency times the interval reaches 1.
    stiff = sample.interval * ca.sqrt(ca.fmax(predicted.stiffness, 0) / process.mass) >= 1
    blind = ca.logic_not(ca.logic_and(before.has_force, sample.has_rate))
    diverged = _has_diverged(after.mean, variance, ca.fabs(tuning.start) + tuning.start_std, depth)
    return ca.vertcat(
        *(after.mean[values], variance[values], after.mean[depth], variance[depth]),
        process.force(ca.vertsplit(after.mean)),
        ca.if_else(sample.has_rate, updated.innovation**2, -1.0),
        updated.innovation,
        *(updated.mean[depth] <= 0, restarts, blind, stiff, diverged, predicted.repaired),
    )


def _has_diverged(mean: Any, variance: Any, scale: Any, depth: int) -> Any:
    """Return 1 if numbers are not finite, or further from 0 than anything that the first guess leaves possible."""
    import casadi as ca

    limit = _MAX_DEVIATION * scale
    # A sum shows NaN, which smallest and largest would pass over; products spare the roots and quotients.
    finite = ca.logic_and(ca.sumsqr(mean) + ca.sum1(variance) <= MISSING_ABOVE, ca.mmin(variance) >= 0)
    near = ca.logic_and(ca.fabs(mean[depth]) <= MAX_DEPTH, ca.mmax(ca.fabs(mean) - limit) <= 0)
    return ca.logic_not(ca.logic_and(ca.logic_and(finite, near), ca.mmax(variance - limit**2) <= 0))
