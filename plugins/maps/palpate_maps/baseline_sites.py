"""Is a site stiffer than others? Prediction intervals from baseline sites, and the paper's t-test."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.populations import SINGLE, is_one, lowest_mode
from palpate_maps.sites import Sites

# Shares and levels of decisions 0084 and 0282, which have the share of lumps found with them on simulated layouts.
_CROWDED_SHARE = 0.2  # of all sites, at places that were palpated before: above it each place counts once
_CROWDED_LEVEL = 0.2  # of the test of normality there: several populations are expected, so that less evidence does
_SOFTER_SHARE = 0.15  # of all sites: so many soft outliers, a seventh, are the surroundings of a large stiff part
_SAME_PLACE = 0.97  # site widths between sites, below which they are one place: a raster of one width keeps all of its
_MIN_SITES = 4  # of a baseline: three degrees of freedom of its spread, a choice
_MODE_HALF_WIDTH = 3.0  # [standard deviations] about the lowest mode: the sites of the background
_MIN_SPREAD = 1e-12  # of a logarithm: keeps a studentised deviate finite where sites coincide
_MIN_REMAINDER = 1e-9  # of a sum of squares less one of them: a member that is all of the spread stays finite


@dataclass(frozen=True)
class Baseline:
    """The sites without a lump: mean and spread of their logarithm, and the rows that they are."""

    mean: float
    spread: float  # standard deviation between sites
    count: int
    members: NDArray[np.bool_]  # (n,)
    single: bool = True  # but for outliers, the sites are one population; else it is the lowest of several


def find_baseline(
    log: Floats, level: float = 0.05, share: float = 0.5, floor: float = 0.0, single: float = SINGLE
) -> Baseline:
    """Return the baseline among sites: those without outliers, or the lowest of several populations.

    `log` (n,) are the logarithms of the sites' stiffness.

    Up to a `share` of the sites may be outliers, on either side; Rosner's test (1983) finds their number at a level.
    Where what it leaves is not one normal population, or what it takes away is a softer one, so many sites are stiff
    that they hide each other: then the baseline is the lowest mode, determined by what lies below it. `floor` is the
    least spread assumed, `single` the level of the test of one population. The defaults are choices:
    the usual 5 %, and no more outliers than other sites.
    """
    by_rosner = _without_outliers(log, level, share, floor)
    inner = log[by_rosner.members]
    softer = int(((log < inner.mean()) & ~by_rosner.members).sum())
    # Rosner's test is exact where lumps are few: its sites are one population, and few outliers are softer.
    if softer < _SOFTER_SHARE * len(log) and (is_one(inner, single) or float(inner.std()) <= floor):
        return by_rosner
    # Stiff sites hide each other: the lowest mode is what surrounds them.
    mode = lowest_mode(log, floor)
    members = np.abs(log - mode.mean) <= _MODE_HALF_WIDTH * mode.spread
    return Baseline(mode.mean, mode.spread, mode.spread_from, members, single=False)


def background_sites(sites: Sites, floor: float = 0.0, width: float = 4e-3) -> Baseline:
    """Return the baseline of an area in which places may have several sites.

    A search goes where it is stiff, so that most of its sites may lie on lumps. Where more than a fifth of the sites
    are at places that have others, each place counts once, by the earliest of its sites; and since several populations
    are expected, less evidence is asked for them. `floor` is the least spread, `width` [m] that of a site.
    """
    # The earliest site of each place.
    earliest: list[int] = []
    for row, place in enumerate(sites.place):
        squares = ((sites.place[earliest] - place) ** 2).sum(axis=1)
        if not earliest or float(squares.min()) >= (_SAME_PLACE * width) ** 2:
            earliest.append(row)
    if len(earliest) >= len(sites) * (1 - _CROWDED_SHARE):
        return find_baseline(sites.log, floor=floor)
    # The baseline of the places, as rows of all sites.
    baseline = find_baseline(sites.log[earliest], floor=floor, single=_CROWDED_LEVEL)
    members = np.zeros(len(sites), bool)
    members[earliest] = baseline.members
    return replace(baseline, members=members)


def _without_outliers(log: Floats, level: float, share: float, floor: float) -> Baseline:
    """Return the sites (n,) that the generalised extreme studentised deviate test leaves (Rosner 1983).

    For independent normal baseline sites. `level` is of the test, `share` of the sites that may be outliers, `floor`
    the least spread assumed.
    """
    limits = _rosner_limits(len(log), level, share)
    order = np.argsort(log, kind="stable")
    inliers = _inliers((log - np.median(log))[order], limits, floor)
    members = np.zeros(len(log), bool)
    members[order[inliers]] = True
    inner = log[members]
    spread = float(inner.std(ddof=1)) if len(inner) > 1 else 0.0
    return Baseline(float(inner.mean()), max(spread, floor), int(members.sum()), members)


def _rosner_limits(count: int, level: float, share: float) -> Floats:
    """Return the critical values (k,) of Rosner's test of `count` sites, for the farthest deviate in each step.

    lambda = (m - 1) t/sqrt((m - 2 + t^2) m) of the m sites that are left, t the quantile 1 - level/(2 m) of Student's
    distribution with m - 2 degrees of freedom.
    """
    from scipy import stats

    remaining = count - np.arange(int(share * count))
    t = stats.t.ppf(1 - level / (2 * remaining), np.maximum(remaining - 2, 1))
    limits = (remaining - 1) * t / np.sqrt((remaining - 2 + t * t) * remaining)
    return np.asarray(limits[: max(count - _MIN_SITES + 1, 0)])


def _inliers(values: Floats, limits: Floats, floor: float) -> slice:
    """Return the rows of ordered values (n,) between the last outliers: the farthest deviate is at one of the two ends.

    Sum and sum of squares of what remains are kept, so that a step costs no sum over all values.
    """
    # `limits` are those of the studentised deviate of the first, second and further outliers.
    first, last = 0, len(values)
    inliers = slice(first, last)
    total, square = float(values.sum()), float((values**2).sum())
    for limit in limits.tolist():
        # Mean and spread of the values that remain.
        count = last - first
        mean = total / count
        spread = max(math.sqrt(max(square - total * mean, 0.0) / (count - 1)), floor, _MIN_SPREAD)
        # The farther of the two ends is taken away.
        low, high = float(values[first]), float(values[last - 1])
        if mean - low >= high - mean:
            farthest, first = low, first + 1
        else:
            farthest, last = high, last - 1
        # The last step above its limit decides how many are outliers.
        if abs(farthest - mean) / spread > limit:
            inliers = slice(first, last)
        total, square = total - farthest, square - farthest**2
    return inliers


def prediction_p(log: Floats, baseline: Baseline) -> Floats:
    """Return one-sided p-values (n,) of sites being stiffer than the next site of the baseline would be.

    t = (log - mean)/(spread sqrt(1 + 1/k)) with k - 1 degrees of freedom: the prediction interval of one further
    observation. Unlike a test of means it does not find more lumps because one site was palpated more often. A site
    of the baseline is tested against the others.
    """
    from scipy import stats

    k = baseline.count
    if k < _MIN_SITES or baseline.spread <= 0:
        return np.ones(len(log))
    # Of a lowest mode all sites are tested alike: its spread is that of what lies below.
    t = (log - baseline.mean) / (baseline.spread * np.sqrt(1 + 1 / k))
    if not baseline.single:
        return np.asarray(stats.t.sf(t, k - 1))
    inner = (log - baseline.mean) / (baseline.spread * np.sqrt(1 - 1 / k))
    # A member is part of the mean and the spread that it is compared with: its externally studentised residual.
    inner = inner * np.sqrt((k - 2) / np.maximum(k - 1 - inner**2, _MIN_REMAINDER))
    members = baseline.members
    return np.asarray(np.where(members, stats.t.sf(inner, k - 2), stats.t.sf(t, k - 1)))


def discoveries(p: Floats, rate: float) -> NDArray[np.bool_]:
    """Return True (n,) for the p-values that Benjamini and Hochberg's step-up (1995) keeps at a discovery rate."""
    n = len(p)
    order = np.argsort(p)
    passed = np.flatnonzero(p[order] <= rate * np.arange(1, n + 1) / n)
    kept = np.zeros(n, bool)
    if len(passed):
        kept[order[: passed[-1] + 1]] = True
    return kept


