"""Precision of one method: repeatability and reproducibility, ICC, and the change that it can detect."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

_CHANGE = 1.959963984540054 * math.sqrt(2.0)  # of the standard error of measurement


@dataclass(frozen=True)
class Precision:
    """How values of one specimen scatter [unit of the values].

    Repeatability: same operator, day and rig; reproducibility: another of what the groups differ by.
    """

    repeatability: float  # standard deviation s_r
    between: float  # s_L, of groups
    reproducibility: float  # s_R = sqrt(s_r^2 + s_L^2)
    values: int
    groups: int
    detectable: float  # smallest change of a specimen that is not scatter, at 95 %


def precision(levels: Sequence[Sequence[Floats]]) -> Precision | None:
    """From the values (m,) of each group of each level (specimen); None where nothing is repeated.

    s_r^2 is the mean square within groups, s_L^2 = (MS between groups - s_r^2)/n_0, zero at least, both pooled over the
    levels by their degrees of freedom. Source: ISO 5725-2:2019, 7.5. The smallest detectable change of two single
    values is 1.96 sqrt(2) s_r, with s_R where there are several groups. Groups of one value each have s_R, the
    scatter between them, alone.
    """
    within = freedom = 0.0
    parts: list[tuple[float, float]] = []  # s_L^2 before it is cut, and degrees of freedom
    for groups in levels:
        within += sum(float(((one - one.mean()) ** 2).sum()) for one in groups)
        freedom += sum(len(one) - 1 for one in groups)
    if not freedom:
        return _single_values(levels)
    repeat = within / freedom
    for groups in levels:
        if len(groups) > 1:
            parts.append((_between(groups, repeat), len(groups) - 1))
    total = sum(weight for _, weight in parts)
    between = max(sum(one * weight for one, weight in parts) / total, 0.0) if total else 0.0
    both = math.sqrt(repeat + between)
    return Precision(
        math.sqrt(repeat), math.sqrt(between), both, sum(len(one) for groups in levels for one in groups),
        max(len(groups) for groups in levels), _CHANGE * both,
    )  # fmt: skip


def _single_values(levels: Sequence[Sequence[Floats]]) -> Precision | None:
    """Return the scatter between groups of one value each."""
    rows = [np.concatenate(groups) for groups in levels]
    freedom = sum(len(row) - 1 for row in rows)
    if not freedom:
        return None
    both = math.sqrt(sum(float(((row - row.mean()) ** 2).sum()) for row in rows) / freedom)
    count, groups = sum(map(len, rows)), max(map(len, rows))
    return Precision(math.nan, math.nan, both, count, groups, _CHANGE * both)


def _between(groups: Sequence[Floats], repeat: float) -> float:
    sizes = np.array([len(one) for one in groups], float)
    means = np.array([one.mean() for one in groups])
    grand = float(sizes @ means / sizes.sum())
    square = float(sizes @ (means - grand) ** 2) / (len(groups) - 1)
    per_group = (sizes.sum() - float(sizes @ sizes) / sizes.sum()) / (len(groups) - 1)
    return (square - repeat) / float(per_group)


@dataclass(frozen=True)
class Correlation:
    """An intraclass correlation with its interval of 95 %."""

    value: float
    low: float
    high: float


def repeat_correlation(targets: Sequence[Floats]) -> Correlation | None:
    """ICC(1,1) of the values (m,) of each target, the share of their variance that is between targets.

    None for fewer than two targets, or none with two values. The interval is exact where all have as many. Source:
    Shrout and Fleiss 1979; McGraw and Wong 1996.
    """
    from scipy.stats import f

    sizes = np.array([len(one) for one in targets], float)
    freedom = float(sizes.sum() - len(targets))
    if len(targets) < 2 or not freedom:
        return None
    within = sum(float(((one - one.mean()) ** 2).sum()) for one in targets) / freedom
    per = (sizes.sum() - float(sizes @ sizes) / sizes.sum()) / (len(targets) - 1)
    between = within + per * _between(targets, within)
    if not within > 0.0:
        return Correlation(1.0, 1.0, 1.0) if between > 0 else None
    ratio, one = between / within, len(targets) - 1
    low, high = ratio / f.ppf(0.975, one, freedom), ratio * f.ppf(0.975, freedom, one)
    return Correlation(*(float((x - 1.0) / (x + per - 1.0)) for x in (ratio, low, high)))


def method_correlation(table: Floats) -> float:
    """ICC(2,1) of a table (targets, methods): absolute agreement of single values, NaN where they do not scatter.

    Source: Shrout and Fleiss 1979.
    """
    targets, methods = table.shape
    if targets < 2 or methods < 2:
        return math.nan
    grand = table.mean()
    rows = methods * float(((table.mean(axis=1) - grand) ** 2).sum()) / (targets - 1)
    columns = targets * float(((table.mean(axis=0) - grand) ** 2).sum()) / (methods - 1)
    rest = table - table.mean(axis=1, keepdims=True) - table.mean(axis=0, keepdims=True) + grand
    error = float((rest**2).sum()) / ((targets - 1) * (methods - 1))
    whole = rows + (methods - 1) * error + methods * (columns - error) / targets
    return (rows - error) / whole if whole > 0 else math.nan


def grouped(values: Sequence[float], labels: Sequence[str]) -> Mapping[str, Floats]:
    """Values by label, in the order of the labels."""
    return {
        label: np.array([value for value, one in zip(values, labels, strict=True) if one == label])
        for label in dict.fromkeys(labels)
    }
