"""Limits of agreement of two methods over many specimens, and the line that relates them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

_QUANTILE = 1.959963984540054  # of the normal distribution, for 95 %
_UPPER_TAIL = 0.975  # probability below the upper end of an interval of 95 %
_MIN_SPECIMENS = 3  # a choice: of two, a scatter has one degree of freedom


@dataclass(frozen=True)
class Interval:
    """A value with its interval of 95 %."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class LimitsOfAgreement:
    """Bias of a method against another, and the limits between which 95 % of their differences lie."""

    count: int  # of specimens
    bias: Interval
    lower: Interval
    upper: Interval
    std: float  # of the difference of single values
    trend: float  # rank correlation of differences with means
    trend_p: float


def limits_of_agreement(values: Sequence[Floats], references: Sequence[Floats]) -> LimitsOfAgreement | None:
    """Return the limits by the values (m,) of each specimen by either method; None for fewer than three specimens.

    Of repeated values the limits are those of single ones: s^2 = s_d^2 + (1 - 1/m) s_w^2 for each method, s_d of the
    differences of means, s_w within specimens. Intervals: bias by Student's t, limits by the standard error
    s sqrt(1/n + 1.96^2/(2 (n - 1))). Source: Bland and Altman 1986, 1999 (sections 2 and 5.1).
    """
    from scipy.stats import spearmanr, t as student

    count = len(values)
    if count < _MIN_SPECIMENS:
        return None
    value_means = np.array([np.mean(specimen_values) for specimen_values in values])
    reference_means = np.array([np.mean(specimen_references) for specimen_references in references])
    differences = value_means - reference_means
    bias = float(differences.mean())
    # Variance of the difference of single values, from that of means.
    added_variance = sum(_variance_within(method) for method in (values, references))
    std = math.sqrt(float(differences.var(ddof=1)) + added_variance)

    # Intervals, by standard errors times Student's t.
    t = float(student.ppf(_UPPER_TAIL, count - 1))
    bias_error = float(differences.std(ddof=1)) / math.sqrt(count)
    limit_error = std * math.sqrt(1.0 / count + _QUANTILE**2 / (2.0 * (count - 1)))

    # Differences that grow with the mean have a rank correlation.
    pair_means = 0.5 * (value_means + reference_means)
    scatters = np.ptp(differences) > 0 and np.ptp(pair_means) > 0
    trend: Any = spearmanr(differences, pair_means) if scatters else (math.nan, math.nan)
    return LimitsOfAgreement(
        count,
        bias=_interval(bias, t * bias_error),
        lower=_interval(bias - _QUANTILE * std, t * limit_error),
        upper=_interval(bias + _QUANTILE * std, t * limit_error),
        std=std,
        trend=float(trend[0]),
        trend_p=float(trend[1]),
    )


def _interval(value: float, half_width: float) -> Interval:
    return Interval(float(value), float(value - half_width), float(value + half_width))


def _variance_within(groups: Sequence[Floats]) -> float:
    """Return (1 - mean of 1/m) s_w^2 of groups (m,): the variance of single values that means over repeats hide."""
    freedom = sum(len(group) - 1 for group in groups)
    if not freedom:
        return 0.0
    squares = sum(float(((group - group.mean()) ** 2).sum()) for group in groups)
    return (1.0 - float(np.mean([1.0 / len(group) for group in groups]))) * squares / freedom


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
    if count < _MIN_SPECIMENS or not np.ptp(references) > 0:
        return None
    line = _intercept_and_slope(values, references, ratio)
    # Jackknife: standard errors by the scatter of pseudo-values, each from the line without one pair.
    without_one = [_intercept_and_slope(np.delete(values, k), np.delete(references, k), ratio) for k in range(count)]
    pseudo_values = count * line - (count - 1) * np.array(without_one)
    errors = pseudo_values.std(axis=0, ddof=1) / math.sqrt(count)
    t = float(student.ppf(_UPPER_TAIL, count - 2))
    intercept, slope = (_interval(value, t * error) for value, error in zip(line, errors, strict=True))
    return DemingLine(intercept, slope, ratio)


def _intercept_and_slope(values: Floats, references: Floats, ratio: float) -> Floats:
    """Return intercept a and slope b (2,) of Deming's line; NaN for values that do not follow the references.

    With sums of squares about the means and the ratio r: b = (h + sqrt(h^2 + 4 r s_xy^2))/(2 s_xy), h = s_yy - r s_xx.
    """
    x, y = references - references.mean(), values - values.mean()
    s_xx, s_yy, s_xy = float(x @ x), float(y @ y), float(x @ y)
    if s_xy == 0.0:
        return np.array([math.nan, math.nan])
    h = s_yy - ratio * s_xx
    slope = (h + math.sqrt(h**2 + 4.0 * ratio * s_xy**2)) / (2.0 * s_xy)
    return np.array([float(values.mean()) - slope * float(references.mean()), slope])
