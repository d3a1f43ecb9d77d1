"""Groups compared by their units: against scipy and statsmodels, and what is said where there is no test."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError, LogError
from palpate_kit.numerics.group_comparison import compare_groups, holm
from palpate_kit.numerics.precision import repeat_correlation
from scipy.stats import f_oneway, ttest_ind, tukey_hsd


def draw(units, curves=6, between=1.0, within=0.5, seed=0, shift=0.0):
    """Values of groups by the counts of their units, each value with its unit; the k-th group is shifted k times."""
    random = np.random.default_rng(seed)
    found = {}
    for k, count in enumerate(units):
        means = k * shift + between * random.standard_normal(count)
        found[f"g{k:02d}"] = [
            (f"{k}.{i}", float(mean + within * noise))
            for i, mean in enumerate(means)
            for noise in random.standard_normal(curves)
        ]
    return found


def unit_means(values):
    names = list(dict.fromkeys(name for name, _ in values))
    return np.array([np.mean([value for one, value in values if one == name]) for name in names])


@pytest.mark.parametrize("units", [(3, 3), (4, 9), (5, 5, 6)])
def test_welch_is_scipys_of_the_means_of_units(units):
    groups = draw(units, shift=1.0)
    means = {name: unit_means(values) for name, values in groups.items()}
    for pair in compare_groups(groups, "animal").pairs:
        expected = ttest_ind(means[pair.second], means[pair.first], equal_var=False)
        interval = expected.confidence_interval(0.95)
        found = (pair.t, pair.freedom, pair.p, pair.low, pair.high)
        assert found == pytest.approx((expected.statistic, expected.df, expected.pvalue, interval.low, interval.high))


def test_curves_are_no_units():
    """Ten animals of forty curves without any effect: as single curves they differ beyond doubt in some draws."""
    by_curve, by_unit = [], []
    for seed in range(12):
        groups = draw((5, 5), 40, seed=seed)
        singles = {name: [(str(i), value) for i, (_, value) in enumerate(found)] for name, found in groups.items()}
        by_curve.append(compare_groups(singles, "curve").pairs[0].p)
        by_unit.append(compare_groups(groups, "animal").pairs[0].p)
    assert min(by_curve) < 1e-6
    assert sum(p < 0.05 for p in by_unit) <= 2


def test_scatter_between_and_within_units_is_found_again():
    scatter = compare_groups(draw((300, 300), 8, between=2.0, within=1.0), "animal").scatter
    assert (scatter.between, scatter.within) == pytest.approx((2.0, 1.0), rel=0.05)
    assert scatter.correlation == pytest.approx(0.8, abs=0.02)


def test_the_correlation_of_one_group_is_icc_1_1():
    (group,) = compare_groups(draw((6,)), "animal").groups
    expected = repeat_correlation(list(group.values.values()))
    assert group.scatter.correlation == pytest.approx(expected.value)


def test_single_values_scatter_between_alone():
    comparison = compare_groups(draw((4, 5), curves=1), "run")
    assert math.isnan(comparison.scatter.within)
    assert comparison.scatter.between == pytest.approx(
        math.sqrt(sum((len(g.means) - 1) * g.means.var(ddof=1) for g in comparison.groups) / 7)
    )


def test_below_three_units_there_is_no_p_value():
    comparison = compare_groups(draw((2, 4, 5)), "animal")
    assert [math.isnan(pair.p) for pair in comparison.pairs] == [True, True, False]
    assert comparison.pairs[2].corrected == comparison.pairs[2].p
    assert comparison.untested == "no p-value below 3 units (animal) in a group: g00 has 2"
    assert comparison.variance_analysis is None
    assert comparison.games_howell(comparison.pairs[2]) is None


def test_what_does_not_scatter_has_no_p_value():
    groups = {"a": [("1", 2.0), ("2", 2.0), ("3", 2.0)], "b": [("4", 3.0), ("5", 3.0), ("6", 3.0)]}
    comparison = compare_groups(groups, "animal")
    assert math.isnan(comparison.pairs[0].p)
    assert "nothing scatters" in comparison.untested


def test_many_groups_are_scipys():
    groups = draw((10, 11, 12), shift=0.6)
    comparison = compare_groups(groups, "animal")
    means = [unit_means(values) for values in groups.values()]
    whole = f_oneway(*means, equal_var=False)
    assert comparison.variance_analysis == pytest.approx((whole.statistic, whole.pvalue))
    howell = tukey_hsd(*means, equal_var=False).pvalue
    found = [comparison.games_howell(pair) for pair in comparison.pairs]
    assert found == pytest.approx([howell[0, 1], howell[0, 2], howell[1, 2]])
    assert not comparison.liberal
    assert compare_groups(draw((9, 12, 12)), "animal").liberal


def test_holm_is_statsmodels():
    multitest = pytest.importorskip("statsmodels.stats.multitest")
    p = np.random.default_rng(1).uniform(size=40) ** 3
    assert holm(p) == pytest.approx(multitest.multipletests(p, method="holm")[1])


def test_holm_counts_what_was_tested():
    assert holm([0.01, math.nan, 0.03])[::2] == pytest.approx([0.02, 0.03])
    assert holm([]) == []


def test_at_most_twenty_pairs_are_shown_those_of_the_smallest_p():
    comparison = compare_groups(draw([3] * 12, shift=0.3), "animal")
    shown = comparison.most_significant()
    assert len(comparison.pairs) == 66
    assert len(shown) == 20
    assert max(pair.p for pair in shown) <= min(pair.p for pair in comparison.pairs if pair not in shown)


@pytest.mark.slow
def test_a_mixed_model_of_equal_units_is_a_t_test_of_their_means():
    """With as many curves in each unit, t of the mixed model is Student's of the means, with units less groups."""
    pytest.importorskip("statsmodels")
    groups = draw((5, 5), shift=1.0)
    (pair,) = compare_groups(groups, "animal", mixed=True).pairs
    expected = ttest_ind(*(unit_means(values) for values in reversed(groups.values())))
    assert (pair.t, pair.freedom, pair.p) == pytest.approx((expected.statistic, 8.0, expected.pvalue), rel=1e-4)


