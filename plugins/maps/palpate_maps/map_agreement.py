"""Agreement of two maps or lines: how far they differ at the places that both cover, and whether they are the same."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError
from palpate_kit.numerics.gaussian_process import GaussianProcess, whiten
from palpate_kit.numerics.normalised_error import COVERAGE

from palpate_maps.lump_criteria import MIN_SITES
from palpate_maps.sites import Sites, site_numbers
from palpate_maps.stiffness_field import LEAST_STD, MAX_MAP_SITES, FieldKernel, fit_kernel, thinned

WIDTH = 4e-3  # [m] of a place: that of a site of lumps, of the order of the contact's diameter
SAME = 0.5  # widths from the other's nearest site, up to which a place is covered by both
_BESIDE = 1.5  # widths between places that are neighbours on one line
_MEDIAN_DEVIATION = 0.6745  # median of |z| of the standard normal distribution
_MAX_CORRELATION = 0.5  # of neighbours: 0.45 on simulated rasters; more is a pattern (decision 0574)
_MIN_SHARE = 0.05  # of the stated standard deviation: a choice, as of equal numbers
_DRAWS = 4000  # of the distribution of the statistics: p down to 5e-4
_SEED = 0  # of these draws: the same runs have the same p
_EXACT = 1e-3  # [m] from the other's nearest site, up to which nothing is interpolated


@dataclass(frozen=True)
class MapAgreement:
    """Differences of the logarithm at common places, second less first."""

    place: Floats  # (n, k) [m]
    difference: Floats  # (n,)
    std: Floats  # (n,) of each by repeatability
    common_std: float  # of all differences together: tares, and the facts of the rig where these are not shared
    repeatability: float  # share of the stated standard deviation by which repeats scatter, at most 1
    shares: tuple[float, float]  # of the places of each that both cover
    level: tuple[float, float]  # mean difference, and its standard deviation
    level_p: float  # chance of such a mean difference between maps of the same body
    pattern_p: float  # chance of such differences from place to place

    @property
    def e_n(self) -> Floats:
        """(n,) difference over its expanded uncertainty, k = 2: agreement up to 1 in magnitude (ISO 13528)."""
        return np.asarray(self.difference / (COVERAGE * np.hypot(self.std, self.common_std)))

    @property
    def p(self) -> float:
        """Chance of the smaller of both p-values where the maps are of the same body (Sidak 1967)."""
        return 1 - (1 - min(self.level_p, self.pattern_p)) ** 2

    @property
    def least_p(self) -> float:
        """The least p that so many draws can give."""
        return 1 - (1 - 1 / (_DRAWS + 1)) ** 2


def map_agreement(first: Sites, second: Sites, common_std: float = 0.0) -> MapAgreement:
    """Return how two maps, or lines, differ at the places that both cover; raises LogError for fewer than 8.

    Both fields are interpolated by one kernel at the sites of the first, and averaged over places 4 mm wide, so that
    what interpolation does to them is the same. A difference has the variance q^2 (s_1^2 + s_2^2) + v: s as the
    estimators state it, q the share by which the differences do scatter, by their median deviation and at most 1, v of
    the interpolation to where only the first has a site. `common_std` is relative, of all places together.
    """
    # The number of the place of each site of the first; places that both cover as a whole are compared.
    number = site_numbers(first, WIDTH)
    covered, nearest = _covered(first, second)
    rows = covered & (np.bincount(number, ~covered)[number] == 0)
    count = len(np.unique(number[rows]))
    if count < MIN_SITES:
        raise LogError(f"both cover {count} places {1e3 * WIDTH:g} mm wide; {MIN_SITES} are needed to compare them")
    difference, interpolation = _field_difference(first, second, first.place[rows])
    # Means over the places.
    group = np.unique(number[rows], return_inverse=True)[1]

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(group, values) / np.bincount(group))

    stated = np.sqrt(mean(first.std[rows] ** 2 + second.std[nearest[rows]] ** 2))
    place = np.column_stack([mean(axis) for axis in first.place[rows].T])
    exact = mean(np.linalg.norm(first.place[rows] - second.place[nearest[rows]], axis=1)) <= _EXACT
    test = _SamenessTest(
        stated=stated,
        interpolation=mean(interpolation),
        exact=exact,
        follows=_are_neighbours(place),
        common_std=common_std,
    )
    return test.agreement(mean(difference), place, (count / (number[-1] + 1), _share_of_second(first, second)))


def _covered(sites: Sites, other_sites: Sites) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """Return which sites (n,) are near one of the others, and the row (n,) of the nearest of these."""
    from scipy.spatial import KDTree

    distance, nearest = KDTree(other_sites.place).query(sites.place)
    return np.asarray(distance <= SAME * WIDTH), np.asarray(nearest)


def _share_of_second(first: Sites, second: Sites) -> float:
    """Return the share of the second's sites that the first covers."""
    return float(_covered(second, first)[0].mean())


def _field_difference(first: Sites, second: Sites, nodes: Floats) -> tuple[Floats, Floats]:
    """Return the second's field less the first's at nodes (m, k) [m], and the variance (m,) of the interpolation."""
    level = float(np.median(first.log))
    kernel = fit_kernel(first.place, first.log - level, np.maximum(first.std, LEAST_STD) ** 2)
    means, variances = zip(*(_field(kernel, sites, nodes, level) for sites in (first, second)), strict=True)
    return means[1] - means[0], np.maximum(variances[1] - variances[0], 0.0)


