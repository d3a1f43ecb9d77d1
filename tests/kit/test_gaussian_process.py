"""The posterior of a Gaussian process against the joint normal distribution, and where its prior is wide."""

import numpy as np
import pytest
from palpate_kit.numerics.gaussian_process import GaussianProcess, matern_3_2, matern_5_2

PLACES = np.linspace(0.0, 1.0, 7)
NODES = np.array([0.1, 0.45, 2.0])
NOISE = 1e-2 * np.arange(1.0, 8.0)


def between(one, other, matern=matern_3_2):
    return 4.0 * matern(np.abs(one[:, None] - other), 0.3)


def posterior(matern):
    values = np.sin(5.0 * PLACES)
    process = GaussianProcess.of(between(PLACES, PLACES, matern), NOISE, values)
    return values, process


@pytest.mark.parametrize("matern", [matern_3_2, matern_5_2])
def test_mean_and_covariance_are_those_of_a_conditioned_normal(matern):
    values, process = posterior(matern)
    inverse = np.linalg.inv(between(PLACES, PLACES, matern) + np.diag(NOISE))
    cross, prior = between(PLACES, NODES, matern), between(NODES, NODES, matern)
    assert process.mean(cross) == pytest.approx(cross.T @ inverse @ values, rel=1e-9)
    assert process.covariance(prior, cross) == pytest.approx(prior - cross.T @ inverse @ cross, rel=1e-9)


def test_the_likelihood_is_that_of_a_normal_distribution():
    from scipy.stats import multivariate_normal

    values, process = posterior(matern_3_2)
    covariance = between(PLACES, PLACES) + np.diag(NOISE)
    constant = 0.5 * len(values) * np.log(2.0 * np.pi)
    expected = multivariate_normal(np.zeros(len(values)), covariance).logpdf(values)
    assert process.log_likelihood - constant == pytest.approx(expected, rel=1e-9)


def test_what_is_left_out_is_predicted_by_the_others():
    values, process = posterior(matern_5_2)
    others = np.arange(len(PLACES)) != 3
    rest = GaussianProcess.of(between(PLACES[others], PLACES[others], matern_5_2), NOISE[others], values[others])
    cross = between(PLACES[others], PLACES[3:4], matern_5_2)
    std = np.sqrt(rest.covariance(between(PLACES[3:4], PLACES[3:4], matern_5_2), cross)[0, 0] + NOISE[3])
    assert process.left_out()[3] == pytest.approx((values[3] - rest.mean(cross)[0]) / std, rel=1e-9)


def test_a_free_level_costs_no_digits_of_the_uncertainty():
    """A constant whose prior is 1e6 times the noise: the posterior variance is that of a mean, 1/n of the noise's."""
    noise, count = 1e-8, 25
    wide = np.full((count, count), 1e4 * noise * 1e6)
    process = GaussianProcess.of(wide, noise, np.full(count, 0.02))
    variance = process.covariance(wide[:1, :1], wide[:, :1])[0, 0]
    assert variance == pytest.approx(noise / count, rel=1e-5)