@pytest.mark.slow
def test_a_mixed_model_of_unequal_units_is_statsmodels():
    formula = pytest.importorskip("statsmodels.formula.api")
    pandas = pytest.importorskip("pandas")
    groups = draw((4, 6), shift=1.0)
    groups["g01"] = groups["g01"][:-4]
    rows = [(name, unit, value) for name, values in groups.items() for unit, value in values]
    frame = pandas.DataFrame(rows, columns=["group", "unit", "value"])
    expected = formula.mixedlm("value ~ group", frame, groups=frame["unit"]).fit(reml=True)
    (pair,) = compare_groups(groups, "animal", mixed=True).pairs
    assert pair.difference == pytest.approx(expected.fe_params.iloc[1], rel=1e-4)
    assert pair.t == pytest.approx(expected.tvalues.iloc[1], rel=1e-3)


def test_a_mixed_model_needs_several_values_of_a_unit():
    with pytest.raises(ConfigurationError, match="--mixed: each unit"):
        compare_groups(draw((4, 4), curves=1), "animal", mixed=True)


def test_without_statsmodels_a_mixed_model_fails_by_name(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "statsmodels.regression.mixed_linear_model", None)
    with pytest.raises(ConfigurationError, match=r"--mixed needs statsmodels; pip install .*mixed"):
        compare_groups(draw((4, 4)), "animal", mixed=True)


@pytest.mark.slow
def test_a_mixed_model_at_its_bound_is_one_and_without_scatter_is_none():
    """With less scatter between units than curves explain, gradients do not converge; without any there is no model."""
    pytest.importorskip("statsmodels")
    alike = {name: [(f"{name}{u}", float(c)) for u in range(3) for c in range(3)] for name in "ab"}
    assert compare_groups(alike, "animal", mixed=True).pairs[0].p == 1.0
    flat = {name: [(f"{name}{u}", float(u)) for u in range(3) for c in range(3)] for name in "ab"}
    with pytest.raises(LogError, match="--mixed: the model cannot be fitted"):
        compare_groups(flat, "animal", mixed=True)


def test_a_sentence_says_which_test_and_of_what():
    assert compare_groups(draw((4, 5, 5)), "animal").sentence == (
        "The means of 14 units (animal) with 84 curves, 4 to 5 in each of 3 groups, were compared by Welch's t-test; "
        "p-values are two-sided and corrected for 3 pairs by Holm's method."
    )
    assert compare_groups(draw((4, 4), curves=1), "run").sentence == (
        "8 single runs, 4 in each of 2 groups, were compared by Welch's t-test."
    )
    assert compare_groups(draw((4,)), "animal").sentence == ""
    few = compare_groups(draw((2, 4)), "animal")
    assert few.sentence == f"6 units (animal), 2 to 4 in each of 2 groups, were not compared: {few.untested}."


def test_a_column_may_be_called_run():
    assert compare_groups(draw((4, 4)), "run").sentence.startswith("The means of 8 units (run) with 48 curves")


@pytest.mark.slow
@pytest.mark.parametrize(("groups", "units", "most"), [(2, 3, 0.06), (2, 10, 0.06), (3, 5, 0.07)])
def test_what_does_not_differ_is_rarely_found_to(groups, units, most):
    """A thousand draws without an effect; benchmarks/false_positives.py has all cases with two thousand."""
    found = 0
    for seed in range(1000):
        pairs = compare_groups(draw((units,) * groups, curves=3, seed=[56, seed]), "animal").pairs
        found += min(pair.corrected for pair in pairs) < 0.05
    assert found / 1000 <= most


@pytest.mark.slow
def test_games_and_howell_find_rarely_what_is_not_there_from_ten_units_on():
    found = 0
    for seed in range(500):
        comparison = compare_groups(draw((10,) * 3, curves=2, seed=[57, seed]), "animal")
        found += min(comparison.games_howell(pair) for pair in comparison.most_significant(1)) < 0.05
    assert found / 500 <= 0.07
