"""The null of the lack-of-fit tests: noise as an autoregression, against noise whose law is known."""

import numpy as np
import pytest
from palpate_fits.uncertainty import mean_uncertainty
from palpate_uncertainty.channel_noise import null_of
from scipy.signal import lfilter

ONE_RUN = 20_000


def autoregression(coefficients, seed, n=ONE_RUN, std=0.05):
    white = std * np.random.default_rng(seed).standard_normal(n + 500)
    return lfilter([1.0], [1.0, *(-c for c in coefficients)], white)[500:]


@pytest.mark.parametrize("coefficients", [(0.6,), (1.2, -0.5), (0.5, -0.4, 0.3)])
def test_coefficients_are_found_and_what_is_left_is_white(coefficients):
    noise = autoregression(coefficients, 5)
    null = null_of(noise)
    assert len(null.coefficients) == len(coefficients)
    assert null.coefficients == pytest.approx(coefficients, abs=4 / np.sqrt(ONE_RUN))
    white, known = null.whitened(noise, np.zeros(ONE_RUN, np.int64))
    left = white[known]
    assert left.std() == pytest.approx(0.05, rel=0.03)
    for lag in range(1, 8):
        assert abs(np.corrcoef(left[lag:], left[:-lag])[0, 1]) < 4 / np.sqrt(ONE_RUN)


@pytest.mark.parametrize("n", [400, ONE_RUN])
def test_what_is_not_known_of_the_coefficient_is_allowed_for(n):
    """Of one coefficient c the standard error is sqrt((1 - c^2)/n)."""
    noise = autoregression((0.8,), 3, n)
    null = null_of(noise)
    (c,) = null.coefficients
    assert null.excess == pytest.approx(((1 - c + 2.5 * np.sqrt((1 - c**2) / n)) / (1 - c)) ** 2, rel=0.03)
    assert null_of(1e-9 * noise).excess == pytest.approx(null.excess, rel=1e-9)  # of any unit


def test_a_gap_takes_the_samples_after_it():
    noise = autoregression((1.2, -0.5), 8, 1000)
    runs = np.repeat([0, 1], 500)
    known = null_of(noise).whitened(noise, runs)[1]
    assert np.flatnonzero(~known).tolist() == [0, 1, 500, 501]


@pytest.mark.slow
@pytest.mark.parametrize(("coefficient", "n"), [(0.0, 500), (0.7, 500), (0.9, 4000)])
def test_the_mean_of_correlated_readings_is_as_uncertain_as_it_scatters(coefficient, n):
    """Over 400 records; the long-run std of an autoregression is s/(1 - c)."""
    found = [mean_uncertainty(autoregression((coefficient,), seed, n)) for seed in range(400)]
    truth = 0.05 / (1 - coefficient) / np.sqrt(n)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(truth, rel=0.04)
