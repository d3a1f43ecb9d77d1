"""A map on a grid: value and standard deviation of a parameter over an area, and where it is known at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, LogError

from palpate_maps.baseline_sites import background_sites, discoveries
from palpate_maps.body_field import BodyFit
from palpate_maps.lump_criteria import LumpSettings
from palpate_maps.sites import Sites, merge_sites
from palpate_maps.stiffness_field import interpolated

Method = Literal["gaussian-process", "average"]

# Choices of time and memory.
_MAX_CELLS = 250_000  # of a map
_MAX_DISTANCES = 4_000_000  # that are held at once: 32 MB
# Choices of the map's resolution and reach.
_MIN_SITES = 4  # of a map, and of a baseline that its cells are tested against
COVERED = 1.2  # line distances from a site, up to which a cell is covered: a little more than halfway to the next lines
LENGTH_OF_PITCH = 0.7  # least length of a field over the distance of lines or points (decision 0578)
MERGED = 3  # in a line distance: sites of a line that are nearer are one
MERGE_DISTANCE = 1e-3  # [m]: the spacing of sites
_AVERAGED = 0.6  # line distances: standard deviation of the weights of an average, so that lines overlap
_BESIDE = 10  # sites of a sweep from one to the next that was palpated at another time
_SAME_PLACE = 1e-4  # [m] below which two are one place
_NEAREST_QUANTILE = 0.9  # of the sites: a few at the end of a line have no neighbour
_BLIND_PLACES = 0.95  # of the cells, as of the places of what an exam excludes
_UNKNOWN_DISTANCE = 2e-3  # [m] between lines, where there is one site only


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
    blind_below: float  # [m] width at half its height of a lump that may lie between the sites unseen

    @property
    def coverage(self) -> float:
        """Share of the cells that are covered."""
        return float(self.covered.mean())


def make_map(
    sites: Sites, cell: float = 1e-3, method: Method = "gaussian-process", fit: BodyFit | None = None
) -> StiffnessMap:
    """Return the map of sites on a grid of cells [m]; covered where a site is within 1.2 distances of lines.

    Both methods work on the logarithm, whose standard deviation is relative. A Gaussian process has the bodies of a fit
    as they are, and interpolates what these leave.
    Raises ConfigurationError for an impossible cell, LogError for too few sites.
    """
    x, y, nodes = cells_over(sites, cell)
    pitch = line_distance(sites)
    # Mean and standard deviation of the logarithm at each node, from sites that are merged where they are dense.
    used = merge_sites(sites, max(pitch / MERGED, MERGE_DISTANCE))
    if method == "gaussian-process":
        mean, std, length = interpolated(used, nodes, float(np.median(used.log)), LENGTH_OF_PITCH * pitch, fit)
    else:
        mean, std, length = _average(used, nodes, _AVERAGED * pitch)
    # Covered cells have a value, and p-values against the baseline.
    shape = len(y), len(x)
    distance = nearest_distance(sites.place, nodes)
    covered = (distance <= COVERED * pitch).reshape(shape)
    value: Floats = np.where(covered, np.exp(mean).reshape(shape), np.nan)
    p, stiff = significance(sites, mean, std, covered.ravel())
    absolute_std = value * std.reshape(shape)
    return StiffnessMap(
        x=x,
        y=y,
        value=value,
        std=absolute_std,
        covered=covered,
        p=p.reshape(shape),
        stiff=stiff.reshape(shape),
        sites=sites.place,
        method=method,
        length=length,
        blind_below=blind_width(distance[covered.ravel()]),
    )


def blind_width(distance: Floats) -> float:
    """Return the width [m] below which a lump may lie where no site is in its upper half, by distances to sites (m,).

    Twice the distance that 95 % of the places do not exceed.
    """
    return 2 * float(np.quantile(distance, _BLIND_PLACES)) if len(distance) else float("inf")


def significance(sites: Sites, mean: Floats, std: Floats, covered: NDArray[np.bool_]) -> tuple[Floats, Any]:
    """Return the p-value of each cell (m,) against the baseline, and which are discoveries by default settings.

    t = (mean - baseline)/sqrt(spread^2 (1 + 1/k) + std^2) with k - 1 degrees of freedom; Benjamini and Hochberg's
    control over the covered cells, which is valid for neighbours that are alike (Benjamini and Yekutieli 2001).
    """
    from scipy import stats

    settings = LumpSettings()
    baseline = background_sites(merge_sites(sites, settings.width), settings.spread, settings.width)
    p, stiff = np.where(covered, 1.0, np.nan), np.zeros(len(mean), bool)
    if baseline.count >= _MIN_SITES:
        noise = np.sqrt(baseline.spread**2 * (1 + 1 / baseline.count) + std**2)
        p[covered] = stats.t.sf((mean - baseline.mean) / noise, baseline.count - 1)[covered]
        # Significant, and high enough to be reported.
        stiff[covered] = discoveries(p[covered], settings.rate)
        stiff &= mean - baseline.mean >= np.log1p(settings.contrast)
    return p, stiff


def cells_over(sites: Sites, cell: float) -> tuple[Floats, Floats, Floats]:
    """Return the axes (c,) and (r,) [m] of a grid of cells over sites, and its nodes (r c, 2), row by row.

    Raises ConfigurationError for an impossible cell, LogError for too few sites.
    """
    if len(sites) < _MIN_SITES:
        raise LogError(f"{len(sites)} sites are too few for a map")
    x, y = (_axis(sites.place[:, axis], cell) for axis in (0, 1))
    if len(x) * len(y) > _MAX_CELLS:
        raise ConfigurationError(f"cell: {1e3 * cell:g} mm makes {len(x) * len(y)} cells; {_MAX_CELLS} are allowed")
    return x, y, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _axis(values: Floats, cell: float) -> Floats:
    """Return the places of cells [m] over values (n,) [m]; raises ConfigurationError for an impossible cell."""
    if not (np.isfinite(cell) and cell > 0):
        raise ConfigurationError(f"cell: {cell!r} must be above 0")
    low, high = float(values.min()), float(values.max())
    count = max(round((high - low) / cell), 0) + 1
    steps = np.arange(count, dtype=float) - (count - 1) / 2
    return (low + high) / 2 + steps * cell


def line_distance(sites: Sites) -> float:
    """Return the distance [m] between lines or points.

    For nine sites in ten, the nearest one that was palpated at another time, ten sites away or more, is not farther; so
    lines that were swept twice do not count.
    """
    from scipy.spatial import KDTree

    places, count = sites.place, len(sites)
    neighbours_on_line = 1 if sites.standing.all() else _BESIDE
    tree, nearest = KDTree(places), np.full(count, np.inf)
    # More and more neighbours are asked for, of the sites that have none of another time so far. At first these are
    # doubled: as many as a site has on its own line, to both sides, do not count.
    remaining, neighbour_count = np.arange(count), 2 * neighbours_on_line
    while len(remaining) and neighbour_count < count:
        neighbour_count = min(2 * neighbour_count, count)
        for rows in _portions(remaining, neighbour_count):
            others = tree.query(places[rows], neighbour_count)[1]
            distance = np.linalg.norm(places[rows, None] - places[others], axis=2)
            same_time = np.abs(rows[:, None] - others) < neighbours_on_line
            distance[same_time | (distance < _SAME_PLACE)] = np.inf
            nearest[rows] = distance.min(axis=1)
        remaining = remaining[~np.isfinite(nearest[remaining])]
    finite = nearest[np.isfinite(nearest)]
    return float(np.quantile(finite, _NEAREST_QUANTILE)) if len(finite) else _UNKNOWN_DISTANCE


def _portions(rows: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """Return rows in portions whose distances to `count` others may be held at once."""
    return np.array_split(rows, max(len(rows) * count // _MAX_DISTANCES, 1))


def nearest_distance(places: Floats, nodes: Floats) -> Floats:
    """Return the distances (m,) [m] of nodes (m, k) from the nearest of places (n, k)."""
    from scipy.spatial import KDTree

    distance, _ = KDTree(places).query(nodes)
    return np.asarray(distance)


def _average(sites: Sites, nodes: Floats, length: float) -> tuple[Floats, Floats, float]:
    """Return the Gaussian-weighted mean of the sites around each node; scatter and belief make its deviation.

    Both count in full, as if the sites around a node were one observation: their errors are alike.
    """

    def mean_and_std(rows: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Return the weighted mean and the standard deviation of the logarithm at some nodes."""
        # The nearest site has the weight 1 before they are normalised, so that none is lost far from all.
        squared = ((nodes[rows, None] - sites.place[None]) ** 2).sum(axis=2)
        weight = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True)) / length**2)
        weight /= weight.sum(axis=1, keepdims=True)
        mean = weight @ sites.log
        scatter = weight @ sites.log**2 - mean**2
        return mean, np.sqrt(np.maximum(scatter, 0.0) + weight @ sites.std**2)

    portions = _portions(np.arange(len(nodes)), len(sites))
    mean, std = zip(*(mean_and_std(rows) for rows in portions), strict=True)
    return np.concatenate(mean), np.concatenate(std), length
