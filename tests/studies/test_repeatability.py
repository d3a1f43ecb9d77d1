"""Statistics over many runs, against textbook numbers and scipy."""

import numpy as np
import pytest
from palpate_studies.repeatability import Repeatability, autocorrelation, moving_average, repeatability, welch_tests
from scipy.stats import pearsonr, ttest_ind

RANDOM = np.random.default_rng(0)


def test_autocorrelation_of_an_alternating_series():
    np.testing.assert_allclose(autocorrelation(np.tile([1.0, -1.0], 50), 3), [1.0, -0.99, 0.98, -0.97])


def test_autocorrelation_of_noise_stays_within_its_limits():
    found = Repeatability(RANDOM.standard_normal(4000)).table()
    inside = np.abs(found["autocorrelation"][1:]) < found["autocorrelation_95"]
    assert inside.mean() > 0.8


def test_moving_average_is_that_of_each_window():
    values = RANDOM.standard_normal(100)
    found = moving_average(values, 30)
    np.testing.assert_allclose(found, [values[i : i + 30].mean() for i in range(71)])
    assert not len(moving_average(values[:29], 30))


def test_std_of_mean_counts_correlation():
    kicks = RANDOM.standard_normal(100_000)
    values = np.empty_like(kicks)
    state = 0.0
    for i, kick in enumerate(kicks):
        values[i] = state = 0.6 * state + kick
    found = Repeatability(values)
    plain = values.std(ddof=1) / np.sqrt(len(values))
    assert found.std_of_mean / plain == pytest.approx(np.sqrt(1.6 / 0.4), rel=0.02)
    assert found.lag_one == pytest.approx(0.6, abs=0.02)


def test_trend_is_pearsons():
    values = RANDOM.standard_normal(40) + 0.03 * np.arange(40)
    expected = pearsonr(np.arange(40), values)
    assert Repeatability(values).trend == pytest.approx((expected.statistic, expected.pvalue))


@pytest.mark.parametrize("shift", [0.0, 1.0, 5.0])
def test_welch_is_scipys(shift):
    a, b = RANDOM.standard_normal(12), shift + 3 * RANDOM.standard_normal(30)
    (row,) = welch_tests({"a": a, "b": b})
    expected = ttest_ind(b, a, equal_var=False)
    found = (row["t"], row["p"], row["degrees_of_freedom"])
    assert found == pytest.approx((expected.statistic, expected.pvalue, expected.df))


def test_groups_without_scatter_have_no_test():
    (row,) = welch_tests({"a": np.full(5, 2.0), "b": np.full(5, 3.0)})
    assert np.isnan(row["p"])
    assert np.isnan(Repeatability(np.full(5, 2.0)).trend[0])


def test_the_order_of_the_groups_changes_nothing():
    values = {"b": [1.0, 2.0, 3.5], "a": [2.0, 2.5, 4.0]}
    assert str(repeatability(values)) == str(repeatability(dict(reversed(values.items()))))
