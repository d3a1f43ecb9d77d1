"""A force bias that drifts, and touches that are each too short: against forces written out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from palpate import Problem, Samples, Status
from palpate.offers import import_target
from palpate_filters import palpate_estimators
from palpate_models import DimensionalityReduction, Sphere

ELASTICITY, VISCOSITY, RADIUS, MASS = 112.5e3, 362.0, 5e-3, 0.14
PROBLEM = Problem(DimensionalityReduction(indenter=Sphere(radius=RADIUS)), MASS)
ESTIMATORS = {name: import_target(place) for name, place in palpate_estimators().items()}
HOUR = 3600.0


def palpation(seed: int, bias: float = 0.0, drift: float = 0.0, duration: float = 10.0, mean=4e-3, amplitude=0.8e-3):
    """A sine of 2 Hz; paraboloid, nu = 0.5: F = 16/9 E R^0.5 d^1.5 + 8 eta (R d)^0.5 d'; bias [N], its drift [N/s]."""
    random = np.random.default_rng(seed)
    time = np.arange(round(500 * duration)) / 500.0
    phase, omega = random.uniform(0, 2 * np.pi), 4 * np.pi
    depth = mean + amplitude * np.sin(omega * time + phase)
    rate = amplitude * omega * np.cos(omega * time + phase)
    acceleration = amplitude * omega**2 * np.sin(omega * time + phase)  # upwards
    inside = np.maximum(depth, 0.0)
    contact = np.maximum(
        16 / 9 * ELASTICITY * RADIUS**0.5 * inside**1.5 + 8 * VISCOSITY * (RADIUS * inside) ** 0.5 * rate, 0.0
    )
    noise = random.standard_normal((3, len(time)))
    touching = depth > 0
    return Samples(
        np.rint(time * 1e9).astype(np.int64),
        time,
        np.diff(time, prepend=0.0),
        contact - MASS * acceleration + bias + drift * time + 0.05 * noise[0],
        -depth + 5e-6 * noise[1],
        -rate + 0.67e-3 * noise[2],
        touching,
        touching.copy(),
    )


def errors(name: str, records: list[Samples], **settings) -> np.ndarray:
    """Error of E at the end over its stated standard deviation."""
    found = []
    for samples in records:
        estimates = ESTIMATORS[name](**settings).start(PROBLEM).run(samples)
        found.append((estimates.values[-1, 0] - ELASTICITY) / estimates.std[-1, 0])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("start_from", ["fit", "guess"])
def test_a_force_bias_leaves_the_elasticity_unbiased_and_honest(start_from):
    """The sum of eight squared errors is below 20.1 in 99 of 100 cases; a start that ignores the bias makes it 60."""
    found = errors("kinematic-ekf", [palpation(s, 0.3) for s in range(8)], bias_std="0.5 N", start_from=start_from)
    assert np.sum(found**2) < 20.1
    assert abs(found.mean()) < 2.6 / np.sqrt(8)


def test_the_bias_costs_what_the_bound_says():
    """Cramer-Rao for surface, E, eta and bias at 10 s: 1.75 % of E; less would be certainty from nowhere."""
    estimates = ESTIMATORS["kinematic-ekf"](bias_std="0.5 N", drift=0.0).start(PROBLEM).run(palpation(1, 0.3))
    assert 0.85 * 1.75e-2 < estimates.std[-1, 0] / estimates.values[-1, 0] < 1.3 * 1.75e-2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kinematic-ekf", "kinematic-smoother"])
def test_a_constant_drift_of_unknown_size_is_found(name):
    settings = {"bias_std": "0.1 N", "drift": "60 N/h"}
    records = [palpation(s, 0.1, drift * 60 / HOUR, 20.0) for s, drift in enumerate([-1.5, 1.0])]
    found = errors(name, records, **settings)
    assert np.sum(found**2) < 9.2
    assert np.abs(errors(name, records, bias_std=0.0)).max() > 10  # what nobody declares moves E


@pytest.mark.parametrize("name", ["kinematic-ekf", "kinematic-smoother"])
def test_what_the_filter_finds_itself_is_not_counted_twice(name):
    samples = palpation(1, 0.3, duration=3.0)
    for settings, causes in (({"bias_std": "0.5 N"}, ["tare"]), ({}, [])):
        found = ESTIMATORS[name](**settings).start(PROBLEM).run(samples)
        assert list(found.details.get("included", [])) == causes


