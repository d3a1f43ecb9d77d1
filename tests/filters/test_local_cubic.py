"""Local cubics: a cubic is its own, and the numbers are scipy's, but for rounding."""

import numpy as np
import pytest
from palpate_kit.numerics.local_cubic import cubic_weights, local_cubic
from scipy import signal

WIDTHS = [5, 7, 15, 41]


@pytest.mark.parametrize("width", WIDTHS)
def test_a_cubic_is_its_own_and_so_is_its_slope(width):
    t = np.arange(60.0)
    values, slope = 1 - 2 * t + 0.3 * t**2 - 0.004 * t**3, -2 + 0.6 * t - 0.012 * t**2
    np.testing.assert_allclose(local_cubic(values, width), values, atol=1e-9)
    np.testing.assert_allclose(local_cubic(values, width, 1), slope, atol=1e-9)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("derivative", [0, 1])
def test_the_numbers_are_those_of_scipy_signal(width, derivative):
    values = np.random.default_rng(1).standard_normal(width + 50)
    expected = signal.savgol_coeffs(width, 3, deriv=derivative)
    np.testing.assert_allclose(cubic_weights(width, derivative), expected, rtol=1e-12, atol=1e-16)
    for n in (width, width + 1, width + 50):
        expected = signal.savgol_filter(values[:n], width, 3, deriv=derivative)
        np.testing.assert_allclose(local_cubic(values[:n], width, derivative), expected, rtol=1e-12, atol=1e-14)
