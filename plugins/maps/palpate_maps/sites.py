"""Sites: an estimate along a path, place by place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError

from palpate_maps.path_reader import Path2D
from palpate_maps.relief_scatter import relief_scatter

# Choices; sweeps of the benchmarks go at 2 to 6 mm/s, and a point is pressed for 2 s or more.
_WINDOW = 0.5  # [s] over which it is decided whether the tip moves
_MIN_WINDOW = 0.1  # [s] of it at the ends of a stretch
_STANDING_SPEED = 5e-4  # [m/s]; below it the tip stands
_STAY_END = 0.5  # [s] at the end of a stay that count
_WARM_UP = 1.0  # [s] from a filter's first estimate that do not count
_PAUSE = 0.3  # [s] without estimates that ends a stretch
# What an estimator assumes of its error is mostly common to neighbours and drops out of a difference. Of homogeneous
# simulated sweeps, 0.3 (kinematic filter) to 0.7 (AFUKF) of it is left as scatter along the sweep (decision 0080).
KEPT = 0.7
_MIN_KEPT = 0.2  # of a share that a stay determines: a choice
_MIN_PIECES = 12  # of a stay that determine its scatter, to within a fifth (decision 0080)
_MAX_LINE_WIDTH = 2e-3  # [m] across: two sites of the default spacing; rows further apart are an area (choice)
# Cosine of 2.6 degrees, the angle to x or y up to which a line is along that axis: its coordinate makes ways
# along the line shorter by 0.1 % at most (choice).
_MIN_AXIS_COSINE = 0.999
_ROUNDING = 1e-9  # [m] of a way that a site's width is compared with


@dataclass(frozen=True)
class Sites:
    """Places and what was estimated there; the logarithm, since contrasts are ratios."""

    place: Floats  # (n, 2) [m], or (n, 3) on a surface
    log: Floats  # (n,) logarithm of the parameter's SI value
    std: Floats  # (n,) standard deviation of that logarithm, as the estimator gives it
    time: Floats  # (n,) [s]
    standing: NDArray[np.bool_]  # (n,) a point palpation, not a piece of a sweep
    kept: float = KEPT  # share of `std` that is scatter between neighbours, and not common to them
    relief: float = 0.0  # scatter, relative, that comes of a relief which the estimator does not know

    def __len__(self) -> int:
        return len(self.log)

    def __getitem__(self, rows: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Sites:
        columns = (self.place[rows], self.log[rows], self.std[rows], self.time[rows], self.standing[rows])
        return Sites(*columns, self.kept, self.relief)

    @property
    def value(self) -> Floats:
        """(n,) the parameter [SI]."""
        return np.exp(self.log)


def sites_along(path: Path2D, spacing: float = 1e-3) -> Sites:
    """Return the sites of a path: one for each `spacing` [m] of a sweep, one for each stay at a place.

    `path` has the estimates of one track by time [s] and place [m]. A sweep's site is the mean over its piece of the
    way; a stay's site the mean over its last half second. The standard deviation of neighbouring samples is that of one
    of them, since a filter's errors are alike over many samples. The first second of a filter's estimates does not
    count.
    """
    standing: NDArray[np.bool_] = np.asarray(~travel_directions(path.time, path.place).any(axis=1))
    # A new stretch wherever the tip stops, starts or pauses, and in it a site for each piece of the way.
    step = np.r_[0.0, np.linalg.norm(np.diff(path.place, axis=0), axis=1)]
    pauses = np.r_[True, np.diff(path.time) > _PAUSE]
    moves = pauses | np.r_[True, np.diff(standing.astype(int)) != 0]
    stretch = np.cumsum(moves) - 1
    way = _since(_smoothed_way(path, step), moves)
    labels = np.column_stack([stretch, np.where(standing, 0, np.floor(way / spacing))])
    groups = np.unique(labels, axis=0, return_inverse=True)[1].ravel()
    # Of a stay its end counts, of all after the warm-up.
    counted = path.time >= path.time[0] + _WARM_UP
    last = np.zeros(groups.max() + 1)
    np.maximum.at(last, groups, path.time)
    counted &= ~standing | (path.time >= last[groups] - _STAY_END)
    if not counted.any():
        raise LogError(f"{path.track}: the estimates last {path.time[-1] - path.time[0]:.2g} s, too short for any site")
    means = _means(path, groups, counted, standing)
    return replace(means, kept=_kept_share(path, standing, spacing), relief=relief_scatter(path, standing))


def _kept_share(path: Path2D, standing: NDArray[np.bool_], spacing: float) -> float:
    """Return the share of a site's standard deviation that is scatter, determined from the stay before a sweep.

    `standing` (n,) is True for the estimates at which the tip stood. There the material does not change: what the
    estimate does, in pieces as long as the sweep takes for one site, is scatter. A stay that is too short, or in which
    the estimate still settles, determines nothing: then the value known from simulated sweeps applies.
    """
    moving = np.flatnonzero(~standing)
    if not len(moving):
        return KEPT
    # Time [s] that the sweep takes for one site.
    way = np.linalg.norm(np.diff(path.place[moving], axis=0), axis=1).sum()
    piece = spacing * len(moving) * float(np.median(np.diff(path.time))) / max(float(way), spacing)
    stay = standing & (path.time >= path.time[0] + _WARM_UP) & (path.time < path.time[moving[0]])
    if not stay.any():
        return KEPT
    # Means over pieces of the stay; the last one is not whole.
    number = np.floor((path.time[stay] - path.time[stay][0]) / piece).astype(int)
    count = np.bincount(number)[:-1]
    means = np.bincount(number, np.log(path.value[stay]))[:-1] / np.maximum(count, 1)
    means = means[count > 0]
    if len(means) < _MIN_PIECES:
        return KEPT
    # Their scatter over the standard deviation of a site, more by 1/sqrt(n) since it is of n pieces only.
    stated = _widening(path) * float(np.sqrt(np.mean((path.std[stay] / path.value[stay]) ** 2)))
    share = means.std(ddof=1) / stated * (1 + 1 / np.sqrt(len(means)))
    return float(np.clip(share, _MIN_KEPT, KEPT))


def _means(path: Path2D, groups: NDArray[np.intp], counted: NDArray[np.bool_], standing: NDArray[np.bool_]) -> Sites:
    """Return the sites of groups (n,) of a path's estimates, as means of those that count.

    Their deviations are wider where the filter's normalised innovation squared (NIS) is above 1.
    """
    weight = counted.astype(float)
    total = np.bincount(groups, weight)
    has_estimates = total > 0

    def mean(values: Floats) -> Floats:
        """Return the mean of values (n,) in each group that has estimates which count."""
        return np.asarray(np.bincount(groups, weight * values)[has_estimates] / total[has_estimates])

    logs = np.log(path.value)
    return Sites(
        place=np.column_stack([mean(path.place[:, 0]), mean(path.place[:, 1])]),
        log=mean(logs),
        std=np.sqrt(mean((path.std / path.value) ** 2)) * _widening(path),
        time=mean(path.time),
        standing=mean(standing.astype(float)) > 0.5,  # in most of its estimates
    )


def _widening(path: Path2D) -> float:
    """Return the factor of a filter's standard deviation where its innovations are larger than it expects."""
    return float(np.sqrt(max(path.nis, 1.0)))


