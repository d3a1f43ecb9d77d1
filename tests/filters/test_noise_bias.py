"""The bias that the inertial filters have by their own noise: against records whose force is written out by hand."""

from functools import partial

import numpy as np
import pytest
from palpate import Bias, Diagnosed, Problem, Samples, Status, TrackEvidence
from palpate.evidence.uncertain_value import UncertainValue
from palpate_engine.result.sample_keeper import Keeper
from palpate_filters import AdaptiveFadingUkf, ExtendedKalmanFilter, KinematicFilter, KinematicSmoother
from palpate_filters.noise_bias import noise_bias
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Flat, Sphere

E, ETA, RADIUS, MASS = 112.5e3, 362.0, 5e-3, 0.14
MODEL = DimensionalityReduction(indenter=Sphere(radius=RADIUS))


def evidence(estimator, frequency, seed=0, force_noise=0.05, sideways=0.0, duration=10.0):
    """A sine of 0.9 mm around 4 mm: u = 16/9 E R^0.5 d^1.5 + 8 eta (R d)^0.5 d' + m d''."""
    random = np.random.default_rng(seed)
    time = np.arange(round(500 * duration)) / 500.0
    omega, n = 2 * np.pi * frequency, len(time)
    angle = omega * time + random.uniform(0, 2 * np.pi)
    depth, rate, second = 4e-3 + 0.9e-3 * np.sin(angle), 0.9e-3 * omega * np.cos(angle), -0.9e-3 * np.sin(angle)
    force = 16 / 9 * E * RADIUS**0.5 * depth**1.5 + 8 * ETA * (RADIUS * depth) ** 0.5 * rate + MASS * omega**2 * second
    noise, always = random.standard_normal((3, n)), np.ones(n, bool)
    samples = Samples(
        np.rint(time * 1e9).astype(np.int64), time, np.diff(time, prepend=0.0), force + force_noise * noise[0],
        -depth + 5e-6 * noise[1], -rate + 0.67e-3 * noise[2], always, always,
        np.column_stack([sideways * time, 0 * time]),
    )  # fmt: skip
    found = estimator.start(Problem(MODEL, MASS)).run(samples)
    keeper = Keeper()
    keeper.add(samples, found)
    last = np.flatnonzero((found.status & Status.IDLE) == 0)[-500:]
    values, std = found.values[last].mean(axis=0), found.std[last[-1]]
    surface = float(found.surface[last].mean())
    return TrackEvidence("t", MODEL, estimator, MASS, keeper.kept, *keeper.air, values, std, std, surface, None)


@pytest.mark.parametrize("frequency", [1.0, 2.0, 5.0])
def test_the_bias_of_the_viscosity_is_predicted_and_the_corrected_value_covered(frequency):
    """From a fit the filter has no way to rest; at 1 Hz the bias is some 30 %, at 5 Hz that of the time step."""
    for seed in range(3):
        track = evidence(ExtendedKalmanFilter(start_from="fit"), frequency, seed)
        bias = noise_bias([track])["t"].biases["viscosity"]
        left = track.values[1] - bias.shift - ETA
        assert abs(left) < 3 * np.hypot(track.std[1], bias.std)
        assert frequency > 1 or bias.shift > 3 * abs(left)


def test_the_bias_grows_with_the_square_of_the_noise_and_has_its_sign():
    estimator = ExtendedKalmanFilter(start_from="fit", force_std=0.05)
    loud, quiet = (
        noise_bias([evidence(estimator, 2.0, force_noise=noise)])["t"].biases["viscosity"].shift
        for noise in (0.05, 0.025)
    )
    assert 0 < quiet < loud
    assert 8.0 < loud < 20.0  # 2 to 6 % of 362


@pytest.mark.parametrize(
    ("estimator", "frequency"), [(ExtendedKalmanFilter(start_from="fit"), 0.5), (AdaptiveFadingUkf(), 1.0)]
)
def test_what_the_first_order_does_not_reach_is_flagged_and_not_corrected(estimator, frequency):
    found = noise_bias([evidence(estimator, frequency)])["t"]
    assert [flag.code for flag in found.flags] == ["noise-bias"]
    assert found.biases["viscosity"].std is None


def test_estimators_without_this_bias_are_left_alone():
    assert not noise_bias([evidence(CasadiFit(profile=False), 2.0, duration=3.0)])
    assert not noise_bias([evidence(KinematicFilter(sweep_speed=4e-3), 2.0, duration=3.0)])
    assert noise_bias([evidence(KinematicFilter(), 2.0, duration=3.0)])["t"] == Diagnosed()  # none that counts


