"""Statistics over many runs, against textbook numbers and scipy."""

import numpy as np
import pytest
from palpate_kit.numerics.repeated_values import autocorrelation
from palpate_studies.repeat_figure import draw_repeatability
from palpate_studies.repeatability import (
    Repeatability,
    error_of_mean,
    moving_average,
    repeatability,
)
from scipy.stats import pearsonr

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


def test_what_does_not_scatter_has_no_trend():
    assert np.isnan(Repeatability(np.full(5, 2.0)).trend[0])


def test_the_order_of_the_groups_changes_nothing():
    values = {"b": [1.0, 2.0, 3.5], "a": [2.0, 2.5, 4.0]}
    assert str(repeatability(values)) == str(repeatability(dict(reversed(values.items()))))


GROUPS = {
    "fast": (5.0 + 0.1 * RANDOM.standard_normal(8)).tolist(),
    "slow": (5.4 + 0.3 * RANDOM.standard_normal(12)).tolist(),
}


def test_groups_share_their_bins_and_lose_nothing():
    found = repeatability(GROUPS)
    fast, slow = found["fast"]["histogram"], found["slow"]["histogram"]
    assert fast["edges"] == slow["edges"]
    assert (sum(fast["counts"]), sum(slow["counts"])) == (8, 12)


def test_few_runs_have_a_moving_average_too():
    found = repeatability(GROUPS)["slow"]
    assert found["moving_average_window"] == 4
    assert found["moving_average"] == pytest.approx(moving_average(np.array(GROUPS["slow"]), 4))
    assert Repeatability(np.zeros(200)).window == 30


@pytest.mark.slow
def test_the_picture_has_three_panels_with_both_limits(monkeypatch, tmp_path):
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: drawn.append(self))
    draw_repeatability({"parameter": "elasticity", "unit": "Pa", "groups": repeatability(GROUPS)}, tmp_path / "r.png")
    histogram, correlation, average = drawn[0].axes
    edges = [sorted({round(patch.get_x(), 9) for patch in group}) for group in histogram.containers]
    assert edges[0] == edges[1]
    for limit in (1.96 / np.sqrt(8), 1.96 / np.sqrt(12)):
        for side in (-limit, limit):
            assert any(np.allclose(line.get_ydata(), side) for line in correlation.lines)
    for name, values in GROUPS.items():
        (line,) = [line for line in average.lines if line.get_label() == name]
        assert len(line.get_ydata()) == len(values) - len(values) // 3 + 1


def test_the_error_against_a_truth_has_what_does_not_average_out():
    values = np.array([113e3, 114e3, 112e3, 113.5e3])
    runs = Repeatability(values)
    found = error_of_mean(runs.mean, runs.std_of_mean, np.full(4, 2e3), 112.5e3)
    assert found["error"] == pytest.approx(values.mean() / 112.5e3 - 1)
    assert found["by_scatter"] < found["error_std"]
    assert found["error_std"] == pytest.approx(np.hypot(found["by_scatter"], 2e3 / 112.5e3))
