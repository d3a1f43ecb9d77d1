"""Steps of the kinematic filter, forwards and backwards, as symbolic expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from palpate import KinematicProcess, Step

from palpate_filters.symmetric import cholesky, congruence, entry_update, mirrored, vector_update

_DEPTH_FLOOR = 1e-5  # [m]; the slope of sqrt(d) has a pole at 0, so Jacobians are taken no nearer
_LOW_LIMIT = 25  # samples in a row at depth <= 0, in contact, before the filter begins anew
_LARGEST = 1e300  # CasADi folds z == z to 1, so this is how NaN is told
_DEEPEST = 0.1  # [m]
_CHART_END = 60.0  # logarithms beyond this are no material's

NOISES = 10  # of `_Noise`, in its order


@dataclass(frozen=True)
class _Noise:
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


def kinematic_step(
    process: KinematicProcess, *, iterations: int, student: float | None, with_state: bool = False
) -> Step:
    """Predict, then update with position, velocity and force, those that are there.

    Filter state: mean (n), covariance (n x n, columns), count of low depths. Sample: force [N], height [m], velocity
    [m/s], interval [s]. Settings: the noises (10), then first depth [m], chart (k), and standard deviations of surface
    and chart (1 + k) for a fresh start. Output: see `palpate_filters.tracking.Recursion`, then, `with_state`, mean and
    covariance.
    """
    import casadi as ca

    n, chart = process.states, process.chart
    count = len(process.model.parameters)
    mean, square, low_count = ca.SX.sym("x", n), ca.SX.sym("P", n, n), ca.SX.sym("low")
    covariance = mirrored(square)
    sample, numbers = ca.SX.sym("w", 4), ca.SX.sym("p", NOISES)
    fresh, fresh_std = ca.SX.sym("x0", 1 + count), ca.SX.sym("s0", 1 + count)
    force, height, velocity, interval = ca.vertsplit(sample)
    noise = _Noise(*ca.vertsplit(numbers))

    x, P, _ = predicted(process, mean, covariance, interval, noise)
    total, seen_count = ca.SX(0), ca.SX(0)
    for axis, measured, std in ((0, height, noise.position), (1, velocity, noise.velocity)):
        seen = ca.fabs(measured) <= _LARGEST
        gain, P, weight = entry_update(P, axis, std**2, seen)
        innovation = ca.if_else(seen, measured, x[axis]) - x[axis]
        x, total, seen_count = x + gain * innovation, total + innovation**2 * weight, seen_count + seen
    seen = ca.fabs(force) <= _LARGEST
    x, P, surprise = _force_update(process, x, P, force, noise.force**2, seen, iterations, student)
    total, seen_count = total + surprise**2, seen_count + seen
    nis = ca.if_else(seen_count > 0, total / ca.fmax(seen_count, 1), -1.0)

    low = process.depth(ca.vertsplit(x)) <= 0
    count_low = ca.if_else(low, low_count + 1, 0)
    restart = count_low >= _LOW_LIMIT
    x, P = _restarted(process, x, P, restart, fresh, fresh_std)
    marks = [low, restart, seen_count < 3, ca.SX(0), _broken(process, x, P), ca.SX(0)]
    output = [report(process, x, P, height), nis, surprise, *marks, *([x, ca.vec(P)] if with_state else [])]
    assert chart.stop <= n
    return Step(
        state=ca.vertcat(mean, ca.vec(square), low_count),
        sample=sample,
        settings=ca.vertcat(numbers, fresh, fresh_std),
        next_state=ca.vertcat(x, ca.vec(P), ca.if_else(restart, 0, count_low)),
        output=ca.vertcat(*output),
    )


def backward_step(process: KinematicProcess) -> Step:
    """One step of Rauch, Tung and Striebel's smoother, from the sample after to this one.

    State: smoothed mean (n) and covariance (n x n). Sample: filtered mean, covariance, interval [s] to the sample
    after, and measured height [m]. Settings: the noises. Output: what is reported, without NIS and marks. The
    covariance is a sum of congruences, so it stays positive: (I - G F) P (I - G F)^T + G (Q + P_after) G^T.
    """
    import casadi as ca

    n = process.states
    after, after_covariance = ca.SX.sym("xs", n), ca.SX.sym("Ps", n, n)
    mean, square = ca.SX.sym("x", n), ca.SX.sym("P", n, n)
    covariance, later_covariance = mirrored(square), mirrored(after_covariance)
    interval, height, numbers = ca.SX.sym("T"), ca.SX.sym("z"), ca.SX.sym("p", NOISES)
    noise = _Noise(*ca.vertsplit(numbers))
    ahead, ahead_covariance, jacobian = predicted(process, mean, covariance, interval, noise)
    gain = _solve_symmetric(ahead_covariance, jacobian @ covariance).T
    x = mean + gain @ (after - ahead)
    kept = ca.SX.eye(n) - gain @ jacobian
    added = mirrored(_process_noise(process, interval, noise) + later_covariance)
    P = mirrored(congruence(kept, covariance) + congruence(gain, added))
    return Step(
        state=ca.vertcat(after, ca.vec(after_covariance)),
        sample=ca.vertcat(mean, ca.vec(square), interval, height),
        settings=numbers,
        next_state=ca.vertcat(x, ca.vec(P)),
        output=report(process, x, P, height),
    )


def predicted(process: KinematicProcess, mean: Any, covariance: Any, interval: Any, noise: _Noise) -> tuple[Any, ...]:
    """Mean, covariance and Jacobian one interval later."""
    import casadi as ca

    ahead = ca.vertcat(*process.predict(ca.vertsplit(mean), interval, ca.exp))
    jacobian = ca.jacobian(ahead, mean)
    noisy = congruence(jacobian, covariance) + _process_noise(process, interval, noise)
    return ahead, noisy, jacobian


def _process_noise(process: KinematicProcess, interval: Any, noise: _Noise) -> Any:
    import casadi as ca

    T, Q = interval, ca.SX.zeros(process.states, process.states)
    powers = [[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]]
    for i in range(3):
        for j in range(3):
            Q[i, j] = noise.jerk * powers[i][j]
    first = process.chart.start
    Q[3, 3], Q[first, first] = noise.surface * T, noise.walk * T
    if process.sweeping:
        for level, drift, density in ((3, 4, noise.slope), (first, process.states - 1, noise.trend)):
            Q[level, level] += density * powers[1][1]
            Q[level, drift] = Q[drift, level] = density * powers[1][2]
            Q[drift, drift] = density * T
    if process.biased:
        Q[process.bias, process.bias] = noise.bias * T
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
) -> tuple[Any, Any, Any]:
    """The update with the force, linearised anew at each iterate (Bell and Cathey 1993).

    With Student's t of nu degrees of freedom the variance of a surprising force grows by (nu + e^2/S)/(nu + 1).
    """
    import casadi as ca

    at, x, P, surprise = mean, mean, covariance, ca.SX(0)
    for _ in range(iterations):
        expected, row = _linearised_reading(process, at)
        expected += ca.dot(row, mean - at)
        innovation = ca.if_else(seen, force, expected) - expected
        used = variance
        if student is not None:
            plain = innovation**2 / (ca.dot(row, covariance @ row) + variance)
            used = variance * ca.fmax((student + plain) / (student + 1.0), 1.0)
        gain, P, weight = vector_update(covariance, row, used, seen)
        at = x = mean + gain * innovation
        surprise = innovation * ca.sqrt(weight)
    return x, P, surprise


def _linearised_reading(process: KinematicProcess, at: Any) -> tuple[Any, Any]:
    """What the sensor should read in a state, and the slope (n,) of that, away from the pole of sqrt(d) at 0."""
    import casadi as ca

    state = ca.SX.sym("x", process.states)
    parts = ca.vertsplit(state)
    theta = process.parameters(parts[process.chart], ca.exp)
    force = process.model.force(process.depth(parts), process.rate(parts), theta, parts[process.memory])
    depth = process.depth(ca.vertsplit(at))
    away = ca.vertcat(at[:3], at[0] + ca.fmax(depth, _DEPTH_FLOOR), at[4:])
    slope = ca.substitute(ca.jacobian(force, state).T, state, away) * (depth > 0)
    slope[2] -= process.mass
    if process.biased:
        slope[process.bias] += 1
    return process.reading(ca.vertsplit(at), ca.exp), slope


def _restarted(process: KinematicProcess, x: Any, P: Any, restart: Any, fresh: Any, fresh_std: Any) -> tuple[Any, Any]:
    """Mean and covariance that, on a restart, keep the motion and begin surface and parameters anew."""
    import casadi as ca

    n, mean, covariance = process.states, ca.SX(x), ca.SX(P)
    begin = [x[0] + fresh[0], *[0.0] * (n - 4)]
    variance = [fresh_std[0] ** 2, *(ca.fmax(P[i, i], 0.0) for i in range(4, n))]
    for i, j in enumerate(range(process.chart.start, process.chart.stop), start=1):
        begin[j - 3], variance[j - 3] = fresh[i], fresh_std[i] ** 2
    for i in range(3, n):
        mean[i] = ca.if_else(restart, begin[i - 3], x[i])
        for j in range(i):
            covariance[i, j] = covariance[j, i] = ca.if_else(restart, 0.0, P[j, i])
        covariance[i, i] = ca.if_else(restart, variance[i - 3], P[i, i])
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
    return ca.vertcat(theta, ca.diag(spread), x[3] - height, P[3, 3], process.contact(state, ca.exp))


def _solve_symmetric(matrix: Any, right: Any) -> Any:
    """The solution of a symmetric system by its root, columns and rows first scaled to one; lost directions give 0."""
    import casadi as ca

    n = matrix.shape[0]
    scale = 1.0 / ca.sqrt(ca.fmax(ca.diag(matrix), 1e-300))
    root, _ = cholesky(matrix * (scale @ scale.T))
    inverse = [ca.if_else(root[i, i] > 1e-9, 1.0 / ca.fmax(root[i, i], 1e-9), 0.0) for i in range(n)]
    scaled = ca.diag(scale) @ right
    forward: list[Any] = []
    for i in range(n):
        rest = scaled[i, :] - (root[i, :i] @ ca.vertcat(*forward) if i else 0)
        forward.append(rest * inverse[i])
    backward: list[Any] = [None] * n
    for i in reversed(range(n)):
        rest = forward[i] - (root[i + 1 :, i].T @ ca.vertcat(*backward[i + 1 :]) if i < n - 1 else 0)
        backward[i] = rest * inverse[i]
    return ca.diag(scale) @ ca.vertcat(*backward)