def travel_directions(time: Floats, place: Floats) -> Floats:
    """Return unit vectors (n, 2) of the tip's way at times (n,) [s] and places (n, 2) [m]; zeros where it stands.

    It stands where it goes less than half a millimetre a second, looking a quarter of a second each way.
    """
    # First and last estimate of the stretch that each is in, beyond which nothing is interpolated.
    begins = np.flatnonzero(np.r_[True, np.diff(time) > _PAUSE])
    ends = np.r_[begins[1:], len(time)] - 1
    stretch = np.searchsorted(begins, np.arange(len(time)), side="right") - 1
    early = np.maximum(time - _WINDOW / 2, time[begins][stretch])
    late = np.minimum(time + _WINDOW / 2, time[ends][stretch])
    moved = np.column_stack([np.interp(late, time, along) - np.interp(early, time, along) for along in place.T])
    length = np.hypot(*moved.T)
    standing = length < _STANDING_SPEED * np.maximum(late - early, _MIN_WINDOW)
    return np.where(standing[:, None], 0.0, moved / np.where(standing, 1.0, length)[:, None])


def _smoothed_way(path: Path2D, step: Floats) -> Floats:
    """Return the way [m] along the path without the noise of positions: of places a quarter of a second apart."""
    if len(step) < 2:
        return np.zeros(len(step))
    ticks = np.arange(path.time[0], path.time[-1] + _WINDOW / 2, _WINDOW / 2)
    x, y = (np.interp(ticks, path.time, path.place[:, axis]) for axis in (0, 1))
    way = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    return np.asarray(np.interp(path.time, ticks, way))


