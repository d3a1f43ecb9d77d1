"""Lack of fit: clean records pass, wrong models are flagged with a reason, and the uncertainty holds the truth."""

from dataclasses import replace

import numpy as np
import pytest
from palpate import Estimates, Samples
from palpate_engine.result.sample_keeper import Keeper
from palpate_filters import AdaptiveFadingEkf, ExtendedKalmanFilter, KinematicFilter, KinematicSmoother
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty import lack_of_fit as module
from palpate_uncertainty.alternative_fit import Refit, refit
from palpate_uncertainty.channel_noise import WHITE, null_of
from palpate_uncertainty.lack_of_fit import LEVEL, lack_of_fit
from palpate_uncertainty.model_alternatives import alternatives
from palpate_uncertainty.refit import Course, make_course
from palpate_uncertainty.whiteness import oscillation, whiteness_tests

E = 282.1e3
N = 4000
TIME = np.arange(N) / 500.0
ONE_RUN = np.zeros(N, np.int64)


def coloured(seed, n, share):
    noise = np.random.default_rng(seed).standard_normal(n + 100)
    for i in range(1, len(noise)):
        noise[i] += share * noise[i - 1]
    return noise[100:]


def judged(track):
    (finding,) = lack_of_fit([track]).values()
    return finding


def p_values(values, null, seed=0):
    phase = 4 * np.pi * TIME
    return whiteness_tests(values, ONE_RUN, np.sin(phase), phase, null)


@pytest.mark.slow
def test_white_noise_passes_as_often_as_it_should():
    found = [p_values(np.random.default_rng(seed).standard_normal(N), WHITE).p for seed in range(200)]
    assert np.mean(np.array(found) < 0.1) < 0.16  # binomial: 0.16 is exceeded once in 200 times
    assert min(found) > 1e-4


@pytest.mark.slow
def test_noise_that_is_filtered_is_judged_by_the_noise_at_standstill():
    found = [p_values(coloured(seed, N, 0.9), null_of(coloured(1000 + seed, 500, 0.9))).p for seed in range(30)]
    assert min(found) > LEVEL
    assert p_values(coloured(0, N, 0.9), WHITE).p < 1e-50


@pytest.mark.slow
def test_the_inertia_of_an_uneven_motion_is_no_lack_of_fit():
    """What a slope over 11 samples leaves of jolts of 2 samples: no noise of a standstill, and none of the model's."""
    found = []
    for seed in range(30):
        random = np.random.default_rng(seed)
        jolts = np.convolve(random.standard_normal(N + 12), np.ones(2), "valid")
        jolts = jolts[5:-6] - np.convolve(jolts, np.full(11, 1 / 11), "same")[5:-6]
        values = random.standard_normal(N) + 0.4 * jolts[:N]
        near = [float(np.corrcoef(values[lag:], values[:-lag])[0, 1]) for lag in (1, 4)]
        assert near[0] > 0.05
        assert near[1] < 0.0
        found.append(p_values(values, null_of(random.standard_normal(600))).p)
    assert min(found) > LEVEL


@pytest.mark.parametrize("name", ["phase", "time", "depth"])
def test_a_pattern_half_of_the_noise_is_found_even_in_filtered_noise(name):
    noise = coloured(1, N, 0.5)
    pattern = {
        "phase": np.sin(8 * np.pi * TIME + 1.0),
        "time": np.linspace(-1.7, 1.7, N),
        "depth": np.sin(4 * np.pi * TIME),
    }[name]
    found = p_values(noise + 0.5 * noise.std() * pattern, null_of(coloured(2, 1000, 0.5)))
    assert found.tests[name] < LEVEL
    assert found.misfit > 0.01


def test_an_oscillation_is_told_from_a_ramp():
    time = np.arange(5000) / 500.0
    frequency, phase = oscillation(time, 1e-3 * np.sin(2 * np.pi * 2.03 * time + 0.5))
    assert frequency == pytest.approx(2.03, abs=1e-3)
    assert np.angle(np.exp(1j * (phase[0] - 0.5))) == pytest.approx(0.0, abs=0.02)
    assert oscillation(time, 1e-3 * time) is None


