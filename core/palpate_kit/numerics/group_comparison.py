"""Groups compared by their units of replication: means, scatter between and within units, and corrected p-values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from palpate import ConfigurationError

from palpate_kit.numerics.mixed_model import mixed_differences
from palpate_kit.numerics.unit_group import UnitGroup, UnitScatter, scatters

FEWEST = 3  # units of a group for a p-value (0390)
_LIBERAL = 10  # units of each group below which Games and Howell's test finds too many differences
SHOWN = 20  # pairs of a printed table: a choice
_CONFIDENCE = 0.95  # of the interval of a difference
CURVE, RUN = "curve", "run"  # units that are single values
CAUTIONS = {  # of tests between single values
    RUN: "p is the chance of such a difference between repeats at one site each. Sites of one material differ, too: "
    "before a difference is called a lump, compare it with the spread over a dozen baseline sites.",
    CURVE: "Each curve is compared as if it were of a specimen of its own; curves of one animal or sample are not, and "
    "differ less from each other. Enter in curves.csv of which each is, by names that differ from group to group.",
}


@dataclass(frozen=True)
class PairTest:
    """The difference [SI] of the means of two groups, second less first; NaN where it was not tested."""

    first: str
    second: str
    difference: float
    low: float  # interval of 95 % of this difference alone
    high: float
    t: float
    freedom: float
    p: float
    corrected: float  # by Holm's method, for all pairs that were tested

    @property
    def difference_is(self) -> str:
        """Name of the difference: which mean is subtracted from which."""
        return f"{self.second} - {self.first}"


@dataclass(frozen=True)
class GroupComparison:
    """Groups compared by the means of their units.

    The test is Welch's; with `mixed` t of the linear model with a random intercept for each unit, whose degrees of
    freedom are units less groups. P-values of several pairs are corrected by Holm's method.
    """

    unit: str  # column that names the units; `curve` or `run` where each value is one
    groups: tuple[UnitGroup, ...]
    pairs: tuple[PairTest, ...]
    mixed: bool = False

    @property
    def units(self) -> int:
        """Number of units in all groups."""
        return sum(group.units for group in self.groups)

    @property
    def curves(self) -> int:
        """Number of values in all groups."""
        return sum(group.curves for group in self.groups)

    @property
    def singles(self) -> bool:
        """True if each value is a unit by itself, and no column says of which it is."""
        return self.unit in (CURVE, RUN) and self.units == self.curves

    @property
    def tests(self) -> int:
        """Number of pairs that were tested."""
        return sum(math.isfinite(pair.p) for pair in self.pairs)

    @cached_property
    def scatter(self) -> UnitScatter:
        """Between and within units, of all groups together."""
        return UnitScatter.of(self.groups)

    @property
    def untested(self) -> str:
        """Reason why some pairs have no p-value; "" where all have one."""
        small_groups = [f"{group.name} has {group.units}" for group in self.groups if group.units < FEWEST]
        if len(self.groups) > 1 and small_groups:
            more = f" and {len(small_groups) - SHOWN} groups more" if len(small_groups) > SHOWN else ""
            return f"no p-value below {FEWEST} units ({self.unit}) in a group: {', '.join(small_groups[:SHOWN])}{more}"
        return "no p-value where nothing scatters" if self.tests < len(self.pairs) else ""

    @cached_property
    def variance_analysis(self) -> tuple[float, float] | None:
        """F and p of Welch's analysis of variance; None for fewer than three groups, one without a test, or a model.

        Source: Welch 1951.
        """
        from scipy.stats import f_oneway

        if not self._several:
            return None
        whole = f_oneway(*(group.means for group in self.groups), equal_var=False)
        return float(whole.statistic), float(whole.pvalue)

    def games_howell(self, pair: PairTest) -> float | None:
        """Return the p-value of a pair by Games and Howell's test; None where the analysis of variance is.

        Source: Games and Howell 1976.
        """
        from scipy.stats import studentized_range

        if not self._several:
            return None
        return float(studentized_range.sf(math.sqrt(2.0) * abs(pair.t), len(self.groups), pair.freedom))

    @property
    def liberal(self) -> bool:
        """True if Games and Howell's test finds too many differences, since a group has fewer than ten units."""
        return any(group.units < _LIBERAL for group in self.groups)

    @property
    def _several(self) -> bool:
        testable = all(group.units >= FEWEST and scatters(group.means) for group in self.groups)
        return len(self.groups) > 2 and testable and not self.mixed

    def most_significant(self, count: int = SHOWN) -> list[PairTest]:
        """Return at most so many pairs, those of the smallest p-values, in their order."""
        rank = sorted(range(len(self.pairs)), key=lambda i: (math.isnan(self.pairs[i].p), self.pairs[i].p, i))
        return [self.pairs[i] for i in sorted(rank[:count])]

    @property
    def sentence(self) -> str:
        """Sentence on the test that was made, as a methods section says it; "" for a single group."""
        if len(self.groups) < 2:
            return ""
        counts = f"{self.curves} single {self.unit}s" if self.singles else f"{self.units} units ({self.unit})"
        ranges = f"{_range(group.units for group in self.groups)} in each of {len(self.groups)} groups"
        if not self.tests:
            return f"{counts[0].upper()}{counts[1:]}, {ranges}, were not compared: {self.untested}."
        if self.mixed:
            freedom = self.units - len(self.groups)
            test = (
                f"{self.curves} curves of {counts}, {ranges}, were compared by a linear mixed model with a random "
                f"intercept for each {self.unit} (restricted maximum likelihood); t has {freedom} degrees of freedom, "
                "units less groups"
            )
        else:
            compared = counts if self.singles else f"The means of {counts} with {self.curves} curves"
            test = f"{compared}, {ranges}, were compared by Welch's t-test"
        if self.tests > 1:
            test += f"; p-values are two-sided and corrected for {self.tests} pairs by Holm's method"
        return f"{test}."

    def table(self) -> dict[str, Any]:
        """Return everything but the groups, as plain data [SI]."""
        shown = set(self.most_significant())  # the others would take minutes
        whole, scatter = self.variance_analysis, self.scatter
        return {
            "replication": {
                "unit": self.unit, "units": self.units, "curves": self.curves, "between": scatter.between,
                "within": scatter.within, "icc": scatter.correlation, "singles": self.singles,
            },
            "test": "mixed" if self.mixed else "welch",
            "sentence": self.sentence,
            "untested": self.untested,
            "anova": None if whole is None else {"f": whole[0], "p": whole[1]},
            "games_howell_is_liberal": self.liberal if whole else None,
            "tests": [
                {
                    "first": pair.first, "second": pair.second, "difference_is": pair.difference_is,
                    "difference": pair.difference, "low": pair.low, "high": pair.high, "t": pair.t,
                    "degrees_of_freedom": pair.freedom, "p": pair.p, "p_corrected": pair.corrected,
                    "p_games_howell": self.games_howell(pair) if pair in shown else None,
                }
                for pair in self.pairs
            ],
        }  # fmt: skip


