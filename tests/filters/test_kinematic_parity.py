"""The kinematic filter and its smoother against filterpy's and plain numpy, with derivatives by complex steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from palpate import ContactModel, Problem, Samples, contact_force
from palpate_filters.kinematic_filter import KinematicFilter, kinematic_recursion, noises
from palpate_filters.kinematic_settings import KinematicSettings
from palpate_filters.process_models import KinematicProcess
from palpate_filters.recursion import Carry
from palpate_filters.smoother import KinematicSmoother
from palpate_models import Power, Sphere
from palpate_models.dimensionality_reduction import DimensionalityReduction
from palpate_testing import synthetic_samples

Floats = Any
MASS = 0.14
SPHERE = DimensionalityReduction(indenter=Sphere(radius=5e-3))
QUARTIC = DimensionalityReduction(indenter=Power(exponent=4, coefficient=1e7))


def jittered(model: ContactModel, theta: list[float], count: int) -> Samples:
    """Samples with 20 % jitter of the interval, and with measurements missing here and there after the opening."""
    samples = synthetic_samples(model, theta, duration=count / 500.0)
    random = np.random.default_rng(6)
    interval = samples.interval * (1.0 + 0.2 * random.uniform(-1, 1, count))
    holes = {name: getattr(samples, name).copy() for name in ("force", "position", "velocity")}
    for column in holes.values():
        column[300:][random.uniform(size=count - 300) < 0.01] = np.nan
    return replace(samples, interval=interval, time=np.cumsum(interval), **holes)


def slope(function: Any, x: Floats) -> Floats:
    """Derivative of a function of a state (n,), exact to rounding."""
    step = 1e-30
    columns = [np.imag(function(x + 1j * step * unit)) / step for unit in np.eye(len(x))]
    return np.array(columns).T


def driven(process: KinematicProcess, interval: float, numbers: list[float]) -> Floats:
    """Covariance of what drives the process over an interval."""
    _, _, _, jerk, surface, drift, walk, trend, ratio, _ = numbers
    T, Q, chart = interval, np.zeros((process.states, process.states)), process.chart
    Q[:3, :3] = jerk * np.array(
        [[T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T]]
    )
    pairs = ((3, 4, surface, drift), (chart.start, process.states - 1, walk, trend))
    for level, rate, of_level, of_rate in pairs:
        Q[level, level] = of_level * T
        if process.sweeping:
            Q[np.ix_([level, rate], [level, rate])] += of_rate * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    for i in range(chart.start + 1, chart.stop):
        Q[i, i] = ratio * T
    return Q


@dataclass
class Way:
    """What the reference filter did on one sample: the Jacobian to it, each update, and where it came out."""

    jacobian: Floats  # (n, n)
    updates: list[tuple[Floats, Floats, float, float]]  # row (n,), gain (n,), innovation, its variance
    mean: Floats  # (n,)
    covariance: Floats  # (n, n)


def reference(settings: KinematicSettings, model: ContactModel, samples: Samples, window: int) -> list[Way]:
    """The filter by filterpy, begun on a window as ours is."""
    from filterpy.kalman import ExtendedKalmanFilter as Ekf

    process = KinematicProcess(model, MASS, settings.sweep_speed > 0)
    numbers, n = noises(settings, None, None), process.states
    recursion = kinematic_recursion(settings, Problem(model, MASS))
    begun = recursion.begin(Carry(None, np.nan), samples[: window + 1], False)
    assert begun is not None
    filter_ = Ekf(n, 1)
    filter_.x, filter_.P = begun[0][:n].copy(), begun[0][n : n + n * n].reshape(n, n)

    def reading(x: Floats) -> Any:
        theta = process.parameters(x[process.chart], np.exp)
        return contact_force(model, process.depth(x), process.rate(x), theta) - MASS * x[2]

    looks = ((samples.position, lambda x: x[0]), (samples.velocity, lambda x: x[1]), (samples.force, reading))
    found = []
    for i in range(len(samples)):
        interval = float(samples.interval[i]) if i else 0.0
        filter_.F = slope(lambda x, T=interval: np.array(process.predict(x, T, np.exp)), filter_.x)
        filter_.Q = driven(process, interval, numbers)
        filter_.predict()  # linear in the state but for models with memory
        updates = []
        for (column, look), std in zip(looks, (numbers[1], numbers[2], numbers[0]), strict=True):
            if not np.isfinite(column[i]):
                continue
            row, expected = slope(look, filter_.x), np.array([look(filter_.x)])
            filter_.R = np.array([[std**2]])
            filter_.update(np.array([column[i]]), lambda _, row=row: row[None, :], lambda _, z=expected: z)
            updates.append((row, filter_.K[:, 0].copy(), float(filter_.y[0]), float(filter_.S[0, 0])))
        found.append(Way(filter_.F, updates, filter_.x.copy(), filter_.P.copy()))
    return found


def smoothed(ways: list[Way]) -> list[Way]:
    """Bryson and Frazier's smoother: another way to the same numbers, which inverts no covariance."""
    n = len(ways[0].mean)
    weight, push, found = np.zeros((n, n)), np.zeros(n), []
    for way in reversed(ways):
        mean, covariance = way.mean - way.covariance @ push, way.covariance - way.covariance @ weight @ way.covariance
        found.append(replace(way, mean=mean, covariance=covariance))
        for row, gain, innovation, variance in reversed(way.updates):
            kept = np.eye(n) - np.outer(gain, row)
            weight = kept.T @ weight @ kept + np.outer(row, row) / variance
            push = kept.T @ push - row * innovation / variance
        weight, push = way.jacobian.T @ weight @ way.jacobian, way.jacobian.T @ push
    return found[::-1]


