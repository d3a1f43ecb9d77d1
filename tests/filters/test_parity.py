"""filterpy is the oracle: every compiled filter gives its numbers, over 20 000 samples with jitter and holes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from palpate import ContactModel, Problem, Samples
from palpate_filters.adaptive_fading import AdaptiveFading, StrongFading
from palpate_filters.ekf import AdaptiveFadingEkf, ExtendedKalmanFilter
from palpate_filters.filterpy_filter import FilterpyFilter
from palpate_filters.predictions import sigma_directions
from palpate_filters.ukf import AdaptiveFadingUkf, UnscentedKalmanFilter
from palpate_models import Power, Sphere
from palpate_models.dimensionality_reduction import DimensionalityReduction
from palpate_testing import synthetic_samples

SPHERE = DimensionalityReduction(indenter=Sphere(radius=5e-3))
QUARTIC = DimensionalityReduction(indenter=Power(exponent=4, coefficient=1e7))
START: dict[str, Any] = {"start_depth": 2.5e-3, "start_depth_std": 5e-4, "start_force": 0.4, "start_damping": 10.0}


def jittered(model: ContactModel, theta: list[float], count: int) -> Samples:
    """Samples with 20 % jitter of the interval, and with force and velocity missing here and there."""
    samples = synthetic_samples(model, theta, duration=count / 500.0)
    random = np.random.default_rng(5)
    interval = samples.interval * (1.0 + 0.2 * random.uniform(-1, 1, count))
    force, velocity = samples.force.copy(), samples.velocity.copy()
    force[random.uniform(size=count) < 0.01] = np.nan
    velocity[random.uniform(size=count) < 0.01] = np.nan
    return replace(samples, interval=interval, force=force, velocity=velocity)


def agree(model: ContactModel, theta: list[float], ours: Any, theirs: Any, count: int = 20_000) -> None:
    samples, problem = jittered(model, theta, count), Problem(model, 0.14)
    one, other = ours.start(problem).run(samples), theirs.start(problem).run(samples)
    assert np.isfinite(other.values).all()
    for name in ("values", "std"):
        found, expected = getattr(one, name), getattr(other, name)
        assert np.max(np.abs(found - expected) / np.abs(expected).max(axis=0)) < 1e-9, name
    assert np.array_equal(np.isnan(one.nis), np.isnan(other.nis))


@pytest.mark.gate
@pytest.mark.slow
def test_the_ekf_is_filterpys() -> None:
    agree(SPHERE, [1.1e5, 360.0], ExtendedKalmanFilter(**START), FilterpyFilter(filter="ekf", **START))


@pytest.mark.slow
@pytest.mark.parametrize("model", ["quartic", "kelvin-voigt", "hunt-crossley"])
def test_the_ekf_is_filterpys_on_other_models(
    model: str, contact_models: dict[str, tuple[ContactModel, list[float]]]
) -> None:
    guess = {"first_guess": {"exponent": 1.4}, "first_guess_std": {"exponent": 0.1}} if "hunt" in model else {}
    options: dict[str, Any] = START | guess
    chosen = contact_models[model]
    agree(*chosen, ExtendedKalmanFilter(**options), FilterpyFilter(filter="ekf", **options), count=5_000)


@pytest.mark.slow
def test_the_ukf_is_filterpys() -> None:
    ours = UnscentedKalmanFilter(spread=0.5, **START)
    agree(SPHERE, [1.1e5, 360.0], ours, FilterpyFilter(filter="ukf", spread=0.5, **START))


@pytest.mark.slow
@pytest.mark.parametrize("points", ["merwe", "julier", "simplex"])
def test_every_kind_of_sigma_points_is_filterpys(points: Any) -> None:
    options: dict[str, Any] = {"points": points, "spread": 0.3, **START}
    theirs = FilterpyFilter(filter="ukf", **options)
    agree(QUARTIC, [1.1e5, 360.0], UnscentedKalmanFilter(**options), theirs, count=2000)


def test_the_ensemble_is_filterpys(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the same random numbers: filterpy's have the covariance of one error of the force in all states."""
    from filterpy.kalman import EnsembleKalmanFilter, ensemble_kalman_filter
    from palpate_filters.filterpy_kinds import ScaledProcess, ensemble
    from palpate_filters.inertial_filter import first_state
    from palpate_filters.process_models import InertialProcess

    random = np.random.default_rng(3)

    def draw(mean: Any, cov: Any, size: int) -> Any:
        row = np.argmax(np.diag(cov))
        column = cov[:, row] / np.sqrt(cov[row, row])
        if np.allclose(np.outer(column, column), cov):
            return mean + np.outer(random.standard_normal(size), column)
        return random.multivariate_normal(mean, cov, size)

    monkeypatch.setattr(ensemble_kalman_filter, "multivariate_normal", draw)
    process, problem, samples = (
        InertialProcess(SPHERE, 0.14),
        Problem(SPHERE, 0.14),
        jittered(SPHERE, [1.1e5, 360], 300),
    )
    settings = FilterpyFilter(filter="enkf", **START)
    start = first_state(settings, process, problem)
    rig = ScaledProcess(process, start, settings.force_std, settings.velocity_std)
    ours, force, interval = ensemble(rig, members=20, seed=3), np.nan, np.nan
    ours.put(start.mean / rig.scale, np.eye(process.states))
    theirs = EnsembleKalmanFilter(
        x=start.mean / rig.scale,
        P=np.eye(process.states),
        dim_z=1,
        dt=1.0,
        N=20,
        hx=rig.reading,
        fx=lambda x, _: rig.ahead(x, interval, force),
    )
    theirs.R = np.array([[rig.variance]])
    for moment in range(len(samples)):
        if moment > 0:
            force, interval = samples.force[moment - 1], samples.interval[moment]
            ours.predict(interval, force)
            theirs.Q = rig.noise(interval, force)
            theirs.predict()
        rate = -samples.velocity[moment] / rig.scale[rig.speed]
        if np.isfinite(rate):
            ours.update(rate)
            theirs.update(np.array([rate]))
        for one, other in zip(ours.get(), (theirs.x, theirs.P), strict=True):
            assert np.allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