def test_a_keeper_keeps_the_same_samples_however_they_are_cut():
    n = 150_000
    time = np.arange(n) / 500.0
    random = np.random.default_rng(0)
    columns = [random.standard_normal(n) for _ in range(3)]
    contact = time > 1.0
    samples = Samples(np.arange(n), time, np.full(n, 0.002), *columns, contact, contact)
    cuts = [[n], [1, 2, 3, 5000, 5001, 70_000, n], [*range(997, n, 997), n]]
    kept = []
    for ends in cuts:
        keeper, begin = Keeper(), 0
        for end in ends:
            part = samples[begin:end]
            keeper.add(part, Estimates.idle(part, 2))
            begin = end
        kept.append((keeper.kept, keeper.air))
    for other, air in kept[1:]:
        np.testing.assert_array_equal(air, kept[0][1])
        for name in vars(other):
            np.testing.assert_array_equal(getattr(other, name), getattr(kept[0][0], name))
    index = kept[0][0].index
    assert 8 * 4096 <= len(index) <= 17 * 4096
    assert index[-1] > 0.9 * n
    assert len(kept[0][1][0]) == np.count_nonzero(~contact)


def test_a_keeper_keeps_the_air_after_the_last_contact_however_it_is_cut():
    n = 9000
    time = np.arange(n) / 500.0
    contact = ((time > 1.0) & (time < 3.0)) | ((time > 5.0) & (time < 6.0))
    force = np.random.default_rng(0).standard_normal(n)
    samples = Samples(np.arange(n), time, np.full(n, 0.002), force, force, force, contact, contact)
    kept = []
    for ends in ([n], [1, 700, 2501, 2502, 3100, 8000, n], [*range(331, n, 331), n]):
        keeper, begin = Keeper(), 0
        for end in ends:
            keeper.add(samples[begin:end], Estimates.idle(samples[begin:end], 2))
            begin = end
        kept.append(keeper.air_after)
    after = np.flatnonzero(time >= 6.0)[:4096]
    for air in kept:
        np.testing.assert_array_equal(air, [time[after], force[after], force[after]])
    assert Keeper().air_after.shape == (3, 0)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [CasadiFit(), KinematicFilter(), KinematicSmoother(), ExtendedKalmanFilter()])
@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_a_clean_record_is_not_flagged(evidence, estimator, colour):
    finding = judged(evidence("clean", estimator, seed=5, colour=colour))
    assert not finding.flags
    assert not finding.terms
    assert finding.table["p"] > LEVEL


@pytest.mark.slow
def test_a_model_without_a_force_at_its_numbers_is_named_and_the_others_are_judged(evidence, monkeypatch):
    """An adhesive model divides by its modulus, which a fit that diverged may leave at 0."""
    judge = module._judge
    monkeypatch.setattr(module, "_judge", lambda track: 1 / 0 if track.name == "bad" else judge(track))
    good = evidence("clean", KinematicFilter(), seed=5)
    # Another model, since all tracks of one share its judgement.
    found = lack_of_fit([replace(good, name="bad", model=good.model.model_copy()), good])
    assert [flag.code for flag in found["bad"].flags] == ["diagnosis-failed"]
    assert found[good.name].table["p"] > LEVEL


def test_a_refit_may_begin_at_nothing(evidence):
    """A viscosity that an estimator has at its bound."""
    track = evidence("clean", ExtendedKalmanFilter(), seed=5)
    course = make_course(track, track.kept.used)
    begins = track.values, np.array([track.values[0], 0.0])
    found, other = (refit(course, theta, track.surface) for theta in begins)
    assert other.theta == pytest.approx(found.theta, rel=1e-3)
    assert other.surface == pytest.approx(found.surface, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [CasadiFit(), KinematicFilter(), ExtendedKalmanFilter()])
def test_a_layer_that_nobody_stated_is_a_finding_that_moves_the_value_to_it(evidence, estimator):
    track = evidence("thickness", estimator, radius=10e-3)
    finding = judged(track)
    (flag,) = finding.flags
    assert flag.code == "lack-of-fit"
    assert finding.table["wrong_facts"][:2] == ["thickness", "another tip"]
    assert track.values[0] > 1.4 * E
    assert flag.effects["elasticity"] > 10 * finding.terms["elasticity"]  # beyond any uncertainty


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [CasadiFit(), KinematicFilter(), ExtendedKalmanFilter()])
def test_a_material_that_remembers_is_a_note_with_its_row(evidence, estimator):
    track = evidence("memory", estimator, radius=10e-3)
    finding = judged(track)
    assert [flag.code for flag in finding.flags] == ["model-discrepancy"]
    assert finding.table["reasons"][0].startswith("memory")
    assert 0.02 < finding.terms["elasticity"] / track.values[0] < 0.08


@pytest.mark.slow
def test_a_faint_memory_is_not_taken_for_noise_of_the_motion(evidence):
    """A branch of 3 %: E is 4 % high and only 20 blocks of time show it."""
    track = evidence("memory", CasadiFit(), share=0.03)
    finding = judged(track)
    assert [flag.code for flag in finding.flags] == ["model-discrepancy"]
    assert track.values[0] > 1.03 * E
    assert finding.terms["elasticity"] > 3 * track.std[0]