def told(model: ContactModel, settings: KinematicSettings, ways: list[Way]) -> tuple[Floats, Floats]:
    """Parameters and their standard deviations, from the chart."""
    process = KinematicProcess(model, MASS, settings.sweep_speed > 0)
    chart, values, std = process.chart, [], []
    for way in ways:
        bend = slope(lambda c: np.array(process.parameters(c, np.exp)), way.mean[chart])
        values.append(process.parameters(way.mean[chart], np.exp))
        std.append(np.sqrt(np.diag(bend @ way.covariance[chart, chart] @ bend.T)))
    return np.array(values), np.array(std)


def apart(found: Floats, expected: Floats) -> float:
    """Largest difference, relative to the largest value of each column."""
    return float(np.max(np.abs(found - expected) / np.abs(expected).max(axis=0)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "speed", "count"),
    [
        ("sphere", 0.0, 6000),
        ("sphere", 4e-3, 2000),
        ("quartic", 0.0, 2000),
        ("kelvin-voigt", 0.0, 2000),
        ("hunt-crossley", 0.0, 2000),
    ],
)
def test_the_kinematic_filter_is_filterpys(
    name: str, speed: float, count: int, contact_models: dict[str, tuple[ContactModel, list[float]]]
) -> None:
    own = {"sphere": (SPHERE, [1.1e5, 360.0]), "quartic": (QUARTIC, [1.1e5, 360.0])}
    model, theta = (own | contact_models)[name]
    samples, settings = jittered(model, theta, count), KinematicFilter(sweep_speed=speed)
    found = settings.start(Problem(model, MASS)).run(samples)
    begun = int(np.flatnonzero(np.isfinite(found.values[:, 0]))[0])
    values, std = told(model, settings, reference(settings, model, samples, begun)[begun:])
    assert apart(found.values[begun:], values) < 1e-9
    assert apart(found.std[begun:], std) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.0, 4e-3])
def test_the_smoother_is_bryson_and_fraziers(speed: float) -> None:
    samples, settings = jittered(SPHERE, [1.1e5, 360.0], 2000), KinematicSmoother(sweep_speed=speed, passes=1)
    found = settings.start(Problem(SPHERE, MASS)).run(samples)
    begun = int(np.searchsorted(samples.time - samples.time[0], settings.start_duration - 1e-9))
    values, std = told(SPHERE, settings, smoothed(reference(settings, SPHERE, samples, begun)))
    assert apart(found.values, values) < 1e-8
    assert apart(found.std, std) < 1e-8
