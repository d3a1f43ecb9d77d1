"""Cumulative sums: do they raise as few false alarms as they are designed to?"""

import numpy as np
import pytest
from palpate_maps.cusum import Cusum, run_length, slack, threshold


@pytest.mark.parametrize(
    ("k", "h", "length"), [(0.5, 4.0, 336.0), (0.5, 5.0, 930.0), (0.5, 3.0, 117.6), (1.0, 2.5, 715.0)]
)
def test_run_lengths_are_those_of_the_literature(k, h, length):
    """Twice the two-sided lengths 168, 465 and 58.8 of Montgomery, Statistical Quality Control, for k = 1/2."""
    assert run_length(k, h) == pytest.approx(length, rel=0.01)


@pytest.mark.parametrize("k", [0.5, 1.0, 2.0])
def test_run_length_and_threshold_belong_together(k):
    for rate in (0.1, 0.005):
        h = threshold(k, rate, 18)
        assert run_length(k, h) == pytest.approx(18 / rate, rel=0.02)
    lengths = [run_length(k, h) for h in (0.5, 1.0, 4.0, 11.9, 12.1, 40.0)]
    assert (np.diff(lengths) >= 0).all()


@pytest.mark.parametrize("std", [0.005, 0.02, 0.1])
def test_false_alarms_are_as_rare_as_designed(std):
    dice = np.random.default_rng(7)
    alarms, sweeps, blocks, rate = 0, 600, 18, 0.1
    for noise in std * dice.standard_normal((sweeps, blocks)):
        test = Cusum(rate, blocks, step=0.04)
        alarms += any(test.feed(value, std) is not None for value in noise.tolist())
    assert alarms / sweeps < 1.3 * rate
    assert alarms / sweeps > 0.3 * rate  # the design bounds the rate; much below it, sensitivity is given away


def test_a_change_is_found_soon_after_it_and_placed():
    noise = 0.01 * np.random.default_rng(1).standard_normal(30)
    noise[15:] += 0.08
    test = Cusum(0.005, 30, step=0.04)
    alarms = [alarm for value in noise.tolist() if (alarm := test.feed(value, 0.01)) is not None]
    assert [alarm.rising for alarm in alarms] == [True]
    assert alarms[0].since == 15
    assert alarms[0].at <= 16
    assert alarms[0].p < 0.005


def test_the_slack_is_half_of_the_change_within_limits():
    assert slack(4.0, 0.005, 18) == 2.0
    assert slack(0.1, 0.005, 18) == 0.5
    assert 3.0 <= slack(50.0, 0.005, 18) <= 3.6
    assert threshold(slack(50.0, 0.005, 18), 0.005, 18) > 0.01