@pytest.mark.slow
def test_another_tip_is_one_of_two_causes_that_are_named(evidence):
    track = evidence("another tip", CasadiFit())
    finding = judged(track)
    assert finding.table["wrong_facts"][:2] == ["thickness", "another tip"]  # a layer explains the quartic tip as well
    assert finding.flags[0].effects["elasticity"] > 0.25 * track.values[0]


@pytest.mark.slow
def test_a_drifting_sensor_is_distinguished_from_a_relaxing_material(evidence):
    track = evidence("drift", CasadiFit())
    finding = judged(track)
    assert finding.table["reasons"][0] == "drift"
    assert finding.table["ratio"] > 2
    assert abs(track.values[0] - E) < 2 * finding.terms["elasticity"]


@pytest.mark.slow
def test_all_tracks_of_a_model_share_the_judgement_of_its_fit(evidence):
    fit = evidence("thickness", CasadiFit(), radius=10e-3)
    filters = [
        replace(evidence("thickness", estimator, radius=10e-3), model=fit.model, name=estimator.__class__.__name__)
        for estimator in (ExtendedKalmanFilter(), AdaptiveFadingEkf())
    ]
    findings = lack_of_fit([*filters, fit])
    assert len(findings) == 3
    assert all(finding == findings[fit.name] for finding in findings.values())


@pytest.mark.slow
def test_a_sweep_is_not_judged_as_a_point(evidence):
    track = evidence("clean", KinematicFilter(sweep_speed=4e-3))
    found = judged(track)  # by its innovations along the way
    assert not found.flags
    assert "alternatives" not in found.table
    lateral = np.column_stack([np.linspace(0, 0.02, len(track.kept.time)), np.zeros(len(track.kept.time))])
    point = evidence("clean", KinematicFilter())
    assert lack_of_fit([replace(point, kept=replace(point.kept, lateral=lateral))]) == {}


@pytest.mark.slow
def test_without_a_standstill_the_upper_band_tells_the_noise(evidence):
    track = evidence("clean", CasadiFit())
    kept = track.kept
    hum = np.sin(2 * np.pi * 3.3 * kept.time + 3.0 * np.sin(2 * np.pi * 0.31 * kept.time))
    loud = replace(track, kept=replace(kept, force=kept.force + 0.1 * hum, innovation=kept.innovation + 2.0 * hum))
    finding = judged(loud)
    assert finding.terms["elasticity"] > 0
    nothing = np.zeros(0)
    finding = judged(replace(loud, air_time=nothing, air_force=nothing, air_position=nothing))
    assert finding.table["null"] == "noise"
    assert finding.table["ratio"] > 1.5
    force, left = (np.convolve(v, np.full(9, 1 / 9), "same") for v in (loud.kept.force, loud.kept.innovation))
    loud = replace(
        loud,
        kept=replace(loud.kept, force=force, innovation=left),
        air_time=nothing,
        air_force=nothing,
        air_position=nothing,
    )
    assert judged(loud).table["null"] == "residual"  # a band that is not flat tells nothing


@pytest.mark.filterwarnings("error")
def test_a_fit_that_has_lost_the_contact_is_judged_without_a_word_of_numpy():
    """Its surface lies below the whole record, where no shape of the elastic force is left to vary."""
    phase = 2 * np.pi * TIME
    course = Course(
        DimensionalityReduction(indenter=Sphere(radius=5e-3)),
        TIME,
        np.random.default_rng(1).normal(0.0, 0.05, N),
        -2e-3 + 5e-4 * np.cos(phase),
        1e-3 * np.pi * np.sin(phase),
        2e-3 * np.pi**2 * np.cos(phase),
        ONE_RUN,
        np.ones(N, bool),
        0.0,
        float(TIME[-1]),
        False,
        (0.0, 0.0),
    )
    lost = Refit("", np.array([4e3, 250.0]), -0.037, np.array([[4e3, 250.0]]), course.force)
    assert {"thickness", "another tip"}.isdisjoint(alternatives(course, lost))


def test_noise_of_the_motion_makes_a_force_by_the_slopes_of_the_model(evidence):
    """Of dimensionality reduction, 8 eta sqrt(R d) by the rate."""
    track = evidence("clean", ExtendedKalmanFilter(), seed=5)
    course = replace(make_course(track, track.kept.used), noise=(0.0, 1e-3))
    depth = np.maximum(course.reduced(500).depth(track.surface), 0.0)
    expected = np.mean((8 * 400.0 * np.sqrt(track.model.indenter.radius * depth) * 1e-3) ** 2)
    assert course.motion_noise(np.array([E, 400.0]), track.surface) == pytest.approx(expected, rel=1e-6)