def slow(seed, truth, kind=KinematicFilter):
    """A flat punch of 15.2 mm on 1.09 MPa, 0.125 mm at 0.99 Hz: E* 2 a d + 8 eta a d', where 5 um are 0.2 N."""
    random, radius = np.random.default_rng(seed), 15.2e-3
    time = np.arange(4000) / 500.0
    omega, n = 2 * np.pi * 0.99, len(time)
    angle = omega * time + random.uniform(0, 2 * np.pi)
    depth, rate, second = 0.74e-3 + 0.125e-3 * np.sin(angle), 0.125e-3 * omega * np.cos(angle), -np.sin(angle)
    force = 8 / 3 * truth[0] * radius * depth + 8 * truth[1] * radius * rate + MASS * 0.125e-3 * omega**2 * second
    noise, always = random.standard_normal((3, n)), np.ones(n, bool)
    samples = Samples(
        np.rint(time * 1e9).astype(np.int64), time, np.diff(time, prepend=0.0), force + 0.05 * noise[0],
        -depth + 5e-6 * noise[1], -rate + 0.67e-3 * noise[2], always, always,
    )  # fmt: skip
    model, estimator = DimensionalityReduction(indenter=Flat(radius=radius)), kind()
    found, keeper = estimator.start(Problem(model, MASS)).run(samples), Keeper()
    keeper.add(samples, found)
    values, std, surface = found.values[-500:].mean(axis=0), found.std[-1], float(found.surface[-500:].mean())
    return TrackEvidence("t", model, estimator, MASS, keeper.kept, *keeper.air, values, std, std, surface, None)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [KinematicFilter, partial(KinematicSmoother, passes=1)])
def test_noise_of_the_rate_lowers_the_viscosity_of_a_kinematic_filter_by_what_is_predicted(kind):
    """Where the rate is 0.55 mm/s (RMS) and its noise in the filter's state a third of that: -12 +- 1 %."""
    truth = np.array([1.09e6, 4870.0])
    for seed in range(3):
        track = slow(seed, truth, kind)
        bias = noise_bias([track])["t"].biases["viscosity"]
        off = (track.values - truth) / truth
        assert abs(off[0]) < 0.005
        assert -0.19 < off[1] < -0.06
        assert abs(track.values[1] - bias.shift - truth[1]) < 2.5 * np.hypot(track.std[1], bias.std)


@pytest.mark.slow
def test_a_smoother_that_is_relinearised_has_another_bias_which_is_predicted_too():
    """The tip has less jerk than is believed: +3 to +4 %, where a single pass is 12 % low."""
    truth, left, off = np.array([1.09e6, 4870.0]), [], []
    for seed in range(4):
        track = slow(seed, truth, KinematicSmoother)
        bias = noise_bias([track])["t"].biases["viscosity"]
        off.append(track.values[1] / truth[1] - 1)
        left.append((track.values[1] - bias.shift - truth[1]) / np.hypot(track.std[1], bias.std))
    assert 0.01 < np.mean(off) < 0.06
    assert np.max(np.abs(left)) < 2.5
    assert abs(np.mean(left)) < 1.0


@pytest.mark.slow
def test_the_starting_fit_is_not_bent_by_the_noise_of_the_motion():
    """With raw heights and rates it found 16 % of the viscosity, and E was 5 standard deviations off for good."""
    truth = np.array([1.09e6, 4870.0])
    found = np.array(
        [(track.values[0] / truth[0] - 1) * truth[0] / track.std[0] for track in (slow(s, truth) for s in range(6))]
    )
    assert np.sqrt(np.mean(found**2)) < 2.5


def test_a_sweep_has_the_bias_of_a_point():
    point, sweep = (
        noise_bias([evidence(ExtendedKalmanFilter(start_from="fit"), 2.0, sideways=way)])["t"].biases["viscosity"]
        for way in (0.0, 4e-3)
    )
    assert sweep.shift == pytest.approx(point.shift, rel=1e-9)
    assert point.shift > 8.0


def test_a_known_bias_is_corrected_beside_the_value_and_all_of_it_is_in_the_uncertainty_of_the_value():
    """GUM 3.2.4: what is corrected counts with the uncertainty of its correction only."""
    raw = UncertainValue(380.0, 3.0, "Pa*s", systematic=4.0, budget={"timing": 4.0})
    found = raw.diagnosed("noise_bias", 0.0, False, Bias(12.0, 5.0))
    assert (found.value, found.combined) == (380.0, pytest.approx(13.0))  # 3, 4, 12
    table = found.table()
    assert (table["bias"], table["corrected"]) == (12.0, 368.0)
    assert table["corrected_combined"] == pytest.approx(np.sqrt(50.0))  # 3, 4, 5
    assert "corrected" not in raw.diagnosed("noise_bias", 0.0, False, Bias(300.0, None)).table()
    judged = found.diagnosed("identifiability", 24.0, left=0.0)  # a distance that the correction takes away
    assert judged.combined == pytest.approx(np.hypot(13.0, 24.0))
    assert judged.corrected.combined == pytest.approx(np.sqrt(50.0))
    assert found.diagnosed("identifiability", 24.0, left=7.0).corrected.combined == pytest.approx(np.sqrt(99.0))
    assert found.diagnosed("model", 24.0).corrected.combined == pytest.approx(np.sqrt(50.0 + 24.0**2))
    with_own = raw.diagnosed("noise_bias", 6.0, False, Bias(12.0, 5.0))
    assert (with_own.combined, with_own.corrected.combined) == (pytest.approx(np.sqrt(205.0)), pytest.approx(86**0.5))
    assert Diagnosed().biases == {}
