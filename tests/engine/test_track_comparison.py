"""Measures by which tracks are compared: from the samples and estimates alone, the same for every estimator."""

import math

import numpy as np
import pytest
from palpate import Estimates, Samples, force_over_time
from palpate_engine.result import UncertainValue
from palpate_engine.result.track_comparison import ComparisonRecord, TrackComparison, nis_band
from palpate_models.dimensionality_reduction import DimensionalityReduction
from palpate_models.indenters.power_profiles import Sphere
from palpate_models.relaxing_models import StandardLinearSolid

E, ETA, SURFACE = 1e5, 300.0, 1e-3
RATE, MASS = 500.0, 0.14


def record(theta=(E, ETA), memory=None, duration=4.0):
    """Samples of a sine, without noise, with the force of a material."""
    model = memory or DimensionalityReduction(indenter=Sphere(radius=5e-3))
    stamp = np.rint(np.arange(round(duration * RATE)) * 1e9 / RATE).astype(np.int64)
    time, omega = stamp / 1e9, 4 * np.pi
    depth, rate = 3e-3 + 1e-3 * np.sin(omega * time), 1e-3 * omega * np.cos(omega * time)
    force = force_over_time(model, time, depth, rate, theta) - MASS * 1e-3 * omega**2 * np.sin(omega * time)
    always = np.ones(len(time), bool)
    interval = np.concatenate([[0.0], np.diff(time)])
    return model, Samples(stamp, time, interval, force, SURFACE - depth, -rate, always, always.copy())


def estimates(samples, values):
    found = Estimates.idle(samples, values.shape[1])
    found.values[:], found.surface[:] = values, SURFACE
    found.status[:] = 0
    return found


def measured(model, samples, values, cuts=(), end=None):
    kept = ComparisonRecord()
    whole = estimates(samples, values)
    for a, b in zip((0, *cuts), (*cuts, len(samples)), strict=True):
        kept.add(samples[a:b], estimates(samples[a:b], whole.values[a:b]))
    ends = {
        parameter.name: UncertainValue(value, 0.01 * value, parameter.unit)
        for parameter, value in zip(model.parameters, values[-1] if end is None else end, strict=True)
    }
    return kept.measure(model, MASS, ends, 500)


def constant(samples, theta):
    return np.tile(np.array(theta, float), (len(samples), 1))


def test_the_right_parameters_predict_the_force_and_wrong_ones_by_their_error():
    model, samples = record()
    right = measured(model, samples, constant(samples, (E, ETA)))
    wrong = measured(model, samples, constant(samples, (1.1 * E, 1.1 * ETA)))
    assert right.prediction < 1e-3  # of the differenced acceleration
    assert wrong.prediction == pytest.approx(0.1, rel=0.05)
    assert right.predicted == right.predictable == len(samples) - round(TrackComparison.WARM_UP * RATE) - 5


def test_the_prediction_is_by_the_sample_before():
    """Estimates that swing from sample to sample fit each sample and predict none."""
    model, samples = record()
    swinging = constant(samples, (E, ETA))
    swinging[::2] *= 1.2
    assert measured(model, samples, swinging).prediction > 0.1


def test_a_model_with_memory_is_integrated_along_the_measured_motion():
    model = StandardLinearSolid(indenter=Sphere(radius=5e-3))
    theta = (1e5, 3e4, 0.1)
    model, samples = record(theta, model)
    assert measured(model, samples, constant(samples, theta)).prediction < 1e-3
    forgetful = measured(model, samples, constant(samples, (1e5, 3e4, 1e-2)))
    assert forgetful.prediction > 0.01


def test_the_measures_are_the_same_however_the_record_is_cut():
    model, samples = record()
    values = constant(samples, (E, ETA)) * (1 + np.exp(-samples.time))[:, None]
    assert measured(model, samples, values) == measured(model, samples, values, cuts=(1, 2, 700, 1301))


def test_time_to_settle_is_that_of_the_last_five_percent():
    model, samples = record()
    values = constant(samples, (E, ETA)) * (1 + np.exp(-samples.time / 0.5))[:, None]
    times = measured(model, samples, values, end=(E, ETA)).settling_times
    assert times["elasticity"] == pytest.approx(0.5 * math.log(20), abs=2 / RATE)


def test_an_estimator_that_is_silent_predicts_nothing():
    model, samples = record()
    silent = measured(model, samples, constant(samples, (np.nan, np.nan)))
    assert silent.predicted == 0
    assert silent.predictable > 1000
    assert silent.table()["prediction"] is None


@pytest.mark.parametrize("count", [5, 100, 5000])
def test_the_band_of_the_nis_is_that_of_chi_squared(count):
    from scipy.stats import chi2

    assert nis_band(count) == pytest.approx(chi2.ppf([0.025, 0.975], count) / count, abs=0.01)
