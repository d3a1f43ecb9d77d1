"""One step of the kinematic filter as a symbolic expression."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from palpate import Layout
from palpate_kit.kernel import Step

from palpate_filters.covariance import congruence, entry_update, mirror, vector_update
from palpate_filters.process_models import KinematicProcess
from palpate_filters.step_limits import DEPTH_FLOOR, MAX_DEPTH, MAX_LOW_SAMPLES, MISSING_ABOVE, SMALLEST_VARIANCE

_BIAS_REACH = 5.0  # standard deviations of a bias that the linearisation may lag behind; measured, with others: 0044
_MAX_LOGARITHM = 60.0  # a choice: exp(60) is 1e26, in SI more than any material has

NOISE_COUNT = 10  # of `KinematicNoise`, in its order
_MEASUREMENTS = 3  # position, velocity, force
_READINGS = 4  # of a sample: those, and the interval


@dataclass(frozen=True)
class KinematicNoise:
    """Standard deviations of the measurements, then spectral densities of what drives the process."""

    force: Any  # [N]
    position: Any  # [m]
    velocity: Any  # [m/s]
    jerk: Any  # [m^2/s^5]
    surface: Any  # [m^2/s]
    slope: Any  # [m^2/s^3]
    walk: Any  # [1/s] of the logarithm of the first parameter
    trend: Any  # [1/s^3]
    ratio: Any  # [1/s] of the other parameters
    bias: Any  # [N^2/s]


@dataclass(frozen=True)
class _SampleSymbols:
    """The symbols of one sample."""

    column: Any  # all of them
    force: Any  # [N]
    height: Any  # [m]
    velocity: Any  # [m/s]
    interval: Any  # [s]
    linearisation: Any  # (n,) state at which to linearise the force; NaN for none


@dataclass(frozen=True)
class _Moments:
    """An estimate within a step, and the normalised innovations of the measurements that it has seen."""

    mean: Any  # (n,)
    covariance: Any  # (n, n)
    squares: Any  # sum of e^2/S
    count: Any  # of them


def state_layout(process: KinematicProcess) -> Layout:
    """Return the filter's state: mean (n), covariance (n x n), count of low depths, bias [N] at which to linearise."""
    n = process.states
    return Layout(mean=n, covariance=n * n, low=1, centre=int(process.biased))


def kinematic_step(
    process: KinematicProcess,
    *,
    iterations: int,
    student: float | None,
    with_state: bool = False,
    linearised: bool = False,
) -> Step:
    """Predict, then update with position, velocity and force, those that are there.

    The force is linearised `iterations` times; `student` is Student's degrees of freedom of its noise, None for a
    Gaussian one; `with_state` adds mean and covariance to the output.

    Filter state: `state_layout`. Sample: force [N], height [m], velocity [m/s], interval [s], and where the step is to
    be `linearised` at given states, these (n), NaN for none; out of contact they do not count. Settings: the noises,
    then first depth [m], chart (k), and standard deviations of surface and chart (1 + k) for a fresh start. Output:
    `palpate_filters.recursion.output_layout`.
    """
    import casadi as ca

    n, count = process.states, len(process.model.parameters)
    # Symbols of the filter's state, as `state_layout` has it.
    mean, covariance = ca.SX.sym("x", n), ca.SX.sym("P", n, n)
    low_count_before, centre = ca.SX.sym("low"), ca.SX.sym("b", int(process.biased))  # the bias to linearise at
    # Symbols of the settings: noises, and surface and chart of a fresh start; and those of the sample.
    noises, fresh, fresh_std = ca.SX.sym("p", NOISE_COUNT), ca.SX.sym("x0", 1 + count), ca.SX.sym("s0", 1 + count)
    noise = KinematicNoise(*ca.vertsplit(noises))
    reading = _reading_symbols(process, linearised)

    # Predict, then update with each measurement in turn: their errors are independent.
    x, P, _ = predict(process, mean, mirror(covariance), reading.interval, noise)
    moments = _update_motion(process, _Moments(x, P, ca.SX(0), ca.SX(0)), reading, noise)
    linearisation = _linearisation(process, reading, moments.mean) if linearised else None
    moments, innovation = _update_force(
        process,
        before=moments,
        force=reading.force,
        variance=noise.force**2,
        iterations=iterations,
        student=student,
        centre=centre,
        linearisation=linearisation,
    )
    # The mean over the measurements; -1 where none is there.
    nis = ca.if_else(moments.count > 0, moments.squares / ca.fmax(moments.count, 1), -1.0)

    # Restart where the tip has been out of contact for long.
    is_low = process.depth(ca.vertsplit(moments.mean)) <= 0
    low_count = ca.if_else(is_low, low_count_before + 1, 0)
    restart = low_count >= MAX_LOW_SAMPLES
    x, P = _restart_material(
        process, x=moments.mean, P=moments.covariance, restart=restart, fresh=fresh, fresh_std=fresh_std
    )

    # In the order of `palpate_filters.recursion.MARKS`, of which this filter has four.
    is_incomplete = moments.count < _MEASUREMENTS
    marks = [is_low, restart, is_incomplete, ca.SX(0), _has_diverged(process, x, P), ca.SX(0)]
    output = [report(process, x, P, reading.height), nis, innovation, *marks]
    if with_state:
        output += [x, ca.vec(P)]
    next_centre = _next_centre(process, x, P, centre, reading.interval)
    return Step(
        state=ca.vertcat(mean, ca.vec(covariance), low_count_before, centre),
        sample=reading.column,
        settings=ca.vertcat(noises, fresh, fresh_std),
        next_state=ca.vertcat(x, ca.vec(P), ca.if_else(restart, 0, low_count), *next_centre),
        output=ca.vertcat(*output),
    )


