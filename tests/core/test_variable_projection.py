"""The linear part of first guesses against a library's bounded least squares, and the search over the rest."""

import numpy as np
import pytest
from palpate_kit.numerics.variable_projection import best_place, linear_part
from scipy.optimize import lsq_linear


@pytest.mark.parametrize("seed", range(20))
def test_the_linear_part_is_the_least_within_bounds(seed):
    """Columns that differ by twelve powers of ten."""
    draw = np.random.default_rng(seed)
    matrix = draw.standard_normal((40, 3)) * [1e-6, 1.0, 1e6]
    target = draw.standard_normal(40)
    low, high = np.array([0.0, -np.inf, 0.0]), np.array([np.inf, 0.1, np.inf])
    found, scale = linear_part(matrix, target, low, high), np.linalg.norm(matrix, axis=0)
    expected = lsq_linear(matrix / scale, target, (low * scale, high * scale), tol=1e-14)
    assert found.squares == pytest.approx(2 * expected.cost, rel=1e-8)
    assert ((found.unknowns >= low) & (found.unknowns <= high)).all()


def test_columns_that_are_not_finite_leave_everything():
    assert linear_part(np.array([[1.0], [np.nan]]), np.ones(2)).squares == np.inf


@pytest.mark.parametrize("held", [False, True])
def test_the_search_ends_near_the_least_of_a_valley_between_its_places(held):
    ratio, height = 3.3e-7, 0.0 if held else 0.4321

    def squares(a, b, left):
        return np.log(a / ratio) ** 2 + 4 * (b - height) ** 2 + 0.5 * np.log(a / ratio) * (b - height)

    heights = np.zeros(1) if held else np.linspace(0.0, 1.0, 41)
    found = best_place(squares, np.geomspace(1e-12, 1e-2, 21), heights, held=held)
    assert found[0] == pytest.approx(ratio, rel=0.01)
    assert found[1] == pytest.approx(height, abs=5e-3)
