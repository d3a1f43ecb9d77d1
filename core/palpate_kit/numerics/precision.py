"""Precision of one method: repeatability and reproducibility, ICC, and the change that it can detect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

_QUANTILE = 1.959963984540054  # of the normal distribution at 0.975, for an interval of 95 %
_CHANGE = _QUANTILE * math.sqrt(2.0)  # of the standard error of measurement, of a difference of two values
_UPPER_PROBABILITY = 0.975  # at the upper end of an interval of 95 %


@dataclass(frozen=True)
class Precision:
    """Scatter of the values of one specimen [unit of the values].

    Repeatability: same operator, day and rig; reproducibility: another of what the groups differ by.
    """

    repeatability: float  # standard deviation s_r
    between: float  # s_L, of groups
    reproducibility: float  # s_R = sqrt(s_r^2 + s_L^2)
    values: int
    groups: int
    detectable: float  # smallest change of a specimen that is not scatter, at 95 %


def precision(levels: Sequence[Sequence[Floats]]) -> Precision | None:
    """Return the precision by the values (m,) of each group of each level (specimen); None where nothing is repeated.

    s_r^2 is the mean square within groups, s_L^2 = (MS between groups - s_r^2)/n_0, zero at least, both pooled over the
    levels by their degrees of freedom. Source: ISO 5725-2:2019, 7.5. The smallest detectable change of two single
    values is 1.96 sqrt(2) s_r, with s_R where there are several groups. Groups of one value each have s_R, the scatter
    between them, alone.
    """
    square_sum = freedom = 0.0
    parts: list[tuple[float, float]] = []  # s_L^2 before it is cut, and degrees of freedom
    for groups in levels:
        square_sum += sum(_square_sum(group) for group in groups)
        freedom += sum(len(group) - 1 for group in groups)
    if not freedom:
        return _single_values(levels)
    repeat_variance = square_sum / freedom
    for groups in levels:
        if len(groups) > 1:
            parts.append((_between(groups, repeat_variance), len(groups) - 1))
    weight_sum = sum(weight for _, weight in parts)
    between_variance = max(sum(part * weight for part, weight in parts) / weight_sum, 0.0) if weight_sum else 0.0
    reproducibility = math.sqrt(repeat_variance + between_variance)
    return Precision(
        repeatability=math.sqrt(repeat_variance),
        between=math.sqrt(between_variance),
        reproducibility=reproducibility,
        values=sum(len(group) for groups in levels for group in groups),
        groups=max(len(groups) for groups in levels),
        detectable=_CHANGE * reproducibility,
    )


def _single_values(levels: Sequence[Sequence[Floats]]) -> Precision | None:
    """Return the precision of groups of one value each: s_R, the scatter between groups, alone; None without two."""
    values_by_level = [np.concatenate(groups) for groups in levels]
    freedom = sum(len(row) - 1 for row in values_by_level)
    if not freedom:
        return None
    reproducibility = math.sqrt(sum(_square_sum(row) for row in values_by_level) / freedom)
    return Precision(
        repeatability=math.nan,
        between=math.nan,
        reproducibility=reproducibility,
        values=sum(map(len, values_by_level)),
        groups=max(map(len, values_by_level)),
        detectable=_CHANGE * reproducibility,
    )


def _square_sum(values: Floats) -> float:
    """Return the sum of the squares of values (m,) about their mean."""
    return float(((values - values.mean()) ** 2).sum())


def _between(groups: Sequence[Floats], repeat: float) -> float:
    """Return s_L^2 = (MS between groups - s_r^2)/n_0, not cut at zero, with s_r^2 the variance of repeats.

    n_0 = (N - sum of n_i^2/N)/(p - 1) of p groups with n_i values each, N in all.
    """
    sizes = np.array([len(group) for group in groups], float)
    means = np.array([group.mean() for group in groups])
    grand_mean = float(sizes @ means / sizes.sum())
    square = float(sizes @ (means - grand_mean) ** 2) / (len(groups) - 1)
    return (square - repeat) / _effective_size(sizes)


def _effective_size(sizes: Floats) -> float:
    """Return n_0, the number of values that groups of unequal sizes (p,) count as."""
    return float((sizes.sum() - float(sizes @ sizes) / sizes.sum()) / (len(sizes) - 1))


@dataclass(frozen=True)
class Correlation:
    """An intraclass correlation with its interval of 95 %."""

    value: float
    low: float
    high: float


def repeat_correlation(targets: Sequence[Floats]) -> Correlation | None:
    """Return ICC(1,1) of the values (m,) of each target, the share of their variance that is between targets.

    None for fewer than two targets, or none with two values. Its 95 % interval is exact where all have as many. Source:
    Shrout and Fleiss 1979; McGraw and Wong 1996.
    """
    from scipy.stats import f

    sizes = np.array([len(target) for target in targets], float)
    freedom = float(sizes.sum() - len(targets))
    if len(targets) < 2 or not freedom:
        return None
    within_square = sum(_square_sum(target) for target in targets) / freedom
    effective_size = _effective_size(sizes)
    between_square = within_square + effective_size * _between(targets, within_square)
    if not within_square > 0.0:
        return Correlation(1.0, 1.0, 1.0) if between_square > 0 else None
    # ICC = (F - 1)/(F + n_0 - 1) by the ratio F of the mean squares, whose interval is that of the F distribution.
    ratio, between_freedom = between_square / within_square, len(targets) - 1
    low, high = (
        ratio / f.ppf(_UPPER_PROBABILITY, between_freedom, freedom),
        ratio * f.ppf(_UPPER_PROBABILITY, freedom, between_freedom),
    )
    return Correlation(*(float((x - 1.0) / (x + effective_size - 1.0)) for x in (ratio, low, high)))


def method_correlation(table: Floats) -> float:
    """Return ICC(2,1) of a table (targets, methods): absolute agreement of single values, NaN where they do not
    scatter.

    (MSR - MSE)/(MSR + (k - 1) MSE + k (MSC - MSE)/n) by the mean squares of rows, columns and the rest, of n targets
    and k methods. Source: Shrout and Fleiss 1979.
    """
    targets, methods = table.shape
    if targets < 2 or methods < 2:
        return math.nan
    grand = table.mean()
    row_square = methods * float(((table.mean(axis=1) - grand) ** 2).sum()) / (targets - 1)
    column_square = targets * float(((table.mean(axis=0) - grand) ** 2).sum()) / (methods - 1)
    residual = table - table.mean(axis=1, keepdims=True) - table.mean(axis=0, keepdims=True) + grand
    residual_square = float((residual**2).sum()) / ((targets - 1) * (methods - 1))
    denominator = row_square + (methods - 1) * residual_square + methods * (column_square - residual_square) / targets
    return (row_square - residual_square) / denominator if denominator > 0 else math.nan


def grouped(values: Sequence[float], labels: Sequence[str]) -> Mapping[str, Floats]:
    """Return the values by label, in the order of the labels."""
    return {
        label: np.array([value for value, its_label in zip(values, labels, strict=True) if its_label == label])
        for label in dict.fromkeys(labels)
    }
