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

FEWEST = 3  # units of a group for a p-value
_LIBERAL = 10  # units of each group below which Games and Howell's test finds too many differences
SHOWN = 20  # pairs of a printed table
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
        """Which is subtracted from which."""
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
        """How many units there are in all groups."""
        return sum(group.units for group in self.groups)

    @property
    def curves(self) -> int:
        """How many values there are in all groups."""
        return sum(group.curves for group in self.groups)

    @property
    def singles(self) -> bool:
        """True if each value is a unit by itself, and no column says of which it is."""
        return self.unit in (CURVE, RUN) and self.units == self.curves

    @property
    def tests(self) -> int:
        """How many pairs were tested."""
        return sum(math.isfinite(pair.p) for pair in self.pairs)

    @cached_property
    def scatter(self) -> UnitScatter:
        """Between and within units, of all groups together."""
        return UnitScatter.of(self.groups)

    @property
    def untested(self) -> str:
        """Why some pairs have no p-value; "" where all have one."""
        few = [f"{group.name} has {group.units}" for group in self.groups if group.units < FEWEST]
        if len(self.groups) > 1 and few:
            more = f" and {len(few) - SHOWN} groups more" if len(few) > SHOWN else ""
            return f"no p-value below {FEWEST} units ({self.unit}) in a group: {', '.join(few[:SHOWN])}{more}"
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
        """At most so many pairs, those of the smallest p-values, in their order."""
        rank = sorted(range(len(self.pairs)), key=lambda i: (math.isnan(self.pairs[i].p), self.pairs[i].p, i))
        return [self.pairs[i] for i in sorted(rank[:count])]

    @property
    def sentence(self) -> str:
        """Which test was made of what, as a methods section says it; "" for a single group."""
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
            of = counts if self.singles else f"The means of {counts} with {self.curves} curves"
            test = f"{of}, {ranges}, were compared by Welch's t-test"
        if self.tests > 1:
            test += f"; p-values are two-sided and corrected for {self.tests} pairs by Holm's method"
        return f"{test}."

    def table(self) -> dict[str, Any]:
        """Everything but the groups, as plain data [SI]."""
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
    known = sorted(set(counts))
    return str(known[0]) if len(known) == 1 else f"{known[0]} to {known[-1]}"


def compare_groups(
    groups: Mapping[str, Iterable[tuple[str, float]]], unit: str, mixed: bool = False
) -> GroupComparison:
    """Groups of values [SI], each value with the name of its unit of replication, compared by the units.

    Raises ConfigurationError where a mixed model is asked for and no unit has two values, or without statsmodels.
    """
    found = []
    for name, values in groups.items():
        of_unit: dict[str, list[float]] = {}
        for one, value in values:
            of_unit.setdefault(one, []).append(value)
        found.append(UnitGroup(name, {one: np.array(numbers) for one, numbers in of_unit.items()}))
    if mixed and all(group.units == group.curves for group in found):
        raise ConfigurationError(f"--mixed: each unit ({unit}) has one value; Welch's test of the units needs no model")
    testable = [group for group in found if group.units >= FEWEST]
    tested = mixed_differences({group.name: group.values for group in testable}) if mixed and testable[1:] else {}
    pairs = [_pair(a, b, tested.get((a.name, b.name)) if mixed else _welch(a, b)) for a, b in combinations(found, 2)]
    corrected = holm([pair[1][-1] for pair in pairs])
    return GroupComparison(
        unit, tuple(found), tuple(PairTest(*names, *numbers, p) for (names, numbers), p in zip(pairs, corrected)), mixed
    )


_Numbers = tuple[float, float, float, float, float, float]  # difference, its interval, t, degrees of freedom, p


def _pair(a: UnitGroup, b: UnitGroup, numbers: _Numbers | None) -> tuple[tuple[str, str], _Numbers]:
    none = math.nan
    return (a.name, b.name), numbers or (b.mean - a.mean, none, none, none, none, none)


def _welch(a: UnitGroup, b: UnitGroup) -> _Numbers | None:
    """Welch's t-test of b against a; None where it is not made."""
    from scipy.stats import ttest_ind

    if min(a.units, b.units) < FEWEST or not (scatters(a.means) or scatters(b.means)):
        return None
    found: Any = ttest_ind(b.means, a.means, equal_var=False)
    low, high = found.confidence_interval(0.95)
    return b.mean - a.mean, float(low), float(high), float(found.statistic), float(found.df), float(found.pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for their number by Holm's method; NaN are not tests, and remain. Source: Holm 1979.

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    p = np.array(p_values, float)
    order = np.argsort(p)[: int(np.isfinite(p).sum())]  # NaN come last
    p[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1)), 1.0)
    return [float(one) for one in p]
