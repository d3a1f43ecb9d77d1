"""A map on a grid: value and standard deviation of a parameter over an area, and where it is known at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, LogError

from palpate_maps.baseline_sites import background_sites, discoveries
from palpate_maps.lump_criteria import LumpSettings
from palpate_maps.sites import Sites, merge_sites
from palpate_maps.stiffness_field import interpolated

Method = Literal["gaussian-process", "average"]

_MOST_CELLS = 250_000
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
    x, y, nodes = cells_over(sites, cell)
    pitch = line_distance(sites)
    used = merge_sites(sites, max(pitch / 3, 1e-3))
    if method == "gaussian-process":
        mean, std, length = interpolated(used, nodes, float(np.median(used.log)))
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
    baseline = background_sites(merge_sites(sites, settings.width), settings.spread, settings.width)
    p, stiff = np.where(covered, 1.0, np.nan), np.zeros(len(mean), bool)
    if baseline.count >= 4:
        noise = np.sqrt(baseline.spread**2 * (1 + 1 / baseline.count) + std**2)
        found = stats.t.sf((mean - baseline.mean) / noise, baseline.count - 1)
        p[covered] = found[covered]
        stiff[covered] = discoveries(p[covered], settings.rate)
        stiff &= mean - baseline.mean >= np.log1p(settings.contrast)
    return p, stiff


def cells_over(sites: Sites, cell: float) -> tuple[Floats, Floats, Floats]:
    """Axes (c,) and (r,) [m] of a grid of cells over sites, and its nodes (r c, 2), row by row.

    Raises ConfigurationError for an impossible cell, LogError for too few sites.
    """
    if len(sites) < 4:
        raise LogError(f"{len(sites)} sites are too few for a map")
    x, y = (_axis(sites.place[:, axis], cell) for axis in (0, 1))
    if len(x) * len(y) > _MOST_CELLS:
        raise ConfigurationError(f"cell: {1e3 * cell:g} mm makes {len(x) * len(y)} cells; {_MOST_CELLS} are allowed")
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _axis(values: Floats, cell: float) -> Floats:
    """Places of cells [m] over values (n,) [m]; raises ConfigurationError for an impossible cell."""
    if not (np.isfinite(cell) and cell > 0):
        raise ConfigurationError(f"cell: {cell!r} must be above 0")
    low, high = float(values.min()), float(values.max())
    count = max(round((high - low) / cell), 0) + 1
    steps = np.arange(count, dtype=float) - (count - 1) / 2
    return (low + high) / 2 + steps * cell


def line_distance(sites: Sites) -> float:
    """Distance [m] between lines or points.

    For nine sites in ten, the nearest one that was palpated at another time, ten sites away or more, is not farther; so
    lines that were swept twice do not count.
    """
    from scipy.spatial import KDTree

    places, count, beside = sites.place, len(sites), 1 if sites.standing.all() else 10
    tree, nearest, left, near = KDTree(places), np.full(count, np.inf), np.arange(count), 2 * beside
    while len(left) and near < count:
        near = min(2 * near, count)
        for rows in _portions(left, near):
            others = tree.query(places[rows], near)[1]
            apart = np.linalg.norm(places[rows, None] - places[others], axis=2)
            apart[(np.abs(rows[:, None] - others) < beside) | (apart < 1e-4)] = np.inf
            nearest[rows] = apart.min(axis=1)
        left = left[~np.isfinite(nearest[left])]
    known = nearest[np.isfinite(nearest)]
    return float(np.quantile(known, 0.9)) if len(known) else 2e-3


def _portions(rows: NDArray[np.intp], others: int) -> list[NDArray[np.intp]]:
    """Rows in portions whose distances to so many others may be held at once."""
    return np.array_split(rows, max(len(rows) * others // _TOGETHER, 1))


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

    mean, std = zip(*(around(rows) for rows in _portions(np.arange(len(nodes)), len(sites))), strict=True)
    return np.concatenate(mean), np.concatenate(std), length
