"""A group of units of replication, such as animals, and the scatter between and within them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Floats

from palpate_kit.numerics.precision import Precision, precision

_ROUNDING = 1e-12  # of the largest value; means of a thousand equal ones differ by less
_UPPER_PROBABILITY = 0.975  # of Student's t at the upper end of an interval of 95 %


def scatters(values: Floats) -> bool:
    """Return True if values (n,) differ by more than rounding."""
    return bool(np.ptp(values) > _ROUNDING * np.abs(values).max())


@dataclass(frozen=True)
class UnitGroup:
    """A group of units of replication, such as animals, each with the values of its curves [SI]."""

    name: str
    values: Mapping[str, Floats]  # (m,) of each unit

    @cached_property
    def means(self) -> Floats:
        """Mean (n,) of each unit."""
        return np.array([unit_values.mean() for unit_values in self.values.values()])

    @property
    def units(self) -> int:
        """Number of units."""
        return len(self.values)

    @property
    def curves(self) -> int:
        """Number of their values together."""
        return sum(len(unit_values) for unit_values in self.values.values())

    @property
    def mean(self) -> float:
        """Mean of the units' means."""
        return float(self.means.mean())

    @property
    def std(self) -> float:
        """Standard deviation of the units' means; NaN for a single one."""
        return float(self.means.std(ddof=1)) if self.units > 1 else math.nan

    @property
    def std_of_mean(self) -> float:
        """Standard uncertainty of the mean by the scatter of its units; NaN for a single one."""
        return self.std / math.sqrt(self.units)

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of 95 % of the mean, by Student's t of the units' means; NaN for a single one."""
        from scipy.stats import t as student

        half = self.std_of_mean * float(student.ppf(_UPPER_PROBABILITY, self.units - 1)) if self.units > 1 else math.nan
        return self.mean - half, self.mean + half

    @property
    def scatter(self) -> UnitScatter:
        """Scatter between and within its units."""
        return UnitScatter.of([self])

    def table(self) -> dict[str, Any]:
        """Return everything as plain data [SI]."""
        low, high = self.interval
        return {
            "units": self.units, "curves": self.curves, "mean": self.mean, "std": self.std,
            "std_of_mean": self.std_of_mean, "low": low, "high": high, "between": self.scatter.between,
            "within": self.scatter.within, "means": dict(zip(self.values, self.means.tolist(), strict=True)),
        }  # fmt: skip


@dataclass(frozen=True)
class UnitScatter:
    """Standard deviations [SI] between units and within them; NaN where nothing shows one of them."""

    between: float
    within: float

    @classmethod
    def of(cls, groups: Sequence[UnitGroup]) -> UnitScatter:
        """Return what groups show together, by their degrees of freedom; where no unit has two values both are
        between."""
        pooled: Precision | None = precision([list(group.values.values()) for group in groups if group.units])
        if pooled is None or all(group.units < 2 for group in groups):
            return cls(math.nan, math.nan if pooled is None else pooled.repeatability)
        return cls(pooled.reproducibility if math.isnan(pooled.between) else pooled.between, pooled.repeatability)

    @property
    def correlation(self) -> float:
        """ICC(1,1): the share of the variance of single values that is between units; NaN where it does not show."""
        whole = self.between**2 + self.within**2
        return self.between**2 / whole if whole > 0 else math.nan
