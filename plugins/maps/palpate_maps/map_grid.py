"""A map on a grid: value and standard deviation of a parameter over an area, and where it is known at all."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, LogError

from palpate_maps.baseline_sites import discoveries, find_baseline
from palpate_maps.lump_criteria import LumpSettings
from palpate_maps.sites import Sites, merge_sites

Method = Literal["gaussian-process", "average"]

_MOST_FITTED = 250  # sites that the length scale is fitted on; more cost time, not accuracy
_MOST_USED = 1500
MOST_CELLS = 250_000
_LEAST_STD = 1e-3  # of a site's logarithm
_TOGETHER = 4_000_000  # distances that are held at once


@dataclass(frozen=True)
class StiffnessMap:
    """A parameter over an area; rows go with y, columns with x; NaN where no site is near."""

    x: Floats  # (nx,) [m]
    y: Floats  # (ny,) [m]
    value: Floats  # (ny, nx) [SI]
    std: Floats  # (ny, nx) [SI]
    covered: NDArray[np.bool_]  # (ny, nx) near enough to a site
    p: Floats  # (ny, nx) chance that a place without a lump is as stiff; NaN where not covered
    stiff: NDArray[np.bool_]  # (ny, nx) stiffer than the baseline, with false discoveries controlled
    sites: Floats  # (n, 2) [m] where it was palpated
    method: str
    length: float  # [m] over which it was interpolated

    @property
    def coverage(self) -> float:
        """Share of the cells that are covered."""
        return float(self.covered.mean())


def make_map(sites: Sites, cell: float = 1e-3, method: Method = "gaussian-process") -> StiffnessMap:
    """The map of sites on a grid of cells [m]; covered where a site is nearer than 1.2 times the lines' distance.

    Both methods work on the logarithm, whose
    standard deviation is relative. Raises ConfigurationError for an impossible cell, LogError for too few sites.
    """
    if len(sites) < 4:
        raise LogError(f"{len(sites)} sites are too few for a map")
    x, y = (axis_of(sites.place[:, axis], cell) for axis in (0, 1))
    if len(x) * len(y) > MOST_CELLS:
        raise ConfigurationError(f"cell: {1e3 * cell:g} mm makes {len(x) * len(y)} cells; {MOST_CELLS} are allowed")
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pitch = line_distance(sites)
    used = merge_sites(sites, max(pitch / 3, 1e-3))
    if method == "gaussian-process":
        mean, std, length = gaussian_process(used, nodes)
    else:
        mean, std, length = _average(used, nodes, 0.6 * pitch)
    shape = len(y), len(x)
    nearest = nearest_distance(sites.place, nodes)
    covered = (nearest <= 1.2 * pitch).reshape(shape)
    value: Floats = np.where(covered, np.exp(mean).reshape(shape), np.nan)
    p, stiff = significance(sites, mean, std, covered.ravel())
    spread = value * std.reshape(shape)
    return StiffnessMap(
        x, y, value, spread, covered, p.reshape(shape), stiff.reshape(shape), sites.place, method, length
    )


def significance(sites: Sites, mean: Floats, std: Floats, covered: NDArray[np.bool_]) -> tuple[Floats, Any]:
    """p-value of each cell (m,) against the baseline sites, and which are discoveries by the default settings of lumps.

    t = (mean - baseline)/sqrt(spread^2 (1 + 1/k) + std^2) with k - 1 degrees of freedom; Benjamini and Hochberg's
    control over the covered cells, which is valid for neighbours that are alike (Benjamini and Yekutieli 2001).
    """
    from scipy import stats

    settings = LumpSettings()
    baseline = find_baseline(merge_sites(sites, settings.width).log, floor=settings.spread)
    p, stiff = np.where(covered, 1.0, np.nan), np.zeros(len(mean), bool)
    if baseline.count >= 4:
        noise = np.sqrt(baseline.spread**2 * (1 + 1 / baseline.count) + std**2)
        found = stats.t.sf((mean - baseline.mean) / noise, baseline.count - 1)
        p[covered] = found[covered]
        stiff[covered] = discoveries(p[covered], settings.rate)
        stiff &= mean - baseline.mean >= np.log1p(settings.contrast)
    return p, stiff


def axis_of(values: Floats, cell: float) -> Floats:
    """Places of cells [m] over values (n,) [m]; raises ConfigurationError for an impossible cell."""
    if not (np.isfinite(cell) and cell > 0):
        raise ConfigurationError(f"cell: {cell!r} must be above 0")
    low, high = float(values.min()), float(values.max())
    count = max(round((high - low) / cell), 0) + 1
    steps = np.arange(count, dtype=float) - (count - 1) / 2
    return (low + high) / 2 + steps * cell


def line_distance(sites: Sites) -> float:
    """Distance [m] between lines or points.

    For nine sites in ten, the nearest one that was palpated at another time, ten sites away or more, is no farther; so
    lines that were swept twice do not count.
    """
    order, beside = np.arange(len(sites)), 1 if sites.standing.all() else 10

    def alone(rows: NDArray[np.intp]) -> Floats:
        apart = np.linalg.norm(sites.place[rows, None] - sites.place[None], axis=2)
        apart[(np.abs(rows[:, None] - order[None]) < beside) | (apart < 1e-4)] = np.inf
        return np.asarray(apart.min(axis=1))

    nearest = np.concatenate([alone(rows) for rows in _portions(len(sites), len(sites))])
    known = nearest[np.isfinite(nearest)]
    return float(np.quantile(known, 0.9)) if len(known) else 2e-3


def _portions(count: int, others: int) -> list[NDArray[np.intp]]:
    """Indices of `count` things in portions whose distances to all of the `others` may be held at once."""
    return np.array_split(np.arange(count), max(count * others // _TOGETHER, 1))


def nearest_distance(places: Floats, nodes: Floats) -> Floats:
    """(m,) [m] distance of nodes (m, k) from the nearest of places (n, k)."""
    from scipy.spatial import KDTree

    distance, _ = KDTree(places).query(nodes)
    return np.asarray(distance)


def _average(sites: Sites, nodes: Floats, length: float) -> tuple[Floats, Floats, float]:
    """Mean of the sites around each node with Gaussian weights; scatter and belief make its standard deviation.

    Both count in full, as if the sites around a node were one observation: their errors are alike.
    """

    def around(rows: NDArray[np.intp]) -> tuple[Floats, Floats]:
        squared = ((nodes[rows, None] - sites.place[None]) ** 2).sum(axis=2)
        weight = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True)) / length**2)
        weight /= weight.sum(axis=1, keepdims=True)
        mean = weight @ sites.log
        scatter = weight @ sites.log**2 - mean**2
        return mean, np.sqrt(np.maximum(scatter, 0.0) + weight @ sites.std**2)

    mean, std = zip(*(around(rows) for rows in _portions(len(nodes), len(sites))), strict=True)
    return np.concatenate(mean), np.concatenate(std), length


def gaussian_process(sites: Sites, nodes: Floats, level: float | None = None) -> tuple[Floats, Floats, float]:
    """Posterior mean and standard deviation of the logarithm at nodes (m, 2), and the length scale [m].

    Far from every site it goes back to `level`, by default the median.

    Kernel: variance x Matern 3/2, whose length is fitted by likelihood, plus white noise between sites; each site has
    its own variance on top (Rasmussen and Williams 2006, by scikit-learn).
    """
    try:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.gaussian_process import GaussianProcessRegressor as Regressor
        from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel
        from threadpoolctl import threadpool_limits
    except ImportError as error:
        raise ConfigurationError(
            'method "gaussian-process" needs scikit-learn: pip install scikit-learn, or choose "average"'
        ) from error
    level = float(np.median(sites.log)) if level is None else level
    spread = max(float(sites.log.std()), 1e-3)
    kernel: Any = ConstantKernel(spread**2, (1e-8, 1e2)) * Matern(6e-3, (2e-3, 5e-2), nu=1.5)
    kernel = kernel + WhiteKernel(1e-4, (1e-8, 1e-1))
    regressor: Any = Regressor
    rows = _thinned(len(sites), _MOST_FITTED)
    own = np.maximum(sites.std, _LEAST_STD) ** 2
    # One thread: a few hundred sites are too few for several, which wait for one another on a busy machine.
    with warnings.catch_warnings(), threadpool_limits(1, user_api="blas"):
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound is what a level map asks for
        fitted = regressor(kernel, alpha=own[rows]).fit(sites.place[rows], sites.log[rows] - level)
        rows = _thinned(len(sites), _MOST_USED)
        process = regressor(fitted.kernel_, alpha=own[rows], optimizer=None)
        process.fit(sites.place[rows], sites.log[rows] - level)
    # The white noise is that of a site, not of the field that is asked for.
    process.kernel_.k2.noise_level = 1e-12
    blocks = [process.predict(block, return_std=True) for block in np.array_split(nodes, max(len(nodes) // 2000, 1))]
    mean, std = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return mean + level, np.maximum(std, _LEAST_STD), float(fitted.kernel_.k1.k2.length_scale)


def _thinned(count: int, most: int) -> NDArray[np.intp]:
    """Indices of at most so many of `count`, evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
