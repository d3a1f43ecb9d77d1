"""Limits of agreement of two methods over many specimens, and the line that relates them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

_QUANTILE = 1.959963984540054  # of the normal distribution, for 95 %


@dataclass(frozen=True)
class Interval:
    """A value with its interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class LimitsOfAgreement:
    """Bias of a method against another, and the limits between which 95 % of their differences lie."""

    count: int  # specimens
    bias: Interval
    lower: Interval
    upper: Interval
    std: float  # of the difference of single values
    trend: float  # rank correlation of differences with means
    trend_p: float


def limits_of_agreement(values: Sequence[Floats], references: Sequence[Floats]) -> LimitsOfAgreement | None:
    """From the values (m,) of each specimen by either method; None for fewer than three specimens.

    Of repeated values the limits are those of single ones: s^2 = s_d^2 + (1 - 1/m) s_w^2 for each method, s_d of the
    differences of means, s_w within specimens. Intervals: bias by Student's t, limits by the standard error
    s sqrt(1/n + 1.96^2/(2 (n - 1))). Source: Bland and Altman 1986, 1999 (sections 2 and 5.1).
    """
    from scipy.stats import spearmanr, t as student

    count = len(values)
    if count < 3:
        return None
    means = np.array([np.mean(one) for one in values]), np.array([np.mean(one) for one in references])
    differences = means[0] - means[1]
    variance = float(differences.var(ddof=1)) + sum(_within(method) for method in (values, references))
    std, bias = math.sqrt(variance), float(differences.mean())
    half = float(student.ppf(0.975, count - 1))
    of_bias = float(differences.std(ddof=1)) / math.sqrt(count)
    of_limit = std * math.sqrt(1.0 / count + _QUANTILE**2 / (2.0 * (count - 1)))

    def interval(value: float, error: float) -> Interval:
        return Interval(value, value - half * error, value + half * error)

    middle = 0.5 * (means[0] + means[1])
    scatters = np.ptp(differences) > 0 and np.ptp(middle) > 0
    trend: Any = spearmanr(differences, middle) if scatters else (math.nan, math.nan)
    return LimitsOfAgreement(
        count, interval(bias, of_bias), interval(bias - _QUANTILE * std, of_limit),
        interval(bias + _QUANTILE * std, of_limit), std, float(trend[0]), float(trend[1]),
    )  # fmt: skip


def _within(groups: Sequence[Floats]) -> float:
    """(1 - mean of 1/m) s_w^2: what means over repeats hide of single values."""
    freedom = sum(len(one) - 1 for one in groups)
    if not freedom:
        return 0.0
    squares = sum(float(((one - one.mean()) ** 2).sum()) for one in groups)
    return (1.0 - float(np.mean([1.0 / len(one) for one in groups]))) * squares / freedom


@dataclass(frozen=True)
class DemingLine:
    """value = intercept + slope reference, both with errors; a perfect method has 0 and 1."""

    intercept: Interval
    slope: Interval
    ratio: float  # of the variances of the errors, value over reference


def deming_line(values: Floats, references: Floats, ratio: float) -> DemingLine | None:
    """Return the line of least squares in both directions for (n,) pairs; None for fewer than three, or no spread.

    `ratio` is the error variance of `values` over that of `references`. Intervals by the jackknife and Student's t.
    Source: Deming 1943; Linnet 1990.
    """
    from scipy.stats import t as student

    count = len(values)
    if count < 3 or not np.ptp(references) > 0:
        return None
    whole = _line(values, references, ratio)
    kept_out = np.array([_line(np.delete(values, k), np.delete(references, k), ratio) for k in range(count)])
    pseudo = count * whole - (count - 1) * kept_out
    errors = pseudo.std(axis=0, ddof=1) / math.sqrt(count)
    half = float(student.ppf(0.975, count - 2))
    intercept, slope = (
        Interval(float(value), float(value - half * error), float(value + half * error))
        for value, error in zip(whole, errors, strict=True)
    )
    return DemingLine(intercept, slope, ratio)


def _line(values: Floats, references: Floats, ratio: float) -> Floats:
    """Intercept and slope."""
    x, y = references - references.mean(), values - values.mean()
    sxx, syy, sxy = float(x @ x), float(y @ y), float(x @ y)
    if sxy == 0.0:
        return np.array([math.nan, math.nan])
    half = syy - ratio * sxx
    slope = (half + math.sqrt(half**2 + 4.0 * ratio * sxy**2)) / (2.0 * sxy)
    return np.array([float(values.mean()) - slope * float(references.mean()), slope])
