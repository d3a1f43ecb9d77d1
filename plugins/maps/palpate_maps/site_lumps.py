"""Lumps of an area by its stiff sites: groups of neighbours, and the middle, extent and contrast of one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_maps.baseline_sites import Baseline, discoveries, prediction_p
from palpate_maps.lump_criteria import Lump, LumpSettings
from palpate_maps.sites import Sites

# Choices, judged by the lumps that are found on simulated layouts (decisions 0084 and 0282).
_MIN_POINTS = 3  # point palpations of a lump that place it without the sweeps
_STAY_TO_SWEEP = 5e-3  # [m] from a stay to the first site of the sweep that goes on from it: a site's width and a pitch
_NEIGHBOURS = 4  # nearest sites: those of a square raster
_REACH = 1.6  # distances of neighbours, or site widths, that are one step of a chain: more than the diagonal's 1.4
_HALF_HEIGHT = 0.5  # of a lump: its extent is that of the sites above
_BETWEEN = 0.499  # of the distance of two sites: radius of the circle about their middle, without the sites themselves
_WIDE = 20e-3  # [m] across, from which on a group may be a stiff part of the area: twice the width of a small body
_FILLED = 0.7  # of the sites within its ellipse, that are then raised by half of its height
_INSCRIBED = 3.0  # squared distance over the variance of a uniform rectangle's places, of its middle from its sides
_MARGIN = 1e-3  # [m] about the sites of a group, so that one of a single site has a size


def stiff_groups(sites: Sites, baseline: Baseline, settings: LumpSettings) -> list[NDArray[np.intp]]:
    """Return the groups of neighbours that are significantly stiffer than a baseline, and by enough to be reported."""
    height = sites.log - baseline.mean
    stiff = discoveries(prediction_p(sites.log, baseline), settings.rate) & (height >= np.log1p(settings.contrast))
    return clusters(sites.place, stiff, max(neighbour_reach(sites.place), _REACH * settings.width))


def neighbour_reach(place: Floats) -> float:
    """Return the distance [m] up to which sites are neighbours: 1.6 times that to the fourth nearest, in the median."""
    from scipy.spatial import KDTree

    distance, _ = KDTree(place).query(place, k=min(_NEIGHBOURS + 1, len(place)))
    return _REACH * float(np.median(distance[:, -1]))


def clusters(place: Floats, chosen: NDArray[np.bool_], reach: float) -> list[NDArray[np.intp]]:
    """Return chosen sites in groups: chains with no step longer than `reach` [m], nor one past a site between.

    A site that is not chosen is between two where it lies in the circle, or over a surface the ball, about their middle
    (Gabriel and Sokal 1969).
    """
    unchosen = place[~chosen]
    remaining = set(np.flatnonzero(chosen).tolist())
    groups = []
    while remaining:
        # A group grows from its first site until none of its ends has a neighbour.
        group: list[int] = []
        ends = [min(remaining)]
        remaining.discard(ends[0])
        while ends:
            row = ends.pop()
            group.append(row)
            neighbours = [
                other for other in sorted(remaining) if _are_joined(place[row], place[other], unchosen, reach)
            ]
            remaining.difference_update(neighbours)
            ends += neighbours
        groups.append(np.array(sorted(group)))
    return groups


def _are_joined(a: Floats, b: Floats, unchosen: Floats, reach: float) -> bool:
    """Return True if two places are within reach, and no unchosen one lies in the circle about their middle."""
    distance = float(np.linalg.norm(b - a))
    if distance > reach:
        return False
    return not bool((np.linalg.norm(unchosen - (a + b) / 2, axis=1) < _BETWEEN * distance).any())


def is_visit(sites: Sites) -> NDArray[np.bool_]:
    """Return True (n,) for point palpations that are not the stay from which a sweep continues."""
    way = np.linalg.norm(np.diff(sites.place, axis=0), axis=1)
    begins_sweep = np.r_[sites.standing[:-1] & ~sites.standing[1:] & (way < _STAY_TO_SWEEP), False]
    return np.asarray(sites.standing & ~begins_sweep)


def lump_of_sites(sites: Sites, group: NDArray[np.intp], baseline: Baseline, p: Floats) -> Lump:
    """Return the lump of the sites in a group; neighbours that are raised by half its height belong to it, too.

    `baseline` is the mean and spread of the logarithms without lumps, `p` (n,) the p-value of each site. The extents
    are those of a uniform body with the variance of the weighted places: sqrt(12 variance).
    """
    height = sites.log - baseline.mean
    peak = int(group[int(np.argmax(height[group]))])
    body = _body(sites.place, height, group, peak)
    points = is_visit(sites)[body]
    place, raised = sites.place[body], np.maximum(height[body], 0.0)
    # Sweeps pass where they pass; points were put where it is stiff, so that enough of them place it alone.
    weight = raised
    if np.count_nonzero(points) >= _MIN_POINTS:
        weight = np.where(points, raised**2, 0.0)
    middle = weight @ place / weight.sum()
    # A uniform body of width w has the variance w^2/12.
    extent = np.sqrt(12 * (weight @ (place - middle) ** 2) / weight.sum())
    return Lump(
        place=(float(middle[0]), float(middle[1])),
        extent=(float(extent[0]), float(extent[1])),
        contrast=float(np.expm1(height[peak])),
        contrast_std=float(np.exp(height[peak]) * np.hypot(baseline.spread, sites.std[peak])),
        p=float(p[group].min()),
        checked=bool(points.any()),
        highest=(float(sites.place[peak, 0]), float(sites.place[peak, 1])),
        height=float(middle[2]) if len(middle) > 2 else None,
        axes=_main_axes(place, raised),
    )


def is_wide(sites: Sites, group: NDArray[np.intp], baseline: Baseline) -> bool:
    """Return True for a group of sites that is a stiff part of the area: wider than small bodies, and without gaps."""
    height = sites.log - baseline.mean
    peak = int(group[int(np.argmax(height[group]))])
    body = _body(sites.place, height, group, peak)
    place, raised = sites.place[body], np.maximum(height[body], 0.0)
    if _main_axes(place, raised)[1] < _WIDE:
        return False
    # Of the sites within the ellipse of its second moments, those that are raised by half of its height.
    middle = raised @ place / raised.sum()
    covariance = (raised[:, None] * (place - middle)).T @ (place - middle) / raised.sum()
    inside = _distances_squared(sites.place - middle, covariance) <= _INSCRIBED
    return bool(np.mean(height[inside] >= _HALF_HEIGHT * height[peak]) >= _FILLED)


def _distances_squared(offset: Floats, covariance: Floats) -> Floats:
    """Return the squared distances (n,) of offsets (n, k) [m] over a covariance (k, k) [m^2], by its main axes."""
    return np.asarray(((offset @ np.linalg.pinv(covariance, hermitian=True)) * offset).sum(axis=1))


def _body(place: Floats, height: Floats, group: NDArray[np.intp], peak: int) -> NDArray[np.bool_]:
    """Return True (n,) for the sites of a group, and those near its peak that are raised by half of its height."""
    size = float(np.ptp(place[group], axis=0).max()) + _MARGIN
    near = np.linalg.norm(place - place[peak], axis=1) <= max(size, neighbour_reach(place))
    body = near & (height >= _HALF_HEIGHT * height[peak])
    body[group] = True
    return np.asarray(body)


def _main_axes(place: Floats, weight: Floats) -> tuple[float, float]:
    """Return the extents [m] of weighted places along their longest direction and across, of a uniform body.

    Of places (n, k) [m] with weights (n,). A uniform body of width w has the variance w^2/12.
    """
    offset = place - weight @ place / weight.sum()
    variances = np.linalg.eigvalsh((weight[:, None] * offset).T @ offset / weight.sum())
    *_, across, along = np.sqrt(12 * variances.clip(0.0)).tolist()
    return along, across