def _field(kernel: FieldKernel, sites: Sites, nodes: Floats, level: float) -> tuple[Floats, Floats]:
    """Return the field of sites at nodes, and its variance were the sites exact."""
    used = sites[thinned(len(sites), MAX_MAP_SITES)]
    prior, cross = kernel.between(used.place, used.place), kernel.between(used.place, nodes)
    process = GaussianProcess.of(prior, kernel.noise_of(used), used.log - level)
    exact = GaussianProcess.of(prior, np.full(len(used), LEAST_STD**2), used.log - level)
    variance = kernel.variance - (whiten(exact.lower, cross) ** 2).sum(axis=0)
    return level + process.mean(cross), np.maximum(variance, 0.0)


def _are_neighbours(place: Floats) -> NDArray[np.bool_]:
    """Return True (n,) for a place that the line goes on to from the one before it."""
    return np.asarray(np.r_[False, np.linalg.norm(np.diff(place, axis=0), axis=1) <= _BESIDE * WIDTH])


def _share_above(draws: Floats, statistic: float) -> float:
    """Return the share of draws that are as large as a statistic, itself among them (Davison and Hinkley 1997)."""
    return float((1 + np.count_nonzero(draws >= statistic)) / (len(draws) + 1))


@dataclass(frozen=True)
class _SamenessTest:
    """The distribution of the differences of two maps of one body."""

    stated: Floats  # (n,) standard deviation of a difference as the estimators state it
    interpolation: Floats  # (n,) variance
    exact: NDArray[np.bool_]  # (n,) places without interpolation
    follows: NDArray[np.bool_]  # (n,) neighbours of the place before them
    common_std: float

    def agreement(self, difference: Floats, place: Floats, shares: tuple[float, float]) -> MapAgreement:
        """Return the agreement of differences (n,), with p-values by draws of maps that are the same.

        Draws are normal with the variances of the data and the correlation of neighbours along a line; each is
        evaluated as the data are, so that what few places determine of the scatter is in the p-values. `shares` are
        those of each run's places that the other covers.
        """
        share = float(self.shares(difference[None])[0])
        correlation = self._correlation(difference / self._std(share))
        level, pattern, mean_std = self._statistics(difference[None], correlation)
        drawn = self._draws(share, correlation)
        level_drawn, pattern_drawn, _ = self._statistics(drawn, correlation)
        return MapAgreement(
            place=place,
            difference=difference,
            std=self._std(share),
            common_std=self.common_std,
            repeatability=share,
            shares=shares,
            level=(float(difference.mean()), float(mean_std[0])),
            level_p=_share_above(level_drawn, float(level[0])),
            pattern_p=_share_above(pattern_drawn, float(pattern[0])),
        )

    def shares(self, differences: Floats) -> Floats:
        """Return the shares (d,) of the stated standard deviation by which differences (d, n) scatter, 1 at most."""
        rows = self.exact if np.count_nonzero(self.exact) >= MIN_SITES else np.ones(len(self.exact), bool)
        scaled = differences[:, rows] / self.stated[rows]
        deviation = np.abs(scaled - np.median(scaled, axis=1, keepdims=True))
        return np.asarray(np.clip(np.median(deviation, axis=1) / _MEDIAN_DEVIATION, _MIN_SHARE, 1.0))

    def _std(self, share: float | Floats) -> Floats:
        """Return the standard deviations (n,), or (d, n) of shares (d,), of differences by repeatability."""
        return np.asarray(np.sqrt(np.multiply.outer(np.square(share), self.stated**2) + self.interpolation))

    def _correlation(self, scores: Floats) -> float:
        """Return the correlation of neighbours by the signs of scores (n,), sin(pi q/2), which outliers do not move."""
        signs = np.sign(scores - np.median(scores))
        if not self.follows.any():
            return 0.0
        agreement = float((signs[1:] * signs[:-1])[self.follows[1:]].mean())
        return float(np.clip(math.sin(math.pi / 2 * agreement), 0.0, _MAX_CORRELATION))

    def _statistics(self, differences: Floats, correlation: float) -> tuple[Floats, Floats, Floats]:
        """Return level and pattern (d,) of differences (d, n), and the standard deviations (d,) of their means.

        Level: |mean|/u, u^2 = mean variance (1 + r)/((1 - r) n) + common variance. Pattern: mean square of the scores
        about their mean.
        """
        std = self._std(self.shares(differences))
        mean = differences.mean(axis=1)
        neighbours = (1 + correlation) / (1 - correlation) / differences.shape[1]
        mean_std = np.sqrt((std**2).mean(axis=1) * neighbours + self.common_std**2)
        pattern = (((differences - mean[:, None]) / std) ** 2).mean(axis=1)
        return np.abs(mean) / mean_std, pattern, mean_std

    def _draws(self, share: float, correlation: float) -> Floats:
        """Return differences (draws, n) of maps of one body."""
        dice = np.random.default_rng(_SEED)
        scores = dice.standard_normal((_DRAWS, len(self.stated)))
        for k in np.flatnonzero(self.follows):
            scores[:, k] = correlation * scores[:, k - 1] + math.sqrt(1 - correlation**2) * scores[:, k]
        common = self.common_std * dice.standard_normal(_DRAWS)
        return np.asarray(scores * self._std(share) + common[:, None])
