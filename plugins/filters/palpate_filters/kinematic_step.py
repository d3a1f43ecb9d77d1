"""One step of the kinematic filter as a symbolic expression."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from palpate import Layout
from palpate_kit.kernel import Step

from palpate_filters.covariance import congruence, entry_update, mirror, vector_update
from palpate_filters.process_models import KinematicProcess

_DEPTH_FLOOR = 1e-5  # [m]; the slope of sqrt(d) has a pole at 0, so Jacobians are taken no nearer
_LOW_LIMIT = 25  # samples in a row at depth <= 0, in contact, before the filter restarts
_LARGEST = 1e300  # CasADi folds z == z to 1, so NaN is detected thus
_DEEPEST = 0.1  # [m]
_WANDERS = 5.0  # standard deviations of a bias
_CHART_END = 60.0  # logarithms beyond this do not occur

NOISES = 10  # of `Noise`, in its order


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


def carried(process: KinematicProcess) -> Layout:
    """The filter's state: mean (n), covariance (n x n), count of low depths, bias [N] at which to linearise."""
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

    Filter state: `carried`. Sample: force [N], height [m], velocity [m/s], interval [s], and where it is to be
    `linearised` at states that are known already, these (n), NaN for none; out of contact they do not count.
    Settings: the noises, then
    first depth [m], chart (k), and standard deviations of surface and chart (1 + k) for a fresh start. Output:
    `palpate_filters.recursion.output_layout`.
    """
    import casadi as ca

    n, at = process.states, process.layout.at
    count = len(process.model.parameters)
    mean, square, low_count = ca.SX.sym("x", n), ca.SX.sym("P", n, n), ca.SX.sym("low")
    centre = ca.SX.sym("b", carried(process)["centre"].stop - carried(process)["centre"].start)
    covariance = mirror(square)
    sample, numbers = ca.SX.sym("w", 4 + n * linearised), ca.SX.sym("p", NOISES)
    fresh, fresh_std = ca.SX.sym("x0", 1 + count), ca.SX.sym("s0", 1 + count)
    force, height, velocity, interval = ca.vertsplit(sample[:4])
    noise = KinematicNoise(*ca.vertsplit(numbers))

    x, P, _ = predicted(process, mean, covariance, interval, noise)
    total, seen_count = ca.SX(0), ca.SX(0)
    motion = ((at("height"), height, noise.position), (at("velocity"), velocity, noise.velocity))
    for axis, measured, std in motion:
        seen = ca.fabs(measured) <= _LARGEST
        gain, P, weight = entry_update(P, axis, std**2, seen)
        innovation = ca.if_else(seen, measured, x[axis]) - x[axis]
        x, total, seen_count = x + gain * innovation, total + innovation**2 * weight, seen_count + seen
    seen = ca.fabs(force) <= _LARGEST
    known = None
    if linearised:  # out of contact no slope exists to linearise by
        given = ca.logic_and(ca.fabs(sample[4]) <= _LARGEST, process.depth(ca.vertsplit(sample[4:])) > 0)
        known = ca.if_else(given, sample[4:], x)
    x, P, surprise = _force_update(process, x, P, force, noise.force**2, seen, iterations, student, centre, known)
    total, seen_count = total + surprise**2, seen_count + seen
    nis = ca.if_else(seen_count > 0, total / ca.fmax(seen_count, 1), -1.0)

    low = process.depth(ca.vertsplit(x)) <= 0
    count_low = ca.if_else(low, low_count + 1, 0)
    restart = count_low >= _LOW_LIMIT
    x, P = _restarted(process, x, P, restart, fresh, fresh_std)
    marks = [low, restart, seen_count < 3, ca.SX(0), _broken(process, x, P), ca.SX(0)]
    output = [report(process, x, P, height), nis, surprise, *marks, *([x, ca.vec(P)] if with_state else [])]
    return Step(
        state=ca.vertcat(mean, ca.vec(square), low_count, centre),
        sample=sample,
        settings=ca.vertcat(numbers, fresh, fresh_std),
        next_state=ca.vertcat(
            x, ca.vec(P), ca.if_else(restart, 0, count_low), *_centre(process, x, P, centre, interval)
        ),
        output=ca.vertcat(*output),
    )


def predicted(
    process: KinematicProcess, mean: Any, covariance: Any, interval: Any, noise: KinematicNoise
) -> tuple[Any, ...]:
    """Mean, covariance and Jacobian one interval later."""
    import casadi as ca

    ahead = ca.vertcat(*process.predict(ca.vertsplit(mean), interval, ca.exp))
    jacobian = ca.jacobian(ahead, mean)
    noisy = congruence(jacobian, covariance) + process_noise(process, interval, noise)
    return ahead, noisy, jacobian


def process_noise(process: KinematicProcess, interval: Any, noise: KinematicNoise) -> Any:
    """Covariance (n, n) of what drives the process over an interval."""
    import casadi as ca

    T, Q = interval, ca.SX.zeros(process.states, process.states)
    powers = [[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]]
    place, at = process.layout, process.layout.at
    for i, row in enumerate(powers, start=process.motion.start):
        for j, power in enumerate(row, start=process.motion.start):
            Q[i, j] = noise.jerk * power
    surface, first = at("surface"), process.chart.start
    Q[surface, surface], Q[first, first] = noise.surface * T, noise.walk * T
    if process.sweeping:
        for level, drift, density in ((surface, at("slope"), noise.slope), (first, at("trend"), noise.trend)):
            Q[level, level] += density * powers[1][1]
            Q[level, drift] = Q[drift, level] = density * powers[1][2]
            Q[drift, drift] = density * T
    if process.biased:
        Q[place["bias"], place["bias"]] = noise.bias * T
    for i in range(first + 1, process.chart.stop):
        Q[i, i] = noise.ratio * T
    return Q


def _force_update(
    process: KinematicProcess,
    mean: Any,
    covariance: Any,
    force: Any,
    variance: Any,
    seen: Any,
    iterations: int,
    student: float | None,
    centre: Any,
    known: Any,
) -> tuple[Any, Any, Any]:
    """The update with the force, linearised at the `known` state, else again at each iterate (Bell and Cathey 1993).

    With a force bias see `_with_bias` for where. With Student's t of nu degrees of freedom the variance of a
    surprising force grows by (nu + e^2/S)/(nu + 1).
    """
    import casadi as ca

    x, P, surprise = mean, covariance, ca.SX(0)
    for _ in range(iterations):
        at = x if known is None else known
        if known is None and process.biased:
            at = _with_bias(process, x, covariance, centre)
        expected, row = _linearised_reading(process, at)
        expected += ca.dot(row, mean - at)
        innovation = ca.if_else(seen, force, expected) - expected
        used = variance
        if student is not None:
            plain = innovation**2 / (ca.dot(row, covariance @ row) + variance)
            used = variance * ca.fmax((student + plain) / (student + 1.0), 1.0)
        gain, P, weight = vector_update(covariance, row, used, seen)
        x = mean + gain * innovation
        surprise = innovation * ca.sqrt(weight)
    return x, P, surprise


def _with_bias(process: KinematicProcess, mean: Any, covariance: Any, bias: Any) -> Any:
    """The state that is expected should the bias be another one: the mean moved by cov(x, b)/var(b).

    Bias, surface and stiffness trade against each other along a line in the state that the force hardly sees. Were the
    force linearised wherever the mean wanders on that line, the slopes would seem to show how far along it the truth
    is, and the filter grow certain of what it did not measure (as observability-constrained filters avoid: Huang,
    Mourikis and Roumeliotis 2010). At one and the same bias they do not.
    """
    import casadi as ca

    where = process.layout.at("bias")
    moved = covariance[:, where] * ((bias - mean[where]) / ca.fmax(covariance[where, where], 1e-300))
    moved[process.motion] = 0
    moved[where] = bias - mean[where]
    return mean + moved


def _centre(process: KinematicProcess, x: Any, P: Any, before: Any, interval: Any) -> list[Any]:
    """The bias at which to linearise next: it drifts as the bias does, and is never left behind by more than chance."""
    import casadi as ca

    if not process.biased:
        return []
    where = process.layout.at("bias")
    ahead = before + interval * x[process.layout.at("drift")] if process.drifting else before
    reach = _WANDERS * ca.sqrt(ca.fmax(P[where, where], 0.0))
    return [ca.fmin(ca.fmax(ahead, x[where] - reach), x[where] + reach)]


def _linearised_reading(process: KinematicProcess, at: Any) -> tuple[Any, Any]:
    """What the sensor should read in a state, and the slope (n,) of that, away from the pole of sqrt(d) at 0."""
    import casadi as ca

    state = ca.SX.sym("x", process.states)
    parts = ca.vertsplit(state)
    theta = process.parameters(parts[process.chart], ca.exp)
    force = process.model.force(process.depth(parts), process.rate(parts), theta, parts[process.layout["memory"]])
    place, depth, away = process.layout, process.depth(ca.vertsplit(at)), ca.SX(at)
    away[place.at("surface")] = at[place.at("height")] + ca.fmax(depth, _DEPTH_FLOOR)
    slope = ca.substitute(ca.jacobian(force, state).T, state, away) * (depth > 0)
    slope[place.at("acceleration")] -= process.mass
    slope[place["bias"]] += 1
    return process.reading(ca.vertsplit(at), ca.exp), slope


def _restarted(process: KinematicProcess, x: Any, P: Any, restart: Any, fresh: Any, fresh_std: Any) -> tuple[Any, Any]:
    """Mean and covariance that, on a restart, keep the motion and restart surface and parameters."""
    import casadi as ca

    place, mean, covariance = process.layout, ca.SX(x), ca.SX(P)
    surface = place.at("surface")
    renewed = [surface, *range(process.chart.start, process.chart.stop)]
    first = dict(zip(renewed, ca.vertsplit(fresh), strict=True))
    first[surface] += x[place.at("height")]
    spread = dict(zip(renewed, ca.vertsplit(fresh_std**2), strict=True))
    for i in range(surface, process.states):
        mean[i] = ca.if_else(restart, first.get(i, 0.0), x[i])
        for j in range(i):
            covariance[i, j] = covariance[j, i] = ca.if_else(restart, 0.0, P[j, i])
        covariance[i, i] = ca.if_else(restart, spread.get(i, ca.fmax(P[i, i], 0.0)), P[i, i])
    return mean, covariance


def _broken(process: KinematicProcess, x: Any, P: Any) -> Any:
    import casadi as ca

    variance = ca.diag(P)
    finite = ca.logic_and(ca.sumsqr(x) + ca.sum1(variance) <= _LARGEST, ca.mmin(variance) >= 0)
    near = ca.fabs(process.depth(ca.vertsplit(x))) <= _DEEPEST
    return ca.logic_not(ca.logic_and(ca.logic_and(finite, near), ca.mmax(ca.fabs(x[process.chart])) <= _CHART_END))


def report(process: KinematicProcess, x: Any, P: Any, height: Any) -> Any:
    """Parameters, their variances, surface above the measured height, its variance, contact force."""
    import casadi as ca

    state = ca.vertsplit(x)
    symbols = ca.SX.sym("c", len(process.model.parameters))
    theta = ca.vertcat(*process.parameters(ca.vertsplit(symbols), ca.exp))
    theta, slope = ca.substitute([theta, ca.jacobian(theta, symbols)], [symbols], [x[process.chart]])
    spread = slope @ P[process.chart, process.chart] @ slope.T
    surface = process.layout.at("surface")
    depth, variance = x[surface] - height, P[surface, surface]
    return ca.vertcat(theta, ca.diag(spread), depth, variance, process.contact(state, ca.exp))