def _reading_symbols(process: KinematicProcess, linearised: bool) -> _SampleSymbols:
    """Return one sample as symbols, with a state at which to linearise where that is requested."""
    import casadi as ca

    column = ca.SX.sym("w", _READINGS + process.states * linearised)
    force, height, velocity, interval = ca.vertsplit(column[:_READINGS])
    return _SampleSymbols(
        column=column,
        force=force,
        height=height,
        velocity=velocity,
        interval=interval,
        linearisation=column[_READINGS:],
    )


def predict(
    process: KinematicProcess, mean: Any, covariance: Any, interval: Any, noise: KinematicNoise
) -> tuple[Any, ...]:
    """Return mean, covariance and Jacobian one interval later."""
    import casadi as ca

    mean_after = ca.vertcat(*process.predict(ca.vertsplit(mean), interval, ca.exp))
    jacobian = ca.jacobian(mean_after, mean)
    covariance_after = congruence(jacobian, covariance) + process_noise(process, interval, noise)
    return mean_after, covariance_after, jacobian


def jerk_covariance(interval: Any) -> list[list[Any]]:
    """Return the covariance (3 x 3) of height, velocity and acceleration by white jerk of density 1 over an interval.

    Source: Bar-Shalom, Li and Kirubarajan 2001, section 6.2.
    """
    T = interval
    return [[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]]


def process_noise(process: KinematicProcess, interval: Any, noise: KinematicNoise) -> Any:
    """Return the covariance (n, n) of what drives the process over an interval T.

    A random walk of density q adds q T. On a sweep, surface and first logarithm are each a level with a drift whose
    density q adds [[T^3/3, T^2/2], [T^2/2, T]] q to both.
    """
    import casadi as ca

    T, Q = interval, ca.SX.zeros(process.states, process.states)
    powers = jerk_covariance(T)  # its lower right 2 x 2 is that of a level with a drift
    # The motion, driven by jerk.
    for i, row in enumerate(powers, start=process.motion.start):
        for j, power in enumerate(row, start=process.motion.start):
            Q[i, j] = noise.jerk * power
    # Random walks of surface and first logarithm, and of their drifts.
    surface, first = process.layout.at("surface"), process.chart.start
    Q[surface, surface] = noise.surface * T
    Q[first, first] = noise.walk * T
    if process.sweeping:
        slope, trend = process.layout.at("slope"), process.layout.at("trend")
        for level, drift, density in ((surface, slope, noise.slope), (first, trend, noise.trend)):
            Q[level, level] += density * powers[1][1]
            Q[level, drift] = Q[drift, level] = density * powers[1][2]
            Q[drift, drift] = density * T
    # Random walks of the bias and of the other parameters.
    if process.biased:
        Q[process.layout["bias"], process.layout["bias"]] = noise.bias * T
    for i in range(first + 1, process.chart.stop):
        Q[i, i] = noise.ratio * T
    return Q


