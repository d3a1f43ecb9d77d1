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

_CROWDED = 0.2  # share of sites at places that were palpated before
_SINGLE_OF_CROWDED = 0.2  # level of the test of normality, where more of them are
_LEAST = 4  # baseline sites; with fewer nothing can be said
_SOFTER = 0.15  # share of sites that are not soft outliers any more, but surroundings of a large stiff part


@dataclass(frozen=True)
class Baseline:
    """What sites without a lump are like: mean and spread of the logarithm, and which they are."""

    mean: float
    spread: float  # standard deviation between sites
    count: int
    members: NDArray[np.bool_]  # (n,)
    single: bool = True  # but for outliers, the sites are one population; else it is the lowest of several


def find_baseline(
    log: Floats, level: float = 0.05, share: float = 0.5, floor: float = 0.0, single: float = SINGLE
) -> Baseline:
    """The baseline among sites (n,): those without outliers, or the lowest of several populations.

    Up to a `share` of the sites may be outliers, on either side; Rosner's test (1983) finds their number at a level.
    Where what it leaves is not one normal population, or what it takes away is a softer one, so many sites are stiff
    that they hide each other: then the baseline is the lowest mode, determined by what lies below it. `floor` is the
    least spread assumed, `single` the level of the test of one population.
    """
    found = _without_outliers(log, level, share, floor)
    inner = log[found.members]
    softer = int(((log < inner.mean()) & ~found.members).sum())
    if softer < _SOFTER * len(log) and (is_one(inner, single) or float(inner.std()) <= floor):
        return found
    mode = lowest_mode(log, floor)
    members = np.abs(log - mode.mean) <= 3 * mode.spread
    return Baseline(mode.mean, mode.spread, mode.spread_from, members, single=False)


def background_sites(sites: Sites, floor: float = 0.0, width: float = 4e-3) -> Baseline:
    """The baseline of an area where more than a fifth of the sites may lie at places [m wide] that others are at, too.

    A search goes where it is stiff, so that most of its sites may lie on lumps: then each place counts once, by the
    earliest of its sites, and since several populations are expected, less evidence is asked for them.
    """
    rows: list[int] = []
    for i, place in enumerate(sites.place):
        if not rows or float(((sites.place[rows] - place) ** 2).sum(axis=1).min()) >= (0.97 * width) ** 2:
            rows.append(i)
    if len(rows) >= len(sites) * (1 - _CROWDED):
        return find_baseline(sites.log, floor=floor)
    found = find_baseline(sites.log[rows], floor=floor, single=_SINGLE_OF_CROWDED)
    members = np.zeros(len(sites), bool)
    members[rows] = found.members
    return replace(found, members=members)


def _without_outliers(log: Floats, level: float, share: float, floor: float) -> Baseline:
    """The generalised extreme studentised deviate test (Rosner 1983), for independent normal baseline sites."""
    from scipy import stats

    n, most = len(log), int(share * len(log))
    order = np.argsort(log, kind="stable")
    values = (log - np.median(log))[order]
    first, last, outliers = 0, n, (0, n)  # of the ordered sites that are left: the farthest is at one of the ends
    still = n - np.arange(most)  # sites at each step
    t = stats.t.ppf(1 - level / (2 * still), np.maximum(still - 2, 1))
    limits = (still - 1) * t / np.sqrt((still - 2 + t * t) * still)
    total, square = float(values.sum()), float((values**2).sum())
    for limit in limits[: max(n - _LEAST + 1, 0)].tolist():
        m = last - first
        mean = total / m
        spread = max(math.sqrt(max(square - total * mean, 0.0) / (m - 1)), floor, 1e-12)
        low, high = float(values[first]), float(values[last - 1])
        if lower := mean - low >= high - mean:
            first += 1
        else:
            last -= 1
        worst = low if lower else high
        if abs(worst - mean) / spread > limit:
            outliers = first, last
        total, square = total - worst, square - worst**2
    members = np.zeros(n, bool)
    members[order[slice(*outliers)]] = True
    inner = log[members]
    spread = float(inner.std(ddof=1)) if len(inner) > 1 else 0.0
    return Baseline(float(inner.mean()), max(spread, floor), int(members.sum()), members)


def prediction_p(log: Floats, baseline: Baseline) -> Floats:
    """(n,) one-sided p-values of sites being stiffer than the next site of the baseline would be.

    t = (log - mean)/(spread sqrt(1 + 1/k)) with k - 1 degrees of freedom: the prediction interval of one further
    observation. Unlike a test of means it does not find more lumps because one site was palpated more often. A site
    of the baseline is tested against the others.
    """
    from scipy import stats

    k = baseline.count
    if k < _LEAST or baseline.spread <= 0:
        return np.ones(len(log))
    t = (log - baseline.mean) / (baseline.spread * np.sqrt(1 + 1 / k))
    if not baseline.single:
        return np.asarray(stats.t.sf(t, k - 1))
    inner = (log - baseline.mean) / (baseline.spread * np.sqrt(1 - 1 / k))
    # A member is part of the mean and the spread that it is compared with: its externally studentised residual.
    inner = inner * np.sqrt((k - 2) / np.maximum(k - 1 - inner**2, 1e-9))
    members = baseline.members
    return np.asarray(np.where(members, stats.t.sf(inner, k - 2), stats.t.sf(t, k - 1)))


def discoveries(p: Floats, rate: float) -> NDArray[np.bool_]:
    """(n,) True for the p-values that Benjamini and Hochberg's step-up keeps at a false-discovery rate (1995)."""
    n = len(p)
    order = np.argsort(p)
    passed = np.flatnonzero(p[order] <= rate * np.arange(1, n + 1) / n)
    found = np.zeros(n, bool)
    if len(passed):
        found[order[: passed[-1] + 1]] = True
    return found


@dataclass(frozen=True)
class Comparison:
    """Two groups of palpations compared."""

    contrast: float  # of the means, minus 1
    p: float  # one-sided: that the second is stiffer by chance
    test: str


def welch(baseline: Floats, suspects: Floats) -> Comparison:
    """Welch's t-test of repeats at one site against repeats at another, as in the paper; for comparison only.

    It takes the scatter between repeats for that between sites. With a spread of 0.5 % between sites, 10 repeats and
    p < 0.01, it finds a lump in half of all pairs of sites without one, and more repeats make it worse.
    """
    from scipy import stats

    found: Any = stats.ttest_ind(suspects, baseline, equal_var=False, alternative="greater")
    return Comparison(float(suspects.mean() / baseline.mean() - 1), float(found.pvalue), "welch")


def against_sites(baseline: Floats, suspect: float) -> Comparison:
    """A suspect site's mean against the means of baseline sites (k,), by the prediction interval."""
    logs = np.log(baseline)
    k = len(logs)
    everyone = Baseline(float(logs.mean()), float(logs.std(ddof=1)) if k > 1 else 0.0, k, np.zeros(1, bool))
    p = float(prediction_p(np.array([np.log(suspect)]), everyone)[0])
    return Comparison(float(suspect / np.exp(logs.mean()) - 1), p, "prediction")
