"""The stiffness over an area as a Gaussian process to which palpations are added one by one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.gaussian_process import GaussianProcess, cholesky_factor, matern_3_2, whiten

from palpate_maps.body_field import BodyFit
from palpate_maps.sites import Sites

# Choices: the least that is believed of a site, and the range of kernels.
LEAST_STD = 1e-3  # of a site's logarithm
_JITTER = 1e-12  # variance of a logarithm, that keeps a covariance positive where sites coincide
_MIN_LENGTH = 2e-3  # [m]
_BOUNDS = np.log([[1e-8, 1e2], [_MIN_LENGTH, 5e-2], [1e-8, 1e-1]])  # of variance, length [m], noise
# Choices: the kernel from which a fit begins, where none is known.
_START_STD = 1e-3  # of the logarithm, at least
_START_LENGTH = 6e-3  # [m]
_START_NOISE = 1e-4  # variance of a logarithm: 1 %
# Choices of computing time.
_MAX_FITTED_SITES = 250  # sites that the kernel is fitted on; more cost time, not accuracy
MAX_MAP_SITES = 1500  # sites that a whole map is made of
_MAX_NODES = 2000  # that are solved for at once
_MIN_SPARE_ROWS = 64  # rows that a factor is enlarged by at least, else by half
# Of decision 0281.
_GROWTH = 1.5  # times the sites of the latest fit, from which on it is repeated
_SURPRISE = 1e-3  # probability of innovations as large as those since the latest fit, below which it is repeated


@dataclass(frozen=True)
class FieldKernel:
    """Covariance of the logarithm: variance x Matern 3/2 of a length, and white noise between sites."""

    variance: float
    length: float  # [m]
    noise: float  # variance of a site besides its own

    def between(self, a: Floats, b: Floats) -> Floats:
        """Return the covariances (n, m) of the field at places a (n, k) and b (m, k) [m]."""
        return self.variance * matern_3_2(distances(a, b), self.length)

    def factor(self, sites: Sites) -> Floats:
        """Return the lower Cholesky factor (n, n) of the covariance of sites."""
        return cholesky_factor(self.between(sites.place, sites.place), self.noise_of(sites))

    def noise_of(self, sites: Sites) -> Floats:
        """Return the variance (n,) of each site about the field."""
        return _stated_variance(sites) + self.noise + _JITTER


def distances(a: Floats, b: Floats) -> Floats:
    """Return the distances (n, m) [m] of places a (n, k) from places b (m, k)."""
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))


def near(nodes: Floats, places: Floats, apart: float) -> NDArray[np.bool_]:
    """Return True (m,) for nodes [m] that are nearer than `apart` [m] to any of some places (n, k) [m]."""
    from scipy.spatial import KDTree

    if not len(places):
        return np.zeros(len(nodes), bool)
    distance, _ = KDTree(places).query(nodes, distance_upper_bound=apart)
    return np.asarray(distance < apart)


def lengths_along(nodes: Floats, row: NDArray[np.intp]) -> Floats:
    """Return (k,) [m] from the first node of a row (k,) to each: nodes (m, 2) straight, (m, 3) along the surface."""
    if nodes.shape[1] == 2:
        return np.asarray(np.hypot(*(nodes[row] - nodes[row[0]]).T))
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(nodes[row], axis=0), axis=1)))


def fit_kernel(
    place: Floats, log: Floats, stated: Floats, start: FieldKernel | None = None, least_length: float = 0.0
) -> FieldKernel:
    """Return the kernel of the largest likelihood of deviations log (n,) at places (n, k) [m] with stated variances.

    By L-BFGS-B over the logarithms of variance, length and noise; the length is `least_length` [m] at least, that of
    what the distance of the sites can show.
    """
    from scipy.optimize import minimize

    rows = thinned(len(log), _MAX_FITTED_SITES)
    likelihood = _KernelLikelihood(distances(place[rows], place[rows]), log[rows], stated[rows])
    start = start or FieldKernel(max(float(log[rows].std()), _START_STD) ** 2, _START_LENGTH, _START_NOISE)
    bounds = _BOUNDS.copy()
    bounds[1, 0] = np.clip(np.log(max(least_length, _MIN_LENGTH)), *_BOUNDS[1])
    logarithms = np.clip(np.log([start.variance, start.length, start.noise]), *bounds.T)
    optimum = minimize(likelihood.negative, logarithms, jac=True, method="L-BFGS-B", bounds=bounds)
    variance, length, noise = np.exp(optimum.x).tolist()
    return FieldKernel(variance, length, noise)


@dataclass(frozen=True)
class _KernelLikelihood:
    """Likelihood of deviations y under a kernel: log p = -y' K^-1 y/2 - log|K|/2, but for a constant.

    Rasmussen and Williams 2006, section 5.4.1.
    """

    distance: Floats  # (n, n) [m] of the places
    log: Floats  # (n,) the deviations y
    stated: Floats  # (n,) their variances as the estimator states them

    def negative(self, logarithms: Floats) -> tuple[float, Floats]:
        """Return -log p and its gradient by the logarithms of variance, length and noise.

        dK/dlog(variance) is the smooth part of K, dK/dlog(length) = variance r^2 exp(-r), r = sqrt(3) d/length.
        """
        from scipy.linalg import cho_factor, cho_solve

        # K: a Matern 3/2 kernel, variance (1 + r) exp(-r), and the variances of each site alone.
        variance, length, noise = np.exp(logarithms)
        ratio = np.sqrt(3.0) / length * self.distance
        decay = variance * np.exp(-ratio)
        smooth = (1 + ratio) * decay
        factor = cho_factor(smooth + np.diag(self.stated + noise + _JITTER), lower=True)
        solved, inverse = cho_solve(factor, self.log), cho_solve(factor, np.eye(len(self.log)))
        value = 0.5 * self.log @ solved + np.log(np.diag(factor[0])).sum()
        # Each slope is the trace of (K^-1 - K^-1 y y' K^-1) dK/dlog, halved.
        inner = inverse - np.outer(solved, solved)
        slopes = [(inner * smooth).sum(), (inner * (ratio**2 * decay)).sum(), noise * np.trace(inner)]
        return float(value), 0.5 * np.array(slopes)


def interpolated(
    sites: Sites, nodes: Floats, level: float, least_length: float = 0.0, fit: BodyFit | None = None
) -> tuple[Floats, Floats, float]:
    """Return mean and standard deviation (m,) of the logarithm at nodes (m, k) [m], and the kernel's length [m].

    `level` is the logarithm far from every site, `least_length` [m] the kernel's least. The field is that of
    `StiffnessField`, for more nodes than it can hold covariances of; far from every site it goes back to
    the level. Where bodies were fitted to the sites, the field is that of what these leave, and the bodies with their
    covariance are added: a field of one length is either too smooth for them or too rough for the rest.
    """
    if fit is not None:
        background = replace(sites, log=sites.log - fit.rise_at(sites.place)[0])
        mean, std, length = interpolated(background, nodes, fit.level, least_length)
        height, height_std = fit.rise_at(nodes)
        return mean + height, np.hypot(std, height_std), length
    kernel = fit_kernel(sites.place, sites.log - level, _stated_variance(sites), least_length=least_length)
    used = sites[thinned(len(sites), MAX_MAP_SITES)]
    process = GaussianProcess.of(kernel.between(used.place, used.place), kernel.noise_of(used), used.log - level)
    mean, variance = np.empty(len(nodes)), np.empty(len(nodes))
    for rows in np.array_split(np.arange(len(nodes)), len(nodes) // _MAX_NODES + 1):
        cross = kernel.between(used.place, nodes[rows])
        mean[rows] = level + process.mean(cross)
        variance[rows] = kernel.variance - (whiten(process.lower, cross) ** 2).sum(axis=0)
    return mean, np.sqrt(np.maximum(variance, LEAST_STD**2)), kernel.length


@dataclass
class StiffnessField:
    """Posterior of the logarithm at fixed nodes, by a Cholesky factor that grows by a row with each site.

    With K = L L' and V = L^-1 k(sites, nodes), one more site is one more row of L and of V, so that it costs n m
    operations and not n^2 m; the mean goes back to a level far from all sites, which may change at no cost.
    """

    nodes: Floats  # (m, 2) [m]
    kernel: FieldKernel
    fitted_on: int  # sites
    place: Floats = field(init=False)  # (n, 2) [m]
    log: Floats = field(init=False)  # (n,)
    stated: Floats = field(init=False)  # (n,) variance of a site besides the kernel's noise
    surprise: list[float] = field(default_factory=list)  # standardised innovations of the sites since the fit

    @classmethod
    def of(cls, sites: Sites, nodes: Floats, level: float, kernel: FieldKernel | None = None) -> Self:
        """Return the field of sites, with the kernel fitted to them about a level; `kernel` is where the fit starts."""
        fitted_kernel = fit_kernel(sites.place, sites.log - level, _stated_variance(sites), kernel)
        field_of_sites = cls(nodes, fitted_kernel, len(sites))
        field_of_sites.factorise(sites)
        return field_of_sites

    def factorise(self, sites: Sites) -> None:
        """Factorise the covariance of sites, in place of those known so far, and whiten all columns by it."""
        self.place, self.log, self.stated = sites.place.copy(), sites.log.copy(), _stated_variance(sites)
        n = len(self.log)
        # Factor and whitened columns, with room for more sites.
        room = n + max(n // 2, _MIN_SPARE_ROWS)
        self._lower, self._cross = np.zeros((room, room)), np.zeros((room, len(self.nodes)))
        self._lower[:n, :n] = self.kernel.factor(sites)
        right = np.column_stack([self.log, np.ones(n), self.kernel.between(self.place, self.nodes)])
        solved = whiten(self._lower[:n, :n], right)
        self._white = np.zeros((room, 2))  # L^-1 of the logarithms, and of ones
        self._white[:n], self._cross[:n] = solved[:, :2], solved[:, 2:]
        # Sums over the sites, of which mean and variance at the nodes are made.
        self._sums = self._white[:n].T @ self._cross[:n]  # (2, m)
        self._variance = self.kernel.variance - (self._cross[:n] ** 2).sum(axis=0)

    def update(self, sites: Sites, level: float) -> StiffnessField:
        """Return the field of sites that begin with those known so far; else, or where the kernel has to change, a
        new one."""
        n = len(self.log)
        same_places = len(sites) >= n and np.array_equal(self.place, sites.place[:n])
        begins_alike = same_places and np.array_equal(self.log, sites.log[:n])
        if not begins_alike or len(sites) > _GROWTH * self.fitted_on:
            return type(self).of(sites, self.nodes, level, self.kernel)
        for place, log, stated in zip(sites.place[n:], sites.log[n:], _stated_variance(sites)[n:], strict=True):
            self.surprise.append(self.add(place, float(log), float(stated), level))
        return type(self).of(sites, self.nodes, level, self.kernel) if self._is_surprised() else self

    def _is_surprised(self) -> bool:
        """Return True if the innovations since the fit are larger than the kernel lets expect."""
        from scipy.stats import chi2

        square = float(np.square(self.surprise).sum())
        return bool(self.surprise and chi2.sf(square, len(self.surprise)) < _SURPRISE)

    def add(self, place: Floats, log: float, stated_variance: float, level: float) -> float:
        """Add a site and return its innovation about a level of the logarithm [standard deviations].

        A site is a place (2,) [m], the logarithm of its stiffness, and the variance that its estimator states of that.
        The covariance K of the sites has one row more, and its factor L with K = L L^T the row
        [row, pivot] = [L^-1 k, sqrt(k_0 - row.row)], k the covariances with the sites before and k_0 the variance. Each
        column that L^-1 whitens has one element more, (its new element - row.(whitened column))/pivot.
        """
        n = len(self.log)
        if n == len(self._lower):
            room = n // 2 + _MIN_SPARE_ROWS
            self._lower = np.pad(self._lower, ((0, room), (0, room)))
            self._cross, self._white = (np.pad(rows, ((0, room), (0, 0))) for rows in (self._cross, self._white))
        # The site's row of the factor.
        row = whiten(self._lower[:n, :n], self.kernel.between(self.place, place[None])[:, 0])
        variance = self.kernel.variance + self.kernel.noise + stated_variance + _JITTER
        pivot = float(np.sqrt(max(variance - float(row @ row), _JITTER)))
        self._lower[n, :n] = row
        self._lower[n, n] = pivot
        # The whitened covariances with the nodes (m,), and the whitened logarithm and constant 1.
        cross = (self.kernel.between(place[None], self.nodes)[0] - row @ self._cross[:n]) / pivot
        white = (np.array([log, 1.0]) - row @ self._white[:n]) / pivot
        self._cross[n] = cross
        self._white[n] = white
        # Mean and variance at the nodes are sums over the sites of products of whitened elements.
        self._sums += np.outer(white, cross)
        self._variance -= cross**2
        self.place = np.vstack([self.place, place])
        self.log = np.append(self.log, log)
        self.stated = np.append(self.stated, stated_variance)
        # Whitened log - level, which has a variance of 1.
        return float(white[0] - level * white[1])

    def mean(self, level: float) -> Floats:
        """Return the posterior mean (m,) at the nodes, about a level."""
        return np.asarray(level + self._sums[0] - level * self._sums[1])

    @property
    def std(self) -> Floats:
        """(m,) posterior standard deviation at the nodes."""
        return np.asarray(np.sqrt(np.maximum(self._variance, LEAST_STD**2)))

    def covariance(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Floats:
        """Return the posterior covariances of nodes of two index arrays."""
        n = len(self.log)
        prior = self.kernel.between(self.nodes[rows], self.nodes[columns])
        return np.asarray(prior - self._cross[:n, rows].T @ self._cross[:n, columns])


def _stated_variance(sites: Sites) -> Floats:
    """Return the variance (n,) of each site as its estimator states it, but for a least."""
    return np.maximum(sites.std, LEAST_STD) ** 2


def thinned(count: int, most: int) -> NDArray[np.intp]:
    """Return at most `most` indices of `count`, evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))
