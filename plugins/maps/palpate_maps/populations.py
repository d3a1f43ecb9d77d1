"""Are sites one population, and if not, which of them are the surroundings?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

SINGLE = 1e-3  # of the test of normality: how often one population is taken for several
_WINDOW = 0.2  # of all sites: what a mode has at least
_FEWEST = 4  # sites in a mode
_DENSE = 0.2  # of the highest density that a lower mode has at least
_RISE = 1.5  # ratio of widths that ends a mode
_ROUNDS = 10
_FIRST_BELOW = 8  # sites below a mode; with fewer its spread is not determined from them


@dataclass(frozen=True)
class Mode:
    """The lowest dense group of values."""

    mean: float
    spread: float  # standard deviation, by what lies below the mean, where nothing stiff is
    spread_from: int  # number of values that determine the spread


def is_one(log: Floats, level: float = SINGLE) -> bool:
    """Whether values (n,) are compatible with one normal population, by Shapiro and Wilk's test (1965)."""
    from scipy import stats

    return len(log) < 2 * _FEWEST or float(np.ptp(log)) == 0.0 or float(stats.shapiro(log).pvalue) >= level


def lowest_mode(log: Floats, floor: float) -> Mode:
    """The lowest mode of values (n,), with a spread of at least `floor`.

    Stiff places, and the flanks around them, lie above their surroundings only. So the mode is the first stretch of
    the order statistics, from below, of a fifth of all values that is as narrow as any before the widths grow again;
    and the spread is the mean square distance of what lies below, without outliers there.
    """
    values = np.sort(log)
    size = max(round(_WINDOW * len(values)), min(_FEWEST, len(values)))
    widths = np.maximum(values[size - 1 :] - values[: len(values) - size + 1], 0.5 * floor)
    first = _first_minimum(widths)
    window = values[first : first + size]
    mean = float(window.mean())
    spread, spread_from = _spread_below(mean, values, floor)
    for _ in range(_ROUNDS):  # a window about the middle that flanks above do not draw along
        near = values[np.abs(values - mean) <= spread]
        mean = float(np.clip(near.mean() if len(near) else mean, window[0], window[-1]))
        spread, spread_from = _spread_below(mean, values, floor)
    return Mode(mean, spread, spread_from)


def _first_minimum(widths: Floats) -> int:
    """Where the first minimum is that is narrow enough, and that a rise of the widths ends."""
    enough = float(widths.min()) / _DENSE
    best = 0
    for i, width in enumerate(widths.tolist()):
        if width < widths[best]:
            best = i
        elif width > _RISE * widths[best] and widths[best] <= enough:
            return best
    return int(np.argmin(widths))


def _spread_below(mean: float, values: Floats, floor: float) -> tuple[float, int]:
    """Root mean square distance of the values below a mean, without those farther than three times that."""
    below = mean - values[values <= mean]
    if len(below) < _FIRST_BELOW:
        own = float(np.median(below)) / 0.6745 if len(below) else 0.0
        return max(floor, own), max(len(below), _FEWEST)  # so many are in the window, in any case
    spread, spread_from = float(np.quantile(below, 0.25)) / 0.3186, len(below)
    for _ in range(_ROUNDS):
        kept = below[below <= 3 * max(spread, 0.2 * floor)]
        spread, spread_from = float(np.sqrt(np.mean(kept**2))) if len(kept) else floor, max(len(kept), 2)
    return max(floor, spread), spread_from