def test_the_smoother_tells_no_innovation_where_nothing_was_measured():
    samples = palpation(2, duration=3.0)
    force, rows = samples.force.copy(), slice(700, 740)
    force[rows] = np.nan
    blind = replace(samples, force=force, velocity=np.where(np.isnan(force), np.nan, samples.velocity))
    found = ESTIMATORS["kinematic-smoother"]().start(PROBLEM).run(blind)
    assert np.isnan(found.innovation[rows]).all()
    assert (found.nis[np.isfinite(found.nis)] >= 0).all()
    assert np.isfinite(found.innovation[800:1200]).all()


def test_a_random_walk_is_another_thing_than_a_drift():
    samples = palpation(3, duration=20.0)
    steps = np.random.default_rng(8).standard_normal(len(samples)) * np.sqrt(0.002)
    walking = replace(samples, force=samples.force + 4.0 / np.sqrt(HOUR) * np.cumsum(steps))
    found = errors("kinematic-ekf", [walking], bias_std="0.05 N", drift_walk="4 N/sqrt(h)")
    assert abs(found[0]) < 2.6


@pytest.mark.slow
def test_ten_minutes_of_a_sensor_that_warms_up():
    """1.5 N/h is 0.25 N at the end, which a filter without a bias takes for 1 % of E at a stated 0.02 %."""
    samples = palpation(5, 0.02, 1.5 / HOUR, 600.0)
    assert abs(errors("kinematic-ekf", [samples], bias_std="50 mN")[0]) < 2.6
    assert abs(errors("kinematic-ekf", [samples])[0]) > 10


def lifting(seed: int) -> Samples:
    """Contact of a third of a second in each cycle."""
    return palpation(seed, mean=1e-3, amplitude=2e-3)


@pytest.mark.parametrize("name", ["kinematic-ekf", "kinematic-smoother"])
def test_a_start_takes_several_touches(name):
    samples = lifting(2)
    estimates = ESTIMATORS[name]().start(PROBLEM).run(samples)
    told = np.flatnonzero(np.isfinite(estimates.values[:, 0]))
    before = np.count_nonzero(samples.contact[: told[0]])
    assert 250 <= before <= 255 if name == "kinematic-ekf" else before == 0  # half a second of contact
    last = told[-1]
    assert abs(estimates.values[last, 0] - ELASTICITY) < 3 * estimates.std[last, 0]
    assert estimates.std[last, 0] < 0.005 * ELASTICITY
    assert np.isnan(estimates.values[~samples.contact]).all()


def test_touches_elsewhere_do_not_add_up():
    samples = lifting(2)
    touch = np.cumsum(np.diff(samples.contact.astype(int), prepend=0) > 0)
    lateral = np.column_stack([5e-3 * touch, 0.0 * touch])
    estimates = ESTIMATORS["kinematic-ekf"]().start(PROBLEM).run(replace(samples, lateral=lateral))
    assert (estimates.status[samples.contact] & Status.WAITING).all()


@pytest.mark.parametrize("size", [1, 7, 333])
def test_a_start_over_touches_gives_the_same_bits_however_it_is_cut(size):
    samples = lifting(4)[:700]
    whole = ESTIMATORS["kinematic-ekf"](bias_std=0.1).start(PROBLEM).run(samples)
    tracker = ESTIMATORS["kinematic-ekf"](bias_std=0.1).start(PROBLEM)
    parts = [tracker.run(samples[i : i + size]) for i in range(0, len(samples), size)]
    assert np.array_equal(whole.values, np.concatenate([part.values for part in parts]), equal_nan=True)
    assert np.array_equal(whole.status, np.concatenate([part.status for part in parts]))


@pytest.mark.parametrize("settings", [{}, {"bias_std": "50 mN"}])
def test_a_skin_that_does_not_pull_leaves_no_bias_where_the_tip_lifts_off(settings):
    """The tip leaves faster than the skin follows; a model that pulls there made E 0.9 % too high at a stated 0.28."""
    found = []
    for seed in range(6):
        samples = lifting(seed)
        estimates = ESTIMATORS["kinematic-ekf"](**settings).start(PROBLEM).run(samples)
        last = np.flatnonzero(np.isfinite(estimates.values[:, 0]))[-1]
        found.append((estimates.values[last, 0] - ELASTICITY) / estimates.std[last, 0])
    assert abs(np.mean(found)) < 2.6 / np.sqrt(6)
    assert np.sum(np.square(found)) < 22.5  # 99.9 % of six
