"""Stiff patches that may still hide: their posterior number at each place, and the probability that one remains."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats
from palpate_kit.numerics.gaussian_process import cholesky_factor, whiten

from palpate_maps.sites import Sites
from palpate_maps.stiffness_field import LEAST_STD, distances

# The prior of decision 0280, a choice that each statement of a search names.
EXPECTED = 1.5  # patches in the area, before anything is palpated
# Standard deviations of log E that are not known: grids of 24 combinations, each as likely as the next beforehand.
_NOISE = (0.35, 0.6, 1.0, 1.7)  # of a site, over what its estimator states
_BACKGROUND = (0.003, 0.01, 0.03)  # of the background's own change
_DRIFT = (0.001, 0.01)  # of the change with time
_SIZES = tuple(itertools.product(_NOISE, _BACKGROUND, _DRIFT))
_BACKGROUND_LENGTH = 25e-3  # [m] over which the background changes: far wider than a patch
_DRIFT_TIME = 60.0  # [s] over which the tare drifts
_SITE_SPREAD = 2e-3  # standard deviation of log E between sites, known
REACH = 2.0  # radii of a patch up to which it is felt, there by a sixteenth of its height (decisions 0295 and 0446)
# Choices of computing time; the rule of the growth is of decision 0281.
_MIN_WEIGHT = 0.02  # of the heaviest combination, below which one is left out
_MAX_SITES = 400  # of the covariance; of more, as many evenly
_MANY_SITES = 200  # from which on the combinations are not weighed again each time
_GROWTH = 1.25  # times the sites that were weighed by, from which on they are weighed again
_MIN_SITES = 3  # with fewer the posterior is the prior
_SMALLEST_NUMBER = 1e-300  # of patches, in a quotient in place of 0: near the smallest double
# Of a probability in words, a choice: no prior is so well known that less means anything.
_MIN_PERCENT = 0.01
_ROUNDS_TO_ALL = 99.5  # percent
# Exponents between which odds are a finite number above zero that a sum over places is not lost in.
_MIN_EXPONENT, _MAX_EXPONENT = -700, 50


@dataclass(frozen=True)
class Patch:
    """The least patch that must not be missed: log E rises by log(1 + contrast) 2^-(d/radius)^2 at a distance d.

    Beyond two radii it is not felt: a site there says nothing of it.
    """

    radius: float  # [m] at half its height
    contrast: float  # of its middle over its surroundings

    def __post_init__(self) -> None:
        """Raise ConfigurationError for what is not a patch."""
        for name, value in (("radius", self.radius), ("contrast", self.contrast)):
            if not (np.isfinite(value) and value > 0):
                raise ConfigurationError(f"{name}: {value:g} must be above 0")

    @property
    def height(self) -> float:
        """Of the logarithm."""
        return float(np.log1p(self.contrast))

    def profile(self, place: Floats, middles: Floats) -> Floats:
        """Return the rise (n, m) of the logarithm at places (n, k) [m] by patches at each of the middles (m, k) [m]."""
        radii = distances(place, middles) / self.radius
        return np.where(radii < REACH, self.height * np.exp2(-(radii**2)), 0.0)


@dataclass(frozen=True)
class Hiding:
    """The posterior of patches at each of some middles."""

    middles: Floats  # (m, 2) [m], or (m, 3) on a surface
    expected: Floats  # (m,) patches that remain there; their sum is that of the area
    reach: float  # [m] radius of the least patch
    scatter: float = 1.0  # of a site, over its standard deviation
    sizes: tuple[tuple[float, float, float], ...] = ()  # of the covariance, that count
    weighed_on: int = 0  # sites by which they were chosen

    @property
    def likely(self) -> tuple[Floats, float]:
        """The likeliest place (k,) [m] of a patch, and the number expected to have their middle about there."""
        k = int(np.argmax(self.expected))
        near = distances(self.middles, self.middles[k][None])[:, 0] <= self.reach
        weight = self.expected[near]
        return weight @ self.middles[near] / max(weight.sum(), _SMALLEST_NUMBER), float(weight.sum())

    @property
    def risk(self) -> float:
        """Probability that a patch remains: 1 - exp(-expected number)."""
        return float(-np.expm1(-self.expected.sum()))

    @property
    def risk_text(self) -> str:
        """The probability that a patch remains, in words; beyond 0.01 and 99 % as a limit."""
        percent = 100 * self.risk
        if percent < _MIN_PERCENT:
            return f"less than {_MIN_PERCENT:g} %"
        return f"{percent:.2g} %" if percent < _ROUNDS_TO_ALL else "more than 99 %"


def hidden_patches(
    sites: Sites,
    middles: Floats,
    patch: Patch,
    on_lumps: NDArray[np.bool_] | None = None,
    before: Hiding | None = None,
    extent: Floats | None = None,
) -> Hiding:
    """Return the posterior number of hidden stiff patches at middles (m, k) [m], by sites that lie on no known lump.

    Beforehand patches are a Poisson process with 1.5 of them in the area, so that each of the middles has 1.5/m, or a
    share by its extent (m,) where these differ, and those that were found say nothing of the others. The sites say
    L(x), the likelihood of a patch at x over that of none, so that 1.5/m L(x) are left there; none is on a known lump
    (m,). log L = h' P y - h' P h/2 with the rise h by the least patch and P the precision of the logarithms y about an
    unknown level. A larger or a stiffer patch raises y and thus L: the least patch is the one that is missed most
    easily. The covariance is not known: scatter between sites, a background that changes over 25 mm, and a drift with
    time have a size each on a grid, and every combination has the weight of its restricted likelihood; of many sites
    only those that counted `before`, until there are a quarter more. Where no site is within two radii h is 0, L is 1,
    and as many are left as were expected beforehand.
    """
    # The prior: as likely everywhere, or by the area of the skin, but on no known lump.
    expected = np.full(len(middles), EXPECTED / max(len(middles), 1))
    if extent is not None:
        expected *= extent / extent.mean()
    if on_lumps is not None:
        expected[on_lumps] = 0.0
    if len(sites) < _MIN_SITES:
        return Hiding(middles, expected, patch.radius)
    # A covariance for each combination of sizes, over sites that are thinned evenly where they are many.
    sizes, weighed_on = _sizes_for(len(sites), before)
    rows = np.linspace(0, len(sites) - 1, min(len(sites), _MAX_SITES)).round().astype(int)
    used_sites = sites[np.unique(rows)]
    terms = _SharedTerms.of(used_sites)
    covariances = [terms.covariance(*combination) for combination in sizes]
    weights = _weights(covariances)
    # L(x) = sum_t w_t L_t(x) over the combinations t that have a weight.
    rise = patch.profile(used_sites.place, middles)
    weighted = np.flatnonzero(weights).tolist()
    odds = sum(weights[t] * covariances[t].odds(rise) for t in weighted)
    return Hiding(
        middles=middles,
        expected=expected * np.asarray(odds),
        reach=patch.radius,
        scatter=float(np.sqrt(weights @ np.square([noise for noise, _, _ in sizes]))),
        sizes=tuple(sizes[t] for t in weighted),
        weighed_on=weighed_on,
    )


def _sizes_for(count: int, before: Hiding | None) -> tuple[tuple[tuple[float, float, float], ...], int]:
    """Return the combinations of sizes that are weighed for a number of sites, and the number at their latest choice.

    All of them of few sites, or once there are a quarter more; else those that counted before.
    """
    if before is None or count < _MANY_SITES or count > _GROWTH * before.weighed_on:
        return _SIZES, count
    return before.sizes, before.weighed_on


def _weights(covariances: list[_Covariance]) -> Floats:
    """Return weights (k,) of covariances by restricted likelihoods, with the sum 1; 0 of those that hardly count."""
    evidence = np.array([covariance.evidence for covariance in covariances])
    weights = np.exp(evidence - evidence.max())
    weights[weights < _MIN_WEIGHT] = 0.0
    return np.asarray(weights / weights.sum())


@dataclass(frozen=True)
class _SharedTerms:
    """Terms that all covariances of some sites have in common."""

    log: Floats  # (n,) about its mean
    stated: Floats  # (n,) variances that scale
    relief: Floats  # (n,) variances that are known
    smooth: Floats  # (n, n) correlation of the background
    drifting: Floats  # (n, n) of the drift

    @classmethod
    def of(cls, sites: Sites) -> _SharedTerms:
        # A relief is taken for stiffness on the way only; sites differ in any case.
        relief = np.where(sites.standing, 0.0, sites.relief**2) + _SITE_SPREAD**2
        smooth = np.exp(-0.5 * (distances(sites.place, sites.place) / _BACKGROUND_LENGTH) ** 2)
        drifting = np.exp(-np.abs(sites.time[:, None] - sites.time[None]) / _DRIFT_TIME)
        return cls(
            log=sites.log - sites.log.mean(),
            stated=np.maximum(sites.std, LEAST_STD) ** 2,
            relief=relief,
            smooth=smooth,
            drifting=drifting,
        )

    def covariance(self, noise: float, background: float, drift: float) -> _Covariance:
        """Return the covariance of one combination of sizes, factorised."""
        covariance = background**2 * self.smooth + drift**2 * self.drifting
        lower = cholesky_factor(covariance, noise**2 * self.stated + self.relief)
        # Logarithms and ones, whitened; the level is projected out.
        values, ones = whiten(lower, np.column_stack([self.log, np.ones(len(self.log))])).T
        size = float(np.sqrt(ones @ ones))
        residual = values - ones * (ones @ values) / size**2
        evidence = -0.5 * residual @ residual - np.log(np.diag(lower)).sum() - np.log(size)
        return _Covariance(lower, residual, ones / size, float(evidence))


@dataclass(frozen=True)
class _Covariance:
    """One covariance of the sites, factorised, with an unknown level taken out."""

    lower: Floats  # (n, n)
    residual: Floats  # (n,) L^-1 of the logarithms about their level
    level: Floats  # (n,) L^-1 of ones, of length 1
    evidence: float  # restricted log-likelihood

    def odds(self, rise: Floats) -> Floats:
        """Return the likelihood (m,) of each rise h (n, m) over that of none: exp(h' P y - h' P h/2)."""
        solved = whiten(self.lower, rise)
        precision = (solved**2).sum(axis=0) - (self.level @ solved) ** 2
        return np.asarray(np.exp(np.clip(self.residual @ solved - precision / 2, _MIN_EXPONENT, _MAX_EXPONENT)))
