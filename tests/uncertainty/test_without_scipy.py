"""Small parts that stand for those of scipy: the same numbers."""

import math

import numpy as np
import pytest
from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.outliers import _running_median
from palpate_uncertainty.whiteness import _powers, _sine
from scipy.ndimage import median_filter
from scipy.special import chdtrc


@pytest.mark.parametrize("freedom", [1, 2, 3, 7, 20, 32, 50, 79])
def test_the_tail_of_a_chi_square_is_that_of_scipy(freedom):
    for value in [0.0, 1e-300, 1e-8, *np.geomspace(0.01, 1200.0, 60)]:
        assert chance_of_more(freedom, value) == pytest.approx(float(chdtrc(freedom, value)), rel=1e-12, abs=1e-290)
    assert chance_of_more(freedom, math.inf) == 0.0
    assert math.isnan(chance_of_more(freedom, math.nan))


@pytest.mark.parametrize("n", [5, 100, 70_000])
def test_a_running_median_is_that_of_scipy_to_the_bit(n):
    values = np.random.default_rng(n).standard_normal(n)
    np.testing.assert_array_equal(_running_median(values), median_filter(values, 11, mode="nearest"))


def test_the_power_of_many_lines_is_that_of_each():
    time = np.linspace(0.0, 4.0, 3000)
    level = np.sin(2 * np.pi * 1.9 * time + 0.4) + 0.1 * np.random.default_rng(1).standard_normal(len(time))
    lines = np.linspace(1.0, 3.0, 41)
    expected = [_sine(time, level, line)[0] for line in lines]
    np.testing.assert_allclose(_powers(time, level, lines), expected, rtol=1e-9)
