"""What repeats have in common does not average out."""

import numpy as np
import pytest
from palpate_kit.numerics.repeated_values import combined_of_mean, common_part, std_of_mean


def test_a_common_error_stays_however_many_repeats_there_are():
    """1 kPa in common and 0.5 kPa of scatter: 95 % of the means are within 1.96 of the combined uncertainty."""
    random, inside, stated = np.random.default_rng(1), 0, []
    for _ in range(400):
        values = 112.5e3 + 1e3 * random.standard_normal() + 500.0 * random.standard_normal(25)
        u = combined_of_mean(std_of_mean(values), np.full(25, 1e3))
        inside += abs(values.mean() - 112.5e3) < 1.96 * u
        stated.append(u)
    assert 366 <= inside <= 394  # of 400 at 95 %, exact binomial at 99.9 %
    assert np.mean(stated) == pytest.approx(np.hypot(1e3, 100.0), rel=0.02)


def test_runs_that_state_nothing_in_common_have_their_scatter():
    values = np.array([1.0, 2.0, 3.0])
    assert np.isnan(common_part(np.zeros(0)))
    assert combined_of_mean(std_of_mean(values), np.zeros(0)) == pytest.approx(1 / np.sqrt(3))
