"""Populations of sites: a test of one population, and the lowest of several, which is the surroundings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

# Of decision 0084, which has the share of stiff areas found with them on 200 simulated layouts.
SINGLE = 1e-3  # level of the test of normality: how often one population is taken for several
_MODE_SHARE = 0.2  # of all sites: what a mode has at least
_WIDTH_RISE = 1.5  # ratio of widths that ends a mode
_CLIP = 3.0  # [standard deviations] below a mode, from which on a site is a soft outlier
# Choices: what is a mode, and what keeps the estimates of few or equal sites defined.
_MIN_DENSITY = 0.2  # of the highest density: what a lower mode has at least
_MIN_WIDTH = 0.5  # of the least spread: narrower windows are as narrow
_CLIP_FLOOR = 0.2  # of the least spread: the least that the clip is a multiple of
_MIN_SITES = 4  # in a mode
_MIN_BELOW = 8  # sites below a mode; with fewer its spread is the median deviation
_ROUNDS = 10  # of the iterations of mean and of spread
# Of the standard normal distribution.
_MEDIAN_DEVIATION = 0.6745  # median of |z|
_LOWER_QUARTILE = 0.3186  # lower quartile of |z|


@dataclass(frozen=True)
class Mode:
    """The lowest dense group of values."""

    mean: float
    spread: float  # standard deviation, by what lies below the mean, where nothing stiff is
    spread_from: int  # number of values that determine the spread


def is_one(log: Floats, level: float = SINGLE) -> bool:
    """Return True if values (n,) are compatible with one normal population, by Shapiro and Wilk's test (1965)."""
    from scipy import stats

    return len(log) < 2 * _MIN_SITES or float(np.ptp(log)) == 0.0 or float(stats.shapiro(log).pvalue) >= level


def lowest_mode(log: Floats, floor: float) -> Mode:
    """Return the lowest mode of values (n,), with a spread of at least `floor`.

    Stiff places, and the flanks around them, lie above their surroundings only. So the mode is the first stretch of
    the order statistics, from below, of a fifth of all values that is as narrow as any before the widths grow again;
    and the spread is the root mean square distance of what lies below, without outliers there. `spread_from` is the
    number of values that it is of.
    """
    # Widths of all windows of the order statistics that have a mode's share of them.
    values = np.sort(log)
    size = max(round(_MODE_SHARE * len(values)), min(_MIN_SITES, len(values)))
    widths = np.maximum(values[size - 1 :] - values[: len(values) - size + 1], _MIN_WIDTH * floor)
    first = _first_minimum(widths)
    window = values[first : first + size]
    mean = float(window.mean())
    spread, spread_from = _spread_below(mean, values, floor)
    # The mean of what is within a standard deviation, which flanks above do not draw along.
    for _ in range(_ROUNDS):
        near = values[np.abs(values - mean) <= spread]
        if len(near):
            mean = float(near.mean())
        mean = float(np.clip(mean, window[0], window[-1]))
        spread, spread_from = _spread_below(mean, values, floor)
    return Mode(mean, spread, spread_from)


def _first_minimum(widths: Floats) -> int:
    """Return the index of the first minimum of widths (n,) that is narrow enough, and that a rise of them ends."""
    narrow_enough = float(widths.min()) / _MIN_DENSITY
    narrowest = 0
    for i, width in enumerate(widths.tolist()):
        if width < widths[narrowest]:
            narrowest = i
        elif width > _WIDTH_RISE * widths[narrowest] and widths[narrowest] <= narrow_enough:
            return narrowest
    return int(np.argmin(widths))


def _spread_below(mean: float, values: Floats, floor: float) -> tuple[float, int]:
    """Return the root mean square distance of values below a mean, without those beyond three times that.

    Also the number of values that determine it.
    """
    below = mean - values[values <= mean]
    # Of few values the median deviation; as many as the least of a mode are in the window in any case.
    if len(below) < _MIN_BELOW:
        spread = float(np.median(below)) / _MEDIAN_DEVIATION if len(below) else 0.0
        return max(floor, spread), max(len(below), _MIN_SITES)
    # From the quartile, which outliers do not move, to the root mean square within the clip.
    spread, spread_from = float(np.quantile(below, 0.25)) / _LOWER_QUARTILE, len(below)
    for _ in range(_ROUNDS):
        clipped = below[below <= _CLIP * max(spread, _CLIP_FLOOR * floor)]
        spread = float(np.sqrt(np.mean(clipped**2))) if len(clipped) else floor
        spread_from = max(len(clipped), 2)
    return max(floor, spread), spread_from
