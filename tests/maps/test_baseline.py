"""Tests of sites against sites: are they honest about false alarms?"""

import numpy as np
import pytest
from palpate_maps.map_analysis import against_sites, discoveries, find_baseline, prediction_p, welch


def test_outliers_do_not_hide_one_another():
    dice = np.random.default_rng(1)
    log = 0.01 * dice.standard_normal(40)
    log[[3, 4, 5, 20, 21]] += 0.3
    baseline = find_baseline(log)
    assert set(np.flatnonzero(~baseline.members)) >= {3, 4, 5, 20, 21}
    assert baseline.count >= 33
    assert baseline.spread == pytest.approx(0.01, rel=0.3)


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_promised():
    dice = np.random.default_rng(2)
    alarms = 0
    for _ in range(400):
        log = 0.01 * dice.standard_normal(60)
        alarms += discoveries(prediction_p(log, find_baseline(log)), 0.005).any()
    assert alarms < 8  # 2 expected


@pytest.mark.slow
def test_p_values_of_the_baseline_itself_are_uniform():
    dice = np.random.default_rng(3)
    p = np.concatenate([prediction_p(log, find_baseline(log, share=0.0)) for log in dice.standard_normal((400, 12))])
    assert np.quantile(p, [0.05, 0.5, 0.95]) == pytest.approx([0.05, 0.5, 0.95], abs=0.02)


@pytest.mark.slow
def test_the_prediction_interval_keeps_its_rate_where_welch_does_not():
    """Between-site spread 0.5 %, 10 repeats of 0.3 % each, p < 0.01: as computed for the paper's way of testing."""
    dice = np.random.default_rng(4)
    wrong = {"welch": 0, "prediction": 0}
    for _ in range(500):
        sites = 100e3 * (1 + 0.005 * dice.standard_normal(13))
        repeats = sites[:, None] * (1 + 0.003 * dice.standard_normal((13, 10)))
        wrong["welch"] += welch(repeats[0], repeats[1]).p < 0.01
        wrong["prediction"] += against_sites(repeats[1:].mean(axis=1), repeats[0].mean()).p < 0.01
    assert wrong["prediction"] < 14  # 5 expected
    assert wrong["welch"] > 125


def test_benjamini_and_hochberg_by_hand():
    p = np.array([0.001, 0.2, 0.012, 0.9, 0.02])
    assert discoveries(p, 0.05).tolist() == [True, False, True, False, True]
    assert not discoveries(np.array([0.04, 0.5]), 0.05).any()


def test_too_few_sites_say_nothing():
    assert against_sites(np.array([1.0, 1.01]), 5.0).p == 1.0
