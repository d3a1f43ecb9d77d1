"""The lumps that an exam excludes: by width, the contrast that it would have found at nearly all of its places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.baseline_sites import Baseline
from palpate_maps.body_field import FWHM, SiteField
from palpate_maps.hidden_patches import REACH
from palpate_maps.lump_criteria import Lump, LumpPower, LumpSettings
from palpate_maps.lump_power import EXCLUDED_PROBABILITY, MAX_CONTRAST, WIDTHS
from palpate_maps.sites import Sites

Places = tuple[Floats, Floats]
"""Places (m, k) [m] of an area, and the share (m,) of it that each stands for."""

PLACES = 0.95  # share of these places
# Choices of computing time.
_MAX_PLACES = 400  # of virtual lumps, over the area
_INVERSE_PLASTIC, _INVERSE_PLASTIC_SQUARE = 0.7548776662466927, 0.5698402909980532  # 1/g and 1/g^2, g^3 = g + 1
_BISECTIONS = 18  # of the logarithm of a contrast, between the bounds
_LEAST_SHAPE = 1e-6  # of a height: a lump of contrast 100 raises such a site by 1e-4, a fiftieth of the least spread
_TINY = 1e-12  # [m] least length of a step between sites
_LOW, _HIGH = np.log(1e-3), np.log(MAX_CONTRAST)  # of a contrast


def excluded_lumps(
    field: SiteField,
    direction: Floats,
    baseline: Baseline,
    lumps: Sequence[Lump],
    settings: LumpSettings,
    area: Places | None = None,
) -> tuple[LumpPower, ...]:
    """Return the lumps that an exam excludes: for each of some widths the least contrast that it would have found.

    It would have been found with a probability of 0.95, at 95 % of the places of an area. `field` has the logarithms of
    the sites, `baseline` their mean and spread without lumps.

    A virtual lump raises each site by log(1 + c g), g the mean over the site's piece of the way of what the track makes
    of its Gaussian (`TrackResponse.shape`, along directions (m, k) of the way), and is found where a site exceeds the
    limit of the first discovery: P = 1 - product of Phi((limit - rise)/spread) over the sites. Places are those of an
    area, by default of triangles between the sites, but for known lumps. Beyond two radii, a width, a lump is not felt,
    as in a search; infinite where more than a twentieth of the places are that far from every site.
    """
    # Places on a known lump do not count.
    places, weight = _places_between(field.middle) if area is None else area
    for lump in lumps:
        distance_to_lump = np.linalg.norm(places[:, :2] - np.array(lump.place), axis=1)
        weight = np.where(distance_to_lump < max(lump.extent), 0.0, weight)
    if not len(places) or weight.sum() <= 0 or baseline.count < 2:
        return ()
    # The shape g of a lump of each width at each place, at each site.
    offset = field.place[:, None] - places[None]
    distance = np.linalg.norm(offset, axis=2).min(axis=0)
    powers = []
    for width in WIDTHS:
        shape = field.mean(settings.response.shape(offset, direction[:, None], width / FWHM))
        is_felt = distance <= REACH * width / 2
        contrast = _contrasts(np.where(is_felt, shape, 0.0), baseline, settings)
        powers.append(LumpPower(_quantile(contrast, weight), width, EXCLUDED_PROBABILITY))
    return tuple(powers)


def site_directions(sites: Sites) -> Floats:
    """Return unit vectors (n, k) of the way at sites: to the nearer of the sites before and after; zeros of stays."""
    step = np.diff(sites.place, axis=0)
    before, after = np.vstack([step[:1], step]), np.vstack([step, step[-1:]])
    lengths = np.linalg.norm([before, after], axis=2)
    way, length = np.where(lengths[0] <= lengths[1], before.T, after.T).T, lengths.min(axis=0)
    return np.where((sites.standing | (length <= 0))[:, None], 0.0, way / np.maximum(length, _TINY)[:, None])


def _places_between(middle: Floats) -> Places:
    """Return places (m, k) [m] in the triangles between sites (n, k), and the area (m,) that each stands for."""
    from scipy.spatial import Delaunay, QhullError

    try:
        corners = middle[Delaunay(middle[:, :2], qhull_options="Qbb Qc QJ").simplices]
    except QhullError:
        return np.zeros((0, middle.shape[1])), np.zeros(0)
    sides = corners[:, 1:, :2] - corners[:, :1, :2]
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
    # Large triangles hold more places: an even sequence along their summed area.
    count = min(_MAX_PLACES, 4 * len(corners))
    row = np.searchsorted(np.cumsum(area) / area.sum(), (np.arange(count) + 0.5) / count)
    return _points_in(corners[np.minimum(row, len(corners) - 1)]), np.full(count, area.sum() / count)


def _points_in(corners: Floats) -> Floats:
    """Return a point (m, k) in each triangle (m, 3, k), spread evenly by the R2 sequence (Roberts 2018)."""
    # Fractional parts of multiples of 1/g and 1/g^2, g^3 = g + 1; folded into the triangle.
    steps = np.arange(1, len(corners) + 1)
    u, v = (steps * _INVERSE_PLASTIC) % 1.0, (steps * _INVERSE_PLASTIC_SQUARE) % 1.0
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    weights = np.column_stack([1 - u - v, u, v])
    return np.asarray(np.einsum("mi,mik->mk", weights, corners))


def _contrasts(shape: Floats, baseline: Baseline, settings: LumpSettings) -> Floats:
    """Return the least contrast (m,) of lumps with shapes (n, m) at the sites that is found; infinite beyond 100.

    A lump is missed with the probability of `_missed_probability`; the contrast at which that is 1 - 0.95 is found by
    bisection of its logarithm between 0.001 and 100.
    """
    near_sites = _NearSites.of(shape)
    low, high = np.full(shape.shape[1], _LOW), np.full(shape.shape[1], _HIGH)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        missed = _missed_probability(near_sites, np.exp(middle), baseline, settings)
        is_found = missed <= 1 - EXCLUDED_PROBABILITY
        low, high = np.where(is_found, low, middle), np.where(is_found, middle, high)
    return np.where(high < _HIGH, np.exp(high), np.inf)


@dataclass(frozen=True)
class _NearSites:
    """The pairs of a place and a site that a lump there raises: most sites are far from most places."""

    places: NDArray[np.intp]  # (k,) row of the place of each pair
    shape: Floats  # (k,) of a lump at the place, at the site
    site_count: int
    place_count: int

    @classmethod
    def of(cls, shape: Floats) -> _NearSites:
        """Return the pairs of shapes (n, m) of lumps at places at sites that are not nearly 0."""
        sites, places = np.nonzero(shape > _LEAST_SHAPE)
        return cls(places, shape[sites, places], *shape.shape)

    def total(self, terms: Floats | NDArray[np.bool_]) -> Floats:
        """Return the sum (m,) of terms (k,) over the near sites of each place."""
        return np.asarray(np.bincount(self.places, terms, self.place_count), float)

    @cached_property
    def far_count(self) -> Floats:
        """Number (m,) of sites that no lump at a place raises."""
        return self.site_count - self.total(np.ones(len(self.places)))


def _missed_probability(near_sites: _NearSites, contrast: Floats, baseline: Baseline, settings: LumpSettings) -> Floats:
    """Return the probability (m,) that a lump of a contrast (m,) at each place is missed.

    `near_sites` pairs each place with the sites that a lump there raises, and has the lump's shape at each pair.

    P = product over the sites of Phi((limit - rise)/spread), rise = log(1 + contrast shape).

    The limit of the first discovery is the larger of log(1 + least contrast) and the prediction interval at the rate
    over the number of sites. A wide lump raises sites that pass for background: their mean rise raises the limit, and
    their scatter widens the interval.
    """
    from scipy import stats
    from scipy.special import log_ndtr

    places, far_count = near_sites.places, near_sites.far_count
    # The half width of the prediction interval, in spreads of the baseline.
    k = baseline.count
    half_width = float(stats.t.isf(settings.rate / near_sites.site_count, k - 1)) * np.sqrt(1 + 1 / k)
    least_rise = float(np.log1p(settings.contrast))
    rise = np.log1p(contrast[places] * near_sites.shape)
    # Sites below the limit without the lump pass for background.
    is_passing = rise < max(least_rise, half_width * baseline.spread)
    passing_rise = np.where(is_passing, rise, 0.0)
    passing_count = np.maximum(far_count + near_sites.total(is_passing), 1)
    shift = near_sites.total(passing_rise) / passing_count
    variance = np.maximum(near_sites.total(passing_rise**2) / passing_count - shift**2, 0.0)
    limit = np.maximum(least_rise, half_width * np.sqrt(baseline.spread**2 + variance)) + shift
    # Far sites do not rise: they count once for all of them.
    log_missed = near_sites.total(log_ndtr((limit[places] - rise) / baseline.spread))
    return np.asarray(np.exp(log_missed + far_count * log_ndtr(limit / baseline.spread)))


def _quantile(values: Floats, weight: Floats) -> float:
    """Return the value that a share of 0.95 of the weight does not exceed."""
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(weight[order]) / weight.sum()
    return float(values[order][int(np.searchsorted(cumulative, PLACES))])