def _update_motion(
    process: KinematicProcess, before: _Moments, reading: _SampleSymbols, noise: KinematicNoise
) -> _Moments:
    """Return the estimate after the measured height and velocity, which are entries of the state.

    With mean and covariance it has the sum of all squared normalised innovations so far, and their number.
    """
    import casadi as ca

    x, P, squares, count = before.mean, before.covariance, before.squares, before.count
    height, velocity = process.layout.at("height"), process.layout.at("velocity")
    for axis, measured, std in (
        (height, reading.height, noise.position),
        (velocity, reading.velocity, noise.velocity),
    ):
        is_present = ca.fabs(measured) <= MISSING_ABOVE
        gain, P, weight = entry_update(P, axis, std**2, is_present)
        innovation = ca.if_else(is_present, measured, x[axis]) - x[axis]
        x = x + gain * innovation
        squares = squares + innovation**2 * weight
        count = count + is_present
    return _Moments(x, P, squares, count)


def _linearisation(process: KinematicProcess, reading: _SampleSymbols, mean: Any) -> Any:
    """Return the given state at which to linearise; the mean where none is given, or out of contact: no slope there."""
    import casadi as ca

    state = reading.linearisation
    in_contact = process.depth(ca.vertsplit(state)) > 0
    return ca.if_else(ca.logic_and(ca.fabs(state[0]) <= MISSING_ABOVE, in_contact), state, mean)


def _update_force(
    process: KinematicProcess,
    before: _Moments,
    force: Any,
    variance: Any,
    iterations: int,
    student: float | None,
    centre: Any,
    linearisation: Any,
) -> tuple[_Moments, Any]:
    """Return the estimate after the measured force, and the normalised innovation.

    `before` is the estimate without it, `variance` [N^2] that of the force, `centre` the bias [N] to linearise at.
    The force is linearised at the state `linearisation`, else again at each iterate (Bell and Cathey 1993), with a
    force bias at `_state_with_bias`. With Student's t of nu degrees of freedom the variance of a surprising force
    grows by (nu + e^2/S)/(nu + 1).
    """
    import casadi as ca

    is_present = ca.fabs(force) <= MISSING_ABOVE
    mean, covariance = before.mean, before.covariance
    x, P, normalised = mean, covariance, ca.SX(0)
    for _ in range(iterations):
        # The state at which the force is linearised.
        point = x if linearisation is None else linearisation
        if linearisation is None and process.biased:
            point = _state_with_bias(process, x, covariance, centre)
        # The innovation of the prediction, by the force's tangent at that state.
        expected, slope = _linearised_reading(process, point)
        expected += ca.dot(slope, mean - point)
        innovation = ca.if_else(is_present, force, expected) - expected
        # The variance by Student's t, then the update of the prediction, not of the iterate before.
        used_variance = variance
        if student is not None:
            square = innovation**2 / (ca.dot(slope, covariance @ slope) + variance)
            used_variance = variance * ca.fmax((student + square) / (student + 1.0), 1.0)
        gain, P, weight = vector_update(covariance, slope, used_variance, is_present)
        x = mean + gain * innovation
        normalised = innovation * ca.sqrt(weight)
    return _Moments(x, P, before.squares + normalised**2, before.count + is_present), normalised


def _state_with_bias(process: KinematicProcess, mean: Any, covariance: Any, bias: Any) -> Any:
    """Return the state x (n,) that a Gaussian estimate expects for a given force bias b [N]: E[x | b].

        E[x | b] = mean + cov(x, b)/var(b) (b - mean of b)

    The force is linearised there, at the bias with which the filter started (`_next_centre`). Along one line in the
    state, bias, surface and stiffness change together and the force hardly does. Slopes taken at a mean that wanders
    along this line would seem to measure the position on it, and the filter would become certain of what no reading
    shows; slopes at a fixed bias do not (observability constraint: Huang, Mourikis and Roumeliotis 2010).
    """
    import casadi as ca

    row = process.layout.at("bias")
    variance = ca.fmax(covariance[row, row], SMALLEST_VARIANCE)
    shift = covariance[:, row] * ((bias - mean[row]) / variance)
    shift[process.motion] = 0  # height, velocity and acceleration are measured, and not on that line
    shift[row] = bias - mean[row]
    return mean + shift