@dataclass(frozen=True)
class Comparison:
    """Two groups of palpations compared."""

    contrast: float  # of the means, minus 1
    p: float  # one-sided: that the second is stiffer by chance
    test: str


def welch(baseline: Floats, suspects: Floats) -> Comparison:
    """Return Welch's t-test of repeats at one site against repeats at another, as in the paper; to compare only.

    It takes the scatter between repeats for that between sites. With a spread of 0.5 % between sites, 10 repeats and
    p < 0.01, it finds a lump in half of all pairs of sites without one, and more repeats make it worse.
    """
    from scipy import stats

    test: Any = stats.ttest_ind(suspects, baseline, equal_var=False, alternative="greater")
    return Comparison(float(suspects.mean() / baseline.mean() - 1), float(test.pvalue), "welch")


def against_sites(baseline: Floats, suspect: float) -> Comparison:
    """Return a suspect site's mean against the means of baseline sites (k,), by the prediction interval."""
    log = np.log(baseline)
    count = len(log)
    sites = Baseline(float(log.mean()), float(log.std(ddof=1)) if count > 1 else 0.0, count, np.zeros(1, bool))
    p = float(prediction_p(np.array([np.log(suspect)]), sites)[0])
    return Comparison(float(suspect / np.exp(log.mean()) - 1), p, "prediction")