def _range(counts: Iterable[int]) -> str:
    """Return the range of some counts, "3 to 5", or the only one."""
    sizes = sorted(set(counts))
    return str(sizes[0]) if len(sizes) == 1 else f"{sizes[0]} to {sizes[-1]}"


def compare_groups(
    groups: Mapping[str, Iterable[tuple[str, float]]], unit: str, mixed: bool = False
) -> GroupComparison:
    """Return the comparison of groups of values [SI], each value with the name of its unit of replication.

    By Welch's tests of the means of units, or by one `mixed` model; p is corrected for the number of tests (Holm).
    `unit` is the word for a unit, as "specimen". Raises ConfigurationError where a mixed model is asked for and no unit
    has two values, or without statsmodels.
    """
    unit_groups = [_unit_group(name, values) for name, values in groups.items()]
    if mixed and all(group.units == group.curves for group in unit_groups):
        raise ConfigurationError(f"--mixed: each unit ({unit}) has one value; Welch's test of the units needs no model")
    # The mixed model is one fit for all groups that have units enough.
    testable = [group for group in unit_groups if group.units >= FEWEST]
    by_model = mixed_differences({group.name: group.values for group in testable}) if mixed and testable[1:] else {}
    pairs: list[tuple[tuple[str, str], _Numbers]] = []
    for first, second in combinations(unit_groups, 2):
        numbers = by_model.get((first.name, second.name)) if mixed else _welch(first, second)
        pairs.append(_pair(first, second, numbers))
    # The corrected p of a pair depends on how many were tested; the last of a pair's numbers is its p.
    corrected = holm([numbers[-1] for _, numbers in pairs])
    tests = (PairTest(*names, *numbers, p) for (names, numbers), p in zip(pairs, corrected))
    return GroupComparison(unit, tuple(unit_groups), tuple(tests), mixed)


def _unit_group(name: str, values: Iterable[tuple[str, float]]) -> UnitGroup:
    """Return the group of values [SI], each with the name of its unit."""
    values_of_unit: dict[str, list[float]] = {}
    for unit, value in values:
        values_of_unit.setdefault(unit, []).append(value)
    return UnitGroup(name, {unit: np.array(numbers) for unit, numbers in values_of_unit.items()})


_Numbers = tuple[float, float, float, float, float, float]  # difference, its interval, t, degrees of freedom, p


def _pair(a: UnitGroup, b: UnitGroup, numbers: _Numbers | None) -> tuple[tuple[str, str], _Numbers]:
    """Return the names of a pair with its numbers; without a test the difference alone, and NaN."""
    none = math.nan
    return (a.name, b.name), numbers or (b.mean - a.mean, none, none, none, none, none)


def _welch(a: UnitGroup, b: UnitGroup) -> _Numbers | None:
    """Return Welch's t-test of b against a; None where it is not made."""
    from scipy.stats import ttest_ind

    if min(a.units, b.units) < FEWEST or not (scatters(a.means) or scatters(b.means)):
        return None
    test: Any = ttest_ind(b.means, a.means, equal_var=False)
    low, high = test.confidence_interval(_CONFIDENCE)
    return b.mean - a.mean, float(low), float(high), float(test.statistic), float(test.df), float(test.pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected for their number by Holm's method; NaN are not tests, and remain. Source: Holm 1979.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    p = np.array(p_values, float)
    order = np.argsort(p)[: int(np.isfinite(p).sum())]  # NaN come last
    p[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1)), 1.0)
    return [float(value) for value in p]
