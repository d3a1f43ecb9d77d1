"""Bounded least squares from normal equations, against scipy's."""

import numpy as np
import pytest
from palpate_kit.numerics.least_squares import bounded_quadratic, least_squares
from palpate_kit.numerics.normal_equations import symmetric_inverse
from scipy import optimize


@pytest.mark.parametrize("seed", range(40))
def test_a_bounded_quadratic_is_as_low_as_that_of_scipy(seed):
    random = np.random.default_rng(seed)
    p = int(random.integers(1, 7))
    columns, target = random.standard_normal((20, p)), random.standard_normal(20)
    if seed % 3 == 0 and p > 1:
        columns[:, 1] = columns[:, 0] + 1e-3 * columns[:, 1]
    low = -np.abs(random.standard_normal(p)) * random.choice([0.05, 1.0, 1e9], p)
    high = np.abs(random.standard_normal(p)) * random.choice([0.05, 1.0, 1e9], p)
    low[::4] = 0.0
    found = bounded_quadratic(columns.T @ columns, -columns.T @ target, low, high)
    assert np.all((low <= found) & (found <= high))
    expected = optimize.lsq_linear(columns, target, (low, high), method="bvls").x
    costs = [float(np.sum((columns @ x - target) ** 2)) for x in (found, expected)]
    assert costs[0] <= costs[1] * (1 + 1e-9)


def decay(noise, n=300, seed=0):
    """Normal equations of a e^(-b t) + c, and its residual."""
    time = np.linspace(0.0, 4.0, n)
    reading = 2.0 * np.exp(-1.3 * time) + 0.4 + noise * np.random.default_rng(seed).standard_normal(n)

    def residual(x):
        return x[0] * np.exp(-x[1] * time) + x[2] - reading

    def normal(x):
        with np.errstate(over="ignore", invalid="ignore"):
            return squares(x)

    def squares(x):
        fall = np.exp(-x[1] * time)
        both = np.column_stack([residual(x), fall, -x[0] * time * fall, np.ones(n)])
        return both.T @ both

    return normal, residual


FREE = np.full(3, np.inf)


@pytest.mark.parametrize("start", [(1.0, 1.0, 0.0), (10.0, 0.1, -3.0), (0.5, 3.0, 2.0)], ids=str)
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_minimum_is_that_of_scipy(start, noise):
    normal, residual = decay(noise)
    found = least_squares(normal, np.array(start), -FREE, FREE)
    assert found.converged
    near = optimize.least_squares(residual, (2.0, 1.3, 0.4), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    sigma = 1e-4 if not noise else noise * np.sqrt(np.diag(np.linalg.inv(normal(found.x)[1:, 1:])))
    assert np.all(np.abs(found.x - near.x) < 1e-6 * sigma)  # as near as scipy's differences come
    slope = normal(found.x)[1:, 0]
    assert np.all(np.abs(np.linalg.solve(normal(found.x)[1:, 1:], slope)) < 1e-9 * sigma)


def test_bounds_hold_and_are_reached():
    normal, residual = decay(0.02)
    low, high = np.array([0.0, 0.0, 0.45]), np.array([1.9, 10.0, 1.0])
    found = least_squares(normal, np.array([1.0, 1.0, 0.6]), low, high)
    expected = optimize.least_squares(residual, (1.0, 1.0, 0.6), bounds=(low, high), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert found.converged
    assert found.x[0] == 1.9
    assert found.x[2] == 0.45
    assert found.cost <= expected.cost * (1 + 1e-9)


def test_an_unknown_without_effect_stays_where_it_is():
    def normal(x):
        both = np.column_stack([x[0] - np.arange(5.0), np.ones(5), np.zeros(5)])
        return both.T @ both

    found = least_squares(normal, np.array([7.0, 3.0]), -FREE[:2], FREE[:2])
    assert found.converged
    np.testing.assert_allclose(found.x, (2.0, 3.0), atol=1e-12)


def test_what_is_not_finite_is_no_minimum():
    assert not least_squares(lambda x: np.full((2, 2), np.nan), np.zeros(1), -FREE[:1], FREE[:1]).converged


@pytest.mark.parametrize("apart", [1.0, 1e-1, 1e-3, 1e-5, 0.0])
def test_an_inverse_in_plain_numbers_and_a_pseudo_inverse_are_one(apart):
    columns = np.random.default_rng(3).standard_normal((50, 4))
    columns[:, 3] = columns[:, 2] + apart * columns[:, 3]
    columns /= np.sqrt((columns**2).sum(axis=0))
    square = columns.T @ columns
    assert symmetric_inverse(square, 1e-14) == pytest.approx(np.linalg.pinv(square, 1e-14, hermitian=True), rel=1e-5)
