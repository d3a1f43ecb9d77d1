"""Statistics over many runs, against textbook numbers and scipy."""

import numpy as np
import pytest
from palpate_studies.repeat_figure import draw_repeatability
from palpate_studies.repeatability import (
    Repeatability,
    against_truth,
    autocorrelation,
    moving_average,
    repeatability,
    welch_tests,
)
from scipy.stats import pearsonr, ttest_ind

RANDOM = np.random.default_rng(0)


def test_autocorrelation_of_an_alternating_series():
    np.testing.assert_allclose(autocorrelation(np.tile([1.0, -1.0], 50), 3), [1.0, -0.99, 0.98, -0.97])


def test_autocorrelation_of_noise_stays_within_its_limits():
    found = Repeatability(RANDOM.standard_normal(4000)).table(np.zeros(0))
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


GROUPS = {
    "fast": (5.0 + 0.1 * RANDOM.standard_normal(8)).tolist(),
    "slow": (5.4 + 0.3 * RANDOM.standard_normal(12)).tolist(),
}


def test_groups_share_their_bins_and_lose_nothing():
    found = repeatability(GROUPS)["groups"]
    fast, slow = found["fast"]["histogram"], found["slow"]["histogram"]
    assert fast["edges"] == slow["edges"]
    assert (sum(fast["counts"]), sum(slow["counts"])) == (8, 12)


def test_few_runs_have_a_moving_average_too():
    found = repeatability(GROUPS)["groups"]["slow"]
    assert found["moving_average_window"] == 4
    assert found["moving_average"] == pytest.approx(moving_average(np.array(GROUPS["slow"]), 4))
    assert Repeatability(np.zeros(200)).window == 30


def test_a_difference_says_which_is_taken_from_which():
    (row,) = repeatability(GROUPS)["tests"]
    assert row["difference_is"] == "slow - fast"
    assert row["difference"] == pytest.approx(np.mean(GROUPS["slow"]) - np.mean(GROUPS["fast"]))


@pytest.mark.slow
def test_the_picture_has_three_panels_with_both_limits(monkeypatch, tmp_path):
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    draw_repeatability({"parameter": "elasticity", "unit": "Pa", **repeatability(GROUPS)}, tmp_path / "r.png")
    histogram, correlation, average = drawn[0].axes
    edges = [sorted({round(patch.get_x(), 9) for patch in group}) for group in histogram.containers]
    assert edges[0] == edges[1]
    for limit in (1.96 / np.sqrt(8), 1.96 / np.sqrt(12)):
        for side in (-limit, limit):
            assert any(np.allclose(line.get_ydata(), side) for line in correlation.lines)
    for name, values in GROUPS.items():
        (line,) = [line for line in average.lines if line.get_label() == name]
        assert len(line.get_ydata()) == len(values) - len(values) // 3 + 1


@pytest.mark.slow
def test_three_groups_of_unequal_spread_are_tested_by_welch_and_games_howell():
    random = np.random.default_rng(3)
    groups = {"a": random.normal(0, 1, 12), "b": random.normal(0, 5, 30), "c": random.normal(3, 1, 12)}
    found = repeatability(groups)["anova"]
    # Welch 1951, by hand
    w = np.array([len(v) / v.var(ddof=1) for v in groups.values()])
    means = np.array([v.mean() for v in groups.values()])
    grand, k = (w @ means) / w.sum(), 3
    rest = sum((1 - x / w.sum()) ** 2 / (len(v) - 1) for x, v in zip(w, groups.values()))
    expected = (w @ (means - grand) ** 2 / (k - 1)) / (1 + 2 * (k - 2) / (k**2 - 1) * rest)
    assert found["f"] == pytest.approx(expected)
    assert [(row["first"], row["second"]) for row in found["pairs"]] == [("a", "b"), ("a", "c"), ("b", "c")]
    assert found["pairs"][1]["p"] < 1e-4 < found["pairs"][0]["p"]
    assert repeatability({"a": groups["a"], "b": groups["b"]})["anova"] is None


def test_the_error_against_a_truth_has_what_does_not_average_out():
    values = np.array([113e3, 114e3, 112e3, 113.5e3])
    found = against_truth(values, np.full(4, 2e3), 112.5e3)
    assert found["error"] == pytest.approx(values.mean() / 112.5e3 - 1)
    assert found["by_scatter"] < found["error_std"]
    assert found["error_std"] == pytest.approx(np.hypot(found["by_scatter"], 2e3 / 112.5e3))