def _since(way: Floats, begins: NDArray[np.bool_]) -> Floats:
    """Return the way (n,) [m] since the latest row at which one begins."""
    first = np.maximum.accumulate(np.where(begins, np.arange(len(way)), 0))
    return np.asarray(way - way[first])


def merge_sites(sites: Sites, width: float) -> Sites:
    """Return the sites of a sweep joined until each has about a given width [m]; those of stays as they are."""
    groups = site_numbers(sites, width)
    count = np.bincount(groups)

    def mean(values: Floats) -> Floats:
        """Return the mean of values (n,) in each group."""
        return np.asarray(np.bincount(groups, values) / count)

    # Neighbours share their errors: the variance is the mean one, and not over their number.
    place = np.column_stack([mean(axis) for axis in sites.place.T])
    std = np.sqrt(mean(sites.std**2))
    standing = mean(sites.standing.astype(float)) > 0.5  # most of the sites that are joined
    return Sites(
        place=place,
        log=mean(sites.log),
        std=std,
        time=mean(sites.time),
        standing=standing,
        kept=sites.kept,
        relief=sites.relief,
    )


def site_numbers(sites: Sites, width: float) -> NDArray[np.intp]:
    """Return the number (n,) of the joined site of a given width [m] that each site becomes part of."""
    gap = np.r_[0.0, np.linalg.norm(np.diff(sites.place, axis=0), axis=1)]
    groups = np.zeros(len(sites), np.intp)
    way, group = 0.0, 0
    for i in range(1, len(sites)):
        way += float(gap[i])
        # The next group after a width of the way, at a stay, or at a jump.
        if way >= width - _ROUNDING or sites.standing[i] or sites.standing[i - 1] or gap[i] > width:
            group += 1
            way = 0.0
        groups[i] = group
    return groups


def line_coordinate(sites: Sites, tolerance: float = _MAX_LINE_WIDTH) -> Floats | None:
    """Return the coordinate (n,) [m] along the straight line that the sites lie on, or None where they cover an area.

    They lie on a line if the width across it is at most the `tolerance` [m]. Of a line along x or y it is their x or y
    itself. Of an oblique line it is the distance from the mean of the sites, along the line; it grows with x or y,
    whichever the line is nearer to.
    """
    place = sites.place[:, :2]
    centred = place - place.mean(axis=0)
    covariance = centred.T @ centred / max(len(sites), 1)
    variances, directions = np.linalg.eigh(covariance)
    # The width w across of a uniform band, whose variance is w^2/12.
    width = np.sqrt(12 * max(float(variances[0]), 0.0))
    if width > tolerance:
        return None
    direction = directions[:, 1]
    nearest_axis = int(np.argmax(np.abs(direction)))
    if abs(direction[nearest_axis]) > _MIN_AXIS_COSINE:
        return np.asarray(place[:, nearest_axis])
    return np.asarray(centred @ (direction * np.sign(direction[nearest_axis])))
