"""Tests directed at each alternative, the memory of residuals without a standstill, and corners of the motion."""

import numpy as np
import pytest
from palpate_uncertainty.alternative_fit import Refit
from palpate_uncertainty.channel_noise import WHITE, Null, null_of
from palpate_uncertainty.directed_tests import directed_tests
from palpate_uncertainty.refit import _quiet
from palpate_uncertainty.whiteness import whiteness_tests

N = 3000
TIME = np.arange(N) / 500.0
ONE_RUN = np.zeros(N, np.int64)
PATTERN = np.sin(2 * np.pi * 7.3 * TIME)


def refits(residual, columns):
    """A model that left a residual, and alternatives that fit one more column each."""

    def made(reason, left, extra):
        return Refit(reason, np.zeros(1), 0.0, np.zeros((1, 1)), left, extra)

    left = {name: residual - column * (residual @ column) / (column @ column) for name, column in columns.items()}
    return made("", residual, 0), [made(name, rest, 1) for name, rest in left.items()]


def p_of(residual, null=WHITE):
    base, others = refits(residual, {"pattern": PATTERN})
    return directed_tests(base, others, ONE_RUN, null)["pattern"].p


def filtered(seed, share):
    noise = np.random.default_rng(seed).standard_normal(N + 200)
    for i in range(1, len(noise)):
        noise[i] += share * noise[i - 1]
    return noise[200:]


@pytest.mark.slow
def test_noise_is_rejected_as_often_as_it_should_be():
    found = np.array([p_of(np.random.default_rng(seed).standard_normal(N)) for seed in range(300)])
    assert np.mean(found < 0.1) == pytest.approx(0.1, abs=0.055)  # three standard deviations of a binomial


def test_a_pattern_of_a_hundredth_of_the_noises_power_is_found_where_no_other_test_sees_it():
    noise = np.random.default_rng(3).standard_normal(N) + 0.16 * PATTERN
    assert p_of(noise) < 1e-4
    assert whiteness_tests(noise, ONE_RUN, TIME, None, WHITE).p > 1e-2


@pytest.mark.slow
def test_slow_noise_of_a_filtered_channel_is_no_pattern():
    found = [p_of(filtered(seed, 0.8), null_of(filtered(1000 + seed, 0.8)[:800])) for seed in range(40)]
    assert min(found) > 1e-3


def test_an_alternative_that_adds_nothing_is_not_tested():
    base, others = refits(np.random.default_rng(0).standard_normal(N), {"pattern": PATTERN})
    no_number = Refit("lift-off", np.zeros(1), 0.0, np.zeros((1, 1)), others[0].residual, 0)
    assert directed_tests(base, [no_number], ONE_RUN, WHITE) == {}


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.8])
def test_without_a_standstill_only_what_is_slower_than_a_channel_is_memory(share):
    residual = Null(np.zeros(0), 0, "residual")

    def memory(values):
        return whiteness_tests(values, ONE_RUN, TIME, None, residual).tests["memory"]

    noise = [filtered(seed, share) for seed in range(30)]
    assert min(memory(values) for values in noise) > 1e-3
    slow = 0.5 * noise[0].std() * np.sin(2 * np.pi * (1.3 * TIME + 0.2 * np.sin(TIME)))
    assert memory(noise[0] + slow) < 1e-6


def test_smoothing_says_where_it_bends_a_corner():
    """A rate that jumps from 0 to 12 mm/s in the middle, with the noise of a robot's."""
    rate = np.where(TIME < 3.0, 0.0, 12e-3) + 0.67e-3 * np.random.default_rng(1).standard_normal(N)
    _, _, corners = _quiet(rate, ONE_RUN)
    bent = TIME[corners]
    assert 3.0 in np.round(bent, 3)
    assert np.all(np.abs(bent - 3.0) < 0.2)
    smooth = 12e-3 * np.sin(2 * np.pi * TIME) + 0.67e-3 * np.random.default_rng(1).standard_normal(N)
    assert not _quiet(smooth, ONE_RUN)[2].any()