@pytest.mark.parametrize("points", ["merwe", "julier", "simplex"])
@pytest.mark.parametrize("states", [1, 4, 8])
def test_sigma_points_have_the_moments_they_stand_for(points: Any, states: int) -> None:
    directions, weight, _ = sigma_directions(points, states, 0.5, 2.0, 1.0)
    assert np.allclose(directions.sum(axis=1), 0.0)
    assert np.allclose(directions @ directions.T * weight, np.eye(states))


def reference(settings: Any, model: ContactModel, samples: Samples) -> np.ndarray:
    """Parameters by filterpy with fading written out, on the expanded state, in units of the first spread."""
    from filterpy.kalman import ExtendedKalmanFilter as Ekf, MerweScaledSigmaPoints, UnscentedKalmanFilter as Ukf
    from palpate import Problem
    from palpate_filters.filterpy_kinds import ScaledProcess
    from palpate_filters.inertial_filter import first_state
    from palpate_filters.process_models import InertialProcess

    process = InertialProcess(model, 0.14, settings.order)
    start = first_state(settings, process, Problem(model, 0.14), settings.evolution_time, settings.derivative_std)
    rig, n = ScaledProcess(process, start, settings.force_std, settings.velocity_std), process.states
    row = np.eye(n)[1:2]
    unscented = isinstance(settings, AdaptiveFadingUkf)
    if unscented:
        points = MerweScaledSigmaPoints(n, settings.spread, settings.beta, settings.kappa)
        filter_: Any = Ukf(n, 1, 1.0, lambda x: x[1:2], rig.ahead, points)
    else:
        filter_ = Ekf(n, 1)
    filter_.x, filter_.P, filter_.R = start.mean / rig.scale, np.eye(n), np.array([[rig.variance]])
    filter_.x[1] = -samples.velocity[0] / rig.scale[1]
    alpha, found, force = 1.0, [], np.nan
    for i in range(len(samples)):
        if i:
            filter_.Q = rig.noise(samples.interval[i], force)
            if unscented:
                filter_.predict(dt=samples.interval[i], force=force)
            else:
                before = filter_.x
                filter_.F = rig.slope(before, samples.interval[i], force)
                filter_.predict()
                filter_.x = rig.ahead(before, samples.interval[i], force)
        rate = -samples.velocity[i] / rig.scale[1]
        surprise = abs(rate - filter_.x[1]) * rig.scale[1] if np.isfinite(rate) else 0.0
        up = surprise > settings.fading.theta
        fading = settings.fading
        alpha = min(fading.alpha_max, alpha + fading.step_up) if up else max(1.0, alpha - fading.step_down)
        scale = np.sqrt(np.minimum(alpha, np.maximum(fading.covariance_cap**2 / np.diag(filter_.P), 1.0)))
        filter_.P = filter_.P * np.outer(scale, scale)
        if np.isfinite(rate) and unscented:
            filter_.sigmas_f = points.sigma_points(filter_.x, filter_.P)
            filter_.update(np.array([rate]))
        elif np.isfinite(rate):
            filter_.update(np.array([rate]), lambda _: row, lambda x: x[1:2])
        force = samples.force[i]
        found.append(filter_.x * rig.scale)
    return np.array(found)[:, process.parameters]


@pytest.mark.parametrize(
    ("settings", "count"),
    [
        (AdaptiveFadingEkf(fading=StrongFading(theta=8e-4), **START), 2000),
        pytest.param(AdaptiveFadingEkf(fading=StrongFading(theta=8e-4), **START), 20_000, marks=pytest.mark.slow),
        pytest.param(
            AdaptiveFadingUkf(fading=AdaptiveFading(theta=8e-4), spread=0.5, **START), 20_000, marks=pytest.mark.slow
        ),
    ],
    ids=["afekf-short", "afekf", "afukf"],
)
def test_adaptive_fading_is_what_the_paper_writes(settings: Any, count: int) -> None:
    samples = jittered(SPHERE, [1.1e5, 360.0], count)
    expected = reference(settings, SPHERE, samples)
    found = settings.start(Problem(SPHERE, 0.14)).run(samples).values
    assert np.max(np.abs(found - expected) / np.abs(expected).max(axis=0)) < 1e-9