def _next_centre(process: KinematicProcess, x: Any, P: Any, before: Any, interval: Any) -> list[Any]:
    """Return the bias at which to linearise next: it follows the drift, within `_BIAS_REACH` of the estimate."""
    import casadi as ca

    if not process.biased:
        return []
    row = process.layout.at("bias")
    after = before + interval * x[process.layout.at("drift")] if process.drifting else before
    reach = _BIAS_REACH * ca.sqrt(ca.fmax(P[row, row], 0.0))
    return [ca.fmin(ca.fmax(after, x[row] - reach), x[row] + reach)]


def _linearised_reading(process: KinematicProcess, point: Any) -> tuple[Any, Any]:
    """Return the force sensor's reading in a state (n,), and its slope (n,), away from the pole of sqrt(d) at 0."""
    import casadi as ca

    # The slope of the contact force, in symbols without the force's branch at depth 0.
    state = ca.SX.sym("x", process.states)
    parts = ca.vertsplit(state)
    theta = process.parameters(parts[process.chart], ca.exp)
    force = process.model.force(process.depth(parts), process.rate(parts), theta, parts[process.layout["memory"]])

    # It is evaluated no nearer to 0 than the floor, and is 0 out of contact; mass and bias add theirs.
    layout, depth, floored_state = process.layout, process.depth(ca.vertsplit(point)), ca.SX(point)
    floored_state[layout.at("surface")] = point[layout.at("height")] + ca.fmax(depth, DEPTH_FLOOR)
    slope = ca.substitute(ca.jacobian(force, state).T, state, floored_state) * (depth > 0)
    slope[layout.at("acceleration")] -= process.mass
    slope[layout["bias"]] += 1
    return process.reading(ca.vertsplit(point), ca.exp), slope


def _restart_material(
    process: KinematicProcess, x: Any, P: Any, restart: Any, fresh: Any, fresh_std: Any
) -> tuple[Any, Any]:
    """Return mean and covariance that, on a restart, keep the motion and restart surface and parameters.

    `fresh` (1 + k) and its deviations `fresh_std` are the depth [m] and the parameters' chart of a first guess.
    """
    import casadi as ca

    mean, covariance = ca.SX(x), ca.SX(P)
    surface = process.layout.at("surface")
    renewed = [surface, *range(process.chart.start, process.chart.stop)]
    first_mean = dict(zip(renewed, ca.vertsplit(fresh), strict=True))
    first_mean[surface] += x[process.layout.at("height")]
    first_variance = dict(zip(renewed, ca.vertsplit(fresh_std**2), strict=True))
    # Slope, bias and memory become 0 with their variance kept; nothing stays correlated.
    for i in range(surface, process.states):
        mean[i] = ca.if_else(restart, first_mean.get(i, 0.0), x[i])
        for j in range(i):
            covariance[i, j] = covariance[j, i] = ca.if_else(restart, 0.0, P[j, i])
        variance = first_variance.get(i, ca.fmax(P[i, i], 0.0))
        covariance[i, i] = ca.if_else(restart, variance, P[i, i])
    return mean, covariance


def _has_diverged(process: KinematicProcess, x: Any, P: Any) -> Any:
    """Return 1 if the numbers are not finite, a variance is negative, or depth or parameters are out of range."""
    import casadi as ca

    variance = ca.diag(P)
    finite = ca.logic_and(ca.sumsqr(x) + ca.sum1(variance) <= MISSING_ABOVE, ca.mmin(variance) >= 0)
    near = ca.fabs(process.depth(ca.vertsplit(x))) <= MAX_DEPTH
    return ca.logic_not(ca.logic_and(ca.logic_and(finite, near), ca.mmax(ca.fabs(x[process.chart])) <= _MAX_LOGARITHM))


def report(process: KinematicProcess, x: Any, P: Any, height: Any) -> Any:
    """Return parameters, their variances, surface above the measured height, its variance, contact force."""
    import casadi as ca

    # The parameters' covariance is that of the chart between the slopes of the parameters by the chart.
    symbols = ca.SX.sym("c", len(process.model.parameters))
    theta = ca.vertcat(*process.parameters(ca.vertsplit(symbols), ca.exp))
    theta, slope = ca.substitute([theta, ca.jacobian(theta, symbols)], [symbols], [x[process.chart]])
    covariance = slope @ P[process.chart, process.chart] @ slope.T
    surface = process.layout.at("surface")
    depth, variance = x[surface] - height, P[surface, surface]
    return ca.vertcat(theta, ca.diag(covariance), depth, variance, process.contact(ca.vertsplit(x), ca.exp))
