"""Lumps: places that are significantly stiffer than their surroundings, along a sweep or on an area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import LogError
from palpate.maps.baseline import Baseline, discoveries, find_baseline, prediction_p
from palpate.maps.sites import Sites, line_coordinate

Floats = NDArray[np.float64]

_GRID = 2.5e-4  # [m] between points of a sweep's curve
# What an estimator believes of its error is mostly common to neighbours and drops out of a difference. On homogeneous
# simulated sweeps, smoothed over 4 mm, 0.3 (kinematic filter) to 0.7 (AFUKF) of it is left as scatter along the sweep.
_KEPT = 0.7
_FEWEST = 8  # sites; with fewer there are no surroundings


@dataclass(frozen=True)
class LumpSettings:
    """What counts as a lump."""

    rate: float = 0.005  # false-discovery rate; where there is no lump, the chance of finding one
    contrast: float = 0.04  # smaller ones are not reported, however significant
    spread: float = 0.005  # standard deviation of the stiffness between sites that is always believed, relative
    width: float = 4e-3  # [m] of a site: of the order of the contact's diameter


@dataclass(frozen=True)
class Lump:
    """A place that is stiffer than its surroundings."""

    place: tuple[float, float]  # [m] its middle
    extent: tuple[float, float]  # [m] at half its height: along and across a sweep, or along x and y
    contrast: float  # peak over surroundings, minus 1
    contrast_std: float
    p: float  # the chance of one like it where there is none
    along: float = float("nan")  # [m] its middle along a sweep
    checked: bool = False  # palpated at a point of it, too


@dataclass(frozen=True)
class Findings:
    """The lumps of a run, and what they were told by."""

    lumps: tuple[Lump, ...]
    background: float  # [SI]
    spread: float  # relative, between sites or along the sweep
    method: str
    coordinate: Floats | None = None  # (m,) [m] along a sweep
    curve: Floats | None = None  # (m,) [SI] smoothed along it


def find_lumps(sites: Sites, settings: LumpSettings | None = None) -> Findings:
    """Lumps along a sweep where the sites lie on a line, else on the area that they cover; raises LogError."""
    settings = settings or LumpSettings()
    if len(sites) < _FEWEST:
        raise LogError(f"{len(sites)} sites are too few to tell a lump from its surroundings; {_FEWEST} are needed")
    along = line_coordinate(sites)
    if along is not None and not sites.standing.all():
        return _along(sites, along, settings)
    return _over(sites, settings)


def _along(sites: Sites, along: Floats, settings: LumpSettings) -> Findings:
    """Peaks of the smoothed logarithm that stand out from the higher of the valleys beside them.

    The height of a peak over its higher valley (its prominence) is a difference of two means over `width`, both picked
    from the m that the sweep has room for. p = m(m - 1)/2 x the two-sided normal tail of that difference.
    """
    from scipy import signal, stats

    grid = np.arange(along.min(), along.max(), _GRID)
    if len(grid) * _GRID < 3 * settings.width:
        raise LogError(f"a sweep of {1e3 * len(grid) * _GRID:.3g} mm is too short to tell a lump from its surroundings")
    kernel = np.exp(-0.5 * ((grid[:, None] - along[None]) / (settings.width / np.sqrt(12))) ** 2)
    kernel /= np.maximum(kernel.sum(axis=1, keepdims=True), 1e-300)
    curve = kernel @ sites.log
    noise = np.sqrt(settings.spread**2 + _KEPT**2 * (kernel @ sites.std**2))
    peaks, found = signal.find_peaks(curve, prominence=np.log1p(settings.contrast))
    widths, _, left, right = signal.peak_widths(curve, peaks, rel_height=0.5)
    rooms = max((grid[-1] - grid[0]) / settings.width, 2.0)
    pairs = rooms * (rooms - 1) / 2
    line = _LineBack(sites.place, along)
    lumps = []
    for k, peak in enumerate(peaks):
        valleys = found["left_bases"][k], found["right_bases"][k]
        valley = max(valleys, key=lambda v: curve[v])
        std = float(np.hypot(noise[peak], noise[valley]))
        height = float(found["prominences"][k])
        p = min(1.0, pairs * 2 * float(stats.norm.sf(height / std)))
        if p <= settings.rate:
            middle = float(np.interp((left[k] + right[k]) / 2, np.arange(len(grid)), grid))
            extent = float(widths[k]) * _GRID
            lumps.append(Lump(line.at(middle), (extent, 0.0), float(np.expm1(height)), std, p, middle))
    background = float(np.exp(np.quantile(curve, 0.25)))
    spread = float(np.median(noise))
    return Findings(tuple(lumps), background, spread, "prominence along the sweep", grid, np.exp(curve))


class _LineBack:
    """From a coordinate along the line to the place."""

    def __init__(self, place: Floats, along: Floats) -> None:
        design = np.column_stack([np.ones(len(along)), along])
        self._line, *_ = np.linalg.lstsq(design, place, rcond=None)

    def at(self, along: float) -> tuple[float, float]:
        """Place at a coordinate."""
        x, y = np.array([1.0, along]) @ self._line
        return float(x), float(y)


def _over(sites: Sites, settings: LumpSettings) -> Findings:
    """Sites outside the prediction interval of the baseline sites, with false-discovery control, joined to lumps."""
    coarse = merged(sites, settings.width)
    baseline = find_baseline(coarse.log, floor=settings.spread)
    p = prediction_p(coarse.log, baseline)
    height = coarse.log - baseline.mean
    stiff = discoveries(p, settings.rate) & (height >= np.log1p(settings.contrast))
    reach = _reach(coarse.place)
    lumps = [_lump(coarse, group, baseline, p) for group in clusters(coarse.place, stiff, reach)]
    name = f"prediction interval of {baseline.count} baseline sites"
    return Findings(tuple(lumps), float(np.exp(baseline.mean)), baseline.spread, name)


def merged(sites: Sites, width: float) -> Sites:
    """Sites of a sweep joined until each has about a given width [m]; those of stays as they are."""
    gap = np.r_[0.0, np.linalg.norm(np.diff(sites.place, axis=0), axis=1)]
    groups, way, group = np.zeros(len(sites), int), 0.0, 0
    for i in range(1, len(sites)):
        way += float(gap[i])
        if way >= width - 1e-9 or sites.standing[i] or sites.standing[i - 1] or gap[i] > width:
            group, way = group + 1, 0.0
        groups[i] = group
    count = np.bincount(groups)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(groups, values) / count)

    place = np.column_stack([mean(sites.place[:, 0]), mean(sites.place[:, 1])])
    std = np.sqrt(mean(sites.std**2))
    return Sites(place, mean(sites.log), std, mean(sites.time), mean(sites.standing.astype(float)) > 0.5)


def _reach(place: Floats) -> float:
    """How far apart neighbours may be [m]: 1.6 times the distance to the fourth nearest, of most sites."""
    distance = np.sort(np.linalg.norm(place[:, None] - place[None], axis=2), axis=1)
    return 1.6 * float(np.median(distance[:, min(4, len(place) - 1)]))


def clusters(place: Floats, chosen: NDArray[np.bool_], reach: float) -> list[NDArray[np.intp]]:
    """Chosen sites joined where a chain of them has no step longer than `reach` [m]."""
    left = set(np.flatnonzero(chosen).tolist())
    found = []
    while left:
        group, open_ends = [], [min(left)]
        left.discard(open_ends[0])
        while open_ends:
            i = open_ends.pop()
            group.append(i)
            near = [j for j in sorted(left) if np.hypot(*(place[j] - place[i])) <= reach]
            left.difference_update(near)
            open_ends += near
        found.append(np.array(sorted(group)))
    return found


def _lump(sites: Sites, group: NDArray[np.intp], baseline: Baseline, p: Floats) -> Lump:
    """One lump of the sites in a group; neighbours that are raised by half its height belong to it, too."""
    height = sites.log - baseline.mean
    peak = group[int(np.argmax(height[group]))]
    size = float(np.ptp(sites.place[group], axis=0).max()) + 1e-3
    near = np.linalg.norm(sites.place - sites.place[peak], axis=1) <= max(size, _reach(sites.place))
    body = near & (height >= 0.5 * height[peak])
    body[group] = True
    weight = np.maximum(height[body], 0.0)
    points = sites.standing[body]
    if points.any():  # sweeps pass where they pass; points were put where it is stiff
        weight = np.where(points, weight**2, 0.0)
    middle = weight @ sites.place[body] / weight.sum()
    extent = np.sqrt(12 * (weight @ (sites.place[body] - middle) ** 2) / weight.sum())
    std = float(np.hypot(baseline.spread, sites.std[peak]))
    contrast = float(np.expm1(height[peak]))
    (x, y), (wide, high) = middle.tolist(), extent.tolist()
    return Lump((x, y), (wide, high), contrast, std, float(p[group].min()), checked=bool(points.any()))
