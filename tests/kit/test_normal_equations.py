"""Standard errors of regressions against closed forms and draws, over units that differ by powers of ten."""

import numpy as np
import pytest
from palpate_kit.numerics.normal_equations import linear_regression, scaled_inverse, standard_errors

X = np.linspace(-1.0, 2.0, 40)


def test_a_line_has_the_standard_errors_of_the_textbook():
    noise = 0.1 * np.cos(np.arange(len(X)) ** 2.0)
    regression = linear_regression(np.column_stack([X, np.ones(len(X))]), 3.0 * X - 1.0 + noise)
    spread = float(np.sum((X - X.mean()) ** 2))
    assert regression.weights[0] == pytest.approx(np.sum((X - X.mean()) * (3.0 * X + noise)) / spread, rel=1e-12)
    assert regression.noise == pytest.approx(np.sqrt(np.sum(regression.residual**2) / (len(X) - 2)), rel=1e-12)
    assert regression.errors()[0] == pytest.approx(regression.noise / np.sqrt(spread), rel=1e-12)
    assert regression.errors(0.5)[0] == pytest.approx(0.5 / np.sqrt(spread), rel=1e-12)


def test_the_scatter_of_many_estimates_is_the_standard_error():
    random = np.random.default_rng(1)
    columns = np.column_stack([X, X**2, np.ones(len(X))])
    fits = [linear_regression(columns, random.normal(0.0, 0.2, len(X))) for _ in range(2000)]
    scatter = np.std([fit.weights for fit in fits], axis=0)
    assert scatter == pytest.approx(fits[0].errors(0.2), rel=0.05)
    assert np.mean([fit.noise**2 for fit in fits]) == pytest.approx(0.2**2, rel=0.02)


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e6])
def test_units_change_no_share_of_an_error(unit):
    columns = np.column_stack([X, unit * X**3, np.ones(len(X))])
    one, other = standard_errors(np.column_stack([X, X**3, np.ones(len(X))])), standard_errors(columns)
    assert other * [1.0, unit, 1.0] == pytest.approx(one, rel=1e-12)
    assert np.sqrt(np.diag(scaled_inverse(columns.T @ columns))) == pytest.approx(other, rel=1e-9)
    assert linear_regression(columns, X).errors(1.0) == pytest.approx(other, rel=1e-12)


def test_an_unknown_without_effect_has_no_error_and_leaves_the_others():
    columns = np.column_stack([X, np.zeros(len(X)), np.ones(len(X))])
    alone = standard_errors(columns[:, [0, 2]])
    assert standard_errors(columns) == pytest.approx([alone[0], 0.0, alone[1]], rel=1e-12)
    assert linear_regression(columns, 2.0 * X).weights == pytest.approx([2.0, 0.0, 0.0], abs=1e-12)
