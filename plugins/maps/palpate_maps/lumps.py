"""Lumps: places that are significantly stiffer than their surroundings, along a sweep or on an area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError

from palpate_maps.baseline_sites import Baseline, background_sites, discoveries, prediction_p
from palpate_maps.cusum import by_cusum
from palpate_maps.line_peaks import by_prominence, curve_along
from palpate_maps.lump_criteria import Findings, Lump, LumpSettings
from palpate_maps.sites import Sites, line_coordinate, merge_sites

FEWEST = 8  # sites; fewer have no surroundings
_TELLING = 3  # points on a lump that place it without the sweeps
_WIDTH = 5e-3  # [m] from a stay to the first site of the sweep that goes on from it


def find_lumps(sites: Sites, settings: LumpSettings | None = None) -> Findings:
    """Lumps along a sweep where the sites lie on a line, else on the area that they cover; raises LogError."""
    settings = settings or LumpSettings()
    settings = replace(settings, spread=max(settings.spread, sites.relief))
    if len(sites) < FEWEST:
        raise LogError(
            f"{len(sites)} sites are too few to distinguish a lump from its surroundings; {FEWEST} are needed"
        )
    along = line_coordinate(sites)
    if along is not None and not sites.standing.all():
        curve = curve_along(sites, along, settings)
        return by_cusum(curve, settings) if settings.method == "cusum" else by_prominence(curve, settings)
    return _over(sites, settings)


def _over(sites: Sites, settings: LumpSettings) -> Findings:
    """Sites outside the prediction interval of the baseline sites, with false-discovery control, joined to lumps."""
    coarse = merge_sites(sites, settings.width)
    baseline = background_sites(coarse, settings.spread, settings.width)
    p = prediction_p(coarse.log, baseline)
    height = coarse.log - baseline.mean
    stiff = discoveries(p, settings.rate) & (height >= np.log1p(settings.contrast))
    reach = max(_reach(coarse.place), 1.6 * settings.width)
    lumps = [_lump(coarse, group, baseline, p) for group in clusters(coarse.place, stiff, reach)]
    name = f"prediction interval of {baseline.count} baseline sites"
    several = None if baseline.single else float(baseline.members.mean())
    return Findings(tuple(lumps), float(np.exp(baseline.mean)), baseline.spread, name, several=several)


def _reach(place: Floats) -> float:
    """How far apart neighbours may be [m]: 1.6 times the distance to the fourth nearest, of most sites."""
    from scipy.spatial import KDTree

    distance, _ = KDTree(place).query(place, k=min(5, len(place)))
    return 1.6 * float(np.median(distance[:, -1]))


def clusters(place: Floats, chosen: NDArray[np.bool_], reach: float) -> list[NDArray[np.intp]]:
    """Chosen sites joined where a chain of them has no step longer than `reach` [m], nor one past a site between.

    A site that is not chosen is between two where it lies in the circle, or over a surface the ball, about their middle
    (Gabriel and Sokal 1969).
    """
    others = place[~chosen]
    left = set(np.flatnonzero(chosen).tolist())
    found = []
    while left:
        group, open_ends = [], [min(left)]
        left.discard(open_ends[0])
        while open_ends:
            i = open_ends.pop()
            group.append(i)
            near = [j for j in sorted(left) if _are_joined(place[i], place[j], others, reach)]
            left.difference_update(near)
            open_ends += near
        found.append(np.array(sorted(group)))
    return found


def _are_joined(a: Floats, b: Floats, others: Floats, reach: float) -> bool:
    apart = float(np.linalg.norm(b - a))
    return apart <= reach and not bool((np.linalg.norm(others - (a + b) / 2, axis=1) < 0.499 * apart).any())


def _visits(sites: Sites) -> NDArray[np.bool_]:
    """(n,) point palpations that are not the stay from which a sweep continues."""
    way = np.linalg.norm(np.diff(sites.place, axis=0), axis=1)
    goes_on = np.r_[sites.standing[:-1] & ~sites.standing[1:] & (way < _WIDTH), False]
    return np.asarray(sites.standing & ~goes_on)


def _lump(sites: Sites, group: NDArray[np.intp], baseline: Baseline, p: Floats) -> Lump:
    """One lump of the sites in a group; neighbours that are raised by half its height belong to it, too."""
    height = sites.log - baseline.mean
    peak = group[int(np.argmax(height[group]))]
    size = float(np.ptp(sites.place[group], axis=0).max()) + 1e-3
    near = np.linalg.norm(sites.place - sites.place[peak], axis=1) <= max(size, _reach(sites.place))
    body = near & (height >= 0.5 * height[peak])
    body[group] = True
    weight = np.maximum(height[body], 0.0)
    points = _visits(sites)[body]
    if np.count_nonzero(points) >= _TELLING:  # sweeps pass where they pass; points were put where it is stiff
        weight = np.where(points, weight**2, 0.0)
    middle = weight @ sites.place[body] / weight.sum()
    extent = np.sqrt(12 * (weight @ (sites.place[body] - middle) ** 2) / weight.sum())
    std = float(np.hypot(baseline.spread, sites.std[peak]))
    contrast = float(np.expm1(height[peak]))
    (x, y, *above), (wide, high, *_), (top_x, top_y, *_) = (
        values.tolist() for values in (middle, extent, sites.place[peak])
    )
    chance, checked = float(p[group].min()), bool(points.any())
    raised = np.maximum(height[body], 0.0)
    away = sites.place[body] - raised @ sites.place[body] / raised.sum()
    *_, across, along = np.sqrt(12 * np.linalg.eigvalsh((raised[:, None] * away).T @ away / raised.sum()).clip(0.0))
    return Lump(
        (x, y),
        (wide, high),
        contrast,
        std,
        chance,
        checked=checked,
        highest=(top_x, top_y),
        height=above[0] if above else None,
        axes=(float(along), float(across)),
    )
