"""Scores: whatever a directed test finds after its refit shows in the slopes of the force before it."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_fits import CasadiFit
from palpate_uncertainty.alternative_fit import refit
from palpate_uncertainty.channel_noise import WHITE
from palpate_uncertainty.directed_scores import SUSPICIOUS, scores
from palpate_uncertainty.directed_tests import directed_tests
from palpate_uncertainty.lack_of_fit import lack_of_fit
from palpate_uncertainty.model_alternatives import alternatives
from palpate_uncertainty.refit import make_course
from palpate_uncertainty.relaxation_alternatives import relaxing_share
from palpate_uncertainty.score_tests import LEVEL

STRENGTHS = (0.0, 3.0, 10.0, 30.0, 100.0, 1e3)  # of the effects below


def patterns(course, theta, surface):
    """Forces [N] of what is not in the model."""
    depth = np.maximum(course.depth(surface), 0.0) / 1e-3
    return {
        "timing": 3e-5 * course.change(theta, surface),
        "drift": 3e-3 * (course.time - course.begin) / course.span,
        "mass": 1e-3 * course.acceleration,
        "depth": 1e-3 * depth**2.5,
    }


@pytest.mark.slow
@pytest.mark.parametrize("reason", ["timing", "drift", "mass", "depth"])
def test_a_score_misses_nothing_that_a_directed_test_finds(evidence, reason):
    track = evidence("clean", CasadiFit(), seed=5)
    course = make_course(track, track.kept.used)
    significant = 0
    for strength in STRENGTHS:
        pattern = strength * patterns(course, track.values, track.surface)[reason]
        changed = replace(course, force=course.force + pattern)
        base = refit(changed, track.values, track.surface)
        others = [refitted() for refitted in alternatives(changed, base).values()]
        tests = directed_tests(base, others, changed.runs[changed.used], WHITE)
        if min(len(tests) * test.p for test in tests.values()) < LEVEL:
            significant += 1
            found = scores(changed, base, WHITE, None)
            assert found.keys() == tests.keys()
            doubtful = [tests[reason] for reason, score in found.items() if score.p < SUSPICIOUS]
            assert len(tests) * min(test.p for test in doubtful) < LEVEL
            assert all(found[reason].counts(test.share) for reason, test in tests.items() if test.p < LEVEL)
    assert significant


def test_a_clean_record_is_not_suspected(evidence):
    """One of seven scores is below its level by chance in 1 record of 15."""
    found = []
    for seed in range(3):
        track = evidence("clean", CasadiFit(), seed=seed)
        course = make_course(track, track.kept.used)
        base = refit(course, track.values, track.surface)
        found.append(any(score.p < SUSPICIOUS for score in scores(course, base, WHITE, None).values()))
    assert not all(found)


def test_a_score_within_the_noise_of_the_motion_does_not_count(evidence):
    track = evidence("clean", CasadiFit(), seed=5)
    course = make_course(track, track.kept.used)
    drifting = replace(course, force=course.force + 100.0 * patterns(course, track.values, track.surface)["drift"])
    before, base = (refit(one, track.values, track.surface) for one in (course, drifting))
    share = float(np.var(base.residual) / np.var(before.residual)) - 1.0  # the drift's, of the variance of the rest
    found = scores(drifting, base, WHITE, None)["drift"]
    assert found.counts(share)
    assert not found.counts(8.0 * share)


@pytest.mark.parametrize("ratio", [1e-4, 0.02, 0.7, 5.0])
def test_a_steady_force_relaxes_as_a_branch_does(ratio):
    """q' = f' - q/tau with f' = 1 a step: q = tau (1 - exp(-t/tau))."""
    share = relaxing_share(np.arange(3000.0), ratio)
    np.testing.assert_allclose(share, -np.expm1(-ratio * np.arange(3000)) / ratio, rtol=1e-12, atol=1e-12)
    later = relaxing_share(np.r_[np.zeros(7), np.arange(3000.0)], ratio)
    np.testing.assert_allclose(later[7:], share, rtol=1e-12, atol=1e-12)


def test_a_right_model_is_stepped_to_no_alternative(evidence, monkeypatch):
    monkeypatch.setattr("palpate_uncertainty.score_tests.TestedResidual.step", None)
    found = lack_of_fit([evidence("clean", CasadiFit(), seed=5)])["model/track"]
    assert found.table["p"] > LEVEL
