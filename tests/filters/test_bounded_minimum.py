"""What stands for small parts of scipy: the same steps, and the same numbers but for rounding."""

import numpy as np
import pytest
from palpate_filters.bounded_minimum import bounded_minimum
from palpate_filters.starting_fit import BiasPrior, _misfit
from scipy.optimize import minimize_scalar, nnls


@pytest.mark.parametrize("seed", range(30))
def test_the_search_takes_the_steps_of_scipy(seed):
    random = np.random.default_rng(seed)
    a, b, c = random.standard_normal(3)
    low, high = sorted(3 * random.standard_normal(2))
    calls = {"ours": [], "scipy": []}

    def function(x, name):
        calls[name].append(x)
        return float((x - a) ** 4 + 0.3 * abs(x - b) + 0.2 * np.sin(3 * x + c))

    x, value = bounded_minimum(lambda x: function(x, "ours"), low, high, 1e-8)
    expected = minimize_scalar(function, args=("scipy",), bounds=(low, high), method="bounded", options={"xatol": 1e-8})
    assert (x, value) == (expected.x, expected.fun)
    assert calls["ours"] == calls["scipy"]


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("prior", [None, BiasPrior(0.2, 0.05)], ids=["alone", "bias"])
def test_parameters_are_those_of_non_negative_least_squares(columns, prior):
    for seed in range(50):
        random = np.random.default_rng(seed)
        matrix = np.abs(random.standard_normal((60, columns)))
        force = matrix @ random.standard_normal(columns) + 0.05 * random.standard_normal(60) + 0.1
        left, theta, bias = _misfit(matrix, force, prior)
        if prior is None:
            expected, residual = nnls(matrix, force)
            signs = (0.0, 0.0)
        else:
            ones, pull = np.ones((60, 1)), prior.noise / prior.std
            whole = np.vstack([np.hstack([matrix, ones, -ones]), [[0.0] * columns + [pull, -pull]]])
            found, residual = nnls(whole, np.append(force, 0.0))
            expected, signs = found[:columns], found[columns:]
        assert np.all(theta >= 0)
        np.testing.assert_allclose(theta, expected, atol=1e-10)  # of which a start keeps 24 bits, 6e-8
        assert bias == pytest.approx(signs[0] - signs[1], abs=1e-10)
        assert left == pytest.approx(residual**2, rel=1e-10)
