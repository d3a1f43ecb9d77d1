"""Evidence that columns move together as force, position and velocity of a palpation do, and of the force's sign.

A contact force is a function of the depth and its rate, and grows faster than the depth: F ~ c0 + c1 z + c2 z^2 +
c3 z' + c4 z z', with c2 > 0 whichever way z counts (a contact is one-sided; a half-space, a hinge at the surface and
every tip that widens bend the same way). So the sign of c2 is that of the force, and the sign of the slope then that
of z.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from palpate import Floats

# Choices.
_SPAN_PERCENTILES = (99.8, 0.2)  # [%] of the readings, between which they change: single spikes do not count
_CLEAN_PERCENTILES = (0.5, 99.5)  # [%] of the readings, about which spikes are far
_SPIKE_SPANS = 20.0  # spans beyond these percentiles, from which on a reading is a spike
_MAX_READING = 1e100  # beyond which a number is not a reading
_DERIVATIVE_SAMPLES = 25  # to either side, of a derivative: noise averages out, and the mean is exact
_MIN_DERIVATIVE_SAMPLES = 6 * _DERIVATIVE_SAMPLES  # of a record, for a comparison with a derivative
_MAX_UNEXPLAINED = 0.5  # of a rate's own movement that the slope may leave
_MIN_RATE_SHARE = 0.2  # of its largest value that a rate falls below somewhere
_RATE_SAMPLES = 5  # to either side, of the rate in the law of a contact
_MIN_LAW_SAMPLES = 20 * _RATE_SAMPLES  # of a record, for a bend and its error
_MAX_GRID = 60_000  # points of the common grid
_REST_SHARE = 0.01  # of a record, from which on its force rests somewhere
_REST_NOISE, _REST_SPAN = 4.0, 0.01  # standard deviations of noise, and share of the span, within which a force rests
_DENSEST_PART = 20  # of the readings: a twentieth of them is looked for in the smallest interval
_ONE_SIDED_RATIO = 4.0  # of excursions to both sides of the rest, from which on a force is one-sided
_BEGIN_PART, _MIN_BEGIN = 100, 8  # a hundredth of a record is its begin, or so many samples
_BEND_SIGMAS = 3.0  # standard errors of a significant bend, with 50 independent stretches of the record
_BEND = 2  # number of the term z^2 of the law
_STRETCHES = 50
_SIDE_PERCENTILES = (1.0, 99.0)  # [%] of the forces, that have one sign
_RIDGE = 1e-9  # of the normal equations' diagonal, for terms that are the same
_SMALLEST = 1e-300  # in a quotient, in place of 0: near the smallest double
_NORMAL_QUARTILE = 0.6745  # [standard deviations], the median size of a normal value


def on_grid(times: list[Floats], columns: list[Floats]) -> tuple[Floats, list[Floats]]:
    """Return a common grid of times [s], and every column on it, without spikes that are not part of its movement."""
    intervals = [float(np.median(np.diff(time))) for time in times if len(time) > 2]
    begin, end = min(float(time[0]) for time in times), max(float(time[-1]) for time in times)
    shortest = min((interval for interval in intervals if interval > 0), default=1.0)
    step = max(shortest, (end - begin) / _MAX_GRID)
    grid: Floats = begin + step * np.arange(max(int((end - begin) / step) + 1, 2), dtype=np.float64)
    return grid, [np.interp(grid, *_clean(time, column)) for time, column in zip(times, columns, strict=True)]


def _clean(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return times and values (m,) in order, without spikes and without what is not finite; zeros for none."""
    is_good = np.isfinite(values) & np.isfinite(time) & (np.abs(values) < _MAX_READING)
    if not is_good.any():
        return np.array([0.0]), np.array([0.0])
    low, high = np.percentile(values[is_good], _CLEAN_PERCENTILES)
    margin = _SPIKE_SPANS * (high - low) + _SMALLEST
    is_good &= (values >= low - margin) & (values <= high + margin)
    order = np.argsort(time[is_good], kind="stable")
    return time[is_good][order], values[is_good][order]


def noise(values: Floats) -> float:
    """Return the standard deviation of white noise on smooth values (n,), robust against steps.

    Of noise s the second differences have the standard deviation sqrt(1 + 4 + 1) s, and the median 0.6745 of that.
    """
    bend = np.abs(np.diff(values, 2))
    return float(np.median(bend) / _NORMAL_QUARTILE / np.sqrt(6.0)) if len(bend) else 0.0


def span_of(values: Floats) -> float:
    """Return the range over which readings (n,) change, as recorded, without single spikes and NaN; 0 for none."""
    numbers = values[~np.isnan(values)]
    return float(np.subtract(*np.percentile(numbers, _SPAN_PERCENTILES))) if len(numbers) else 0.0


def roughness(values: Floats) -> float:
    """Return the noise relative to the range of values (n,)."""
    span = float(np.ptp(values))
    return noise(values) / span if span > 0 else 0.0


def _stretch_mean(values: Floats, reach: int) -> Floats:
    """Return the means over the stretches of `_slope`, by trapezia: of a rate, the slope of its integral."""
    change = values - values[0]
    sums = np.cumsum(np.concatenate([[0.0], change]))
    n = 2 * reach
    return np.asarray((sums[n + 1 :] - sums[: -n - 1] - 0.5 * (change[n:] + change[:-n])) / n + values[0])


def _slope(values: Floats, step: float, reach: int) -> Floats:
    """Return the slopes (n - 2 reach,) of values (n,) over `reach` samples to either side."""
    n = 2 * reach
    return np.asarray((values[n:] - values[:-n]) / (n * step))


@dataclass(frozen=True)
class Derivative:
    """A column as the derivative of another: rate = gain x slope."""

    share: float  # of the column's square that this explains
    gain: float


def derivative(position: Floats, rate: Floats, step: float) -> Derivative:
    """Return how well a column is the derivative of another: rate = gain x slope, with the share that this explains.

    By least squares of the rate's means on the slopes of the position, over 25 samples to either side; share and gain
    are 0 for fewer samples than that takes. `step` is the interval of time.
    """
    if len(position) < _MIN_DERIVATIVE_SAMPLES:
        return Derivative(0.0, 0.0)
    slope = _slope(position, step, _DERIVATIVE_SAMPLES)
    mean = _stretch_mean(rate, _DERIVATIVE_SAMPLES)
    slope_square = float(slope @ slope)
    mean_square = float(mean @ mean)
    if slope_square <= 0 or mean_square <= 0 or not np.isfinite(slope_square * mean_square):
        return Derivative(0.0, 0.0)
    gain = float(slope @ mean) / slope_square
    unexplained = float(np.sum((mean - gain * slope) ** 2))
    movement = float(np.sum((mean - mean.mean()) ** 2))
    size = np.abs(mean)
    # A constant explains a constant: a position far from zero is not a rate.
    if unexplained > _MAX_UNEXPLAINED * movement and size.min() > _MIN_RATE_SHARE * size.max():
        return Derivative(0.0, gain)
    return Derivative(1.0 - unexplained / mean_square, gain)


@dataclass(frozen=True)
class ContactEvidence:
    """The law F ~ c0 + c1 z + c2 z^2 + c3 z' + c4 z z' of a column over a position, all of standard deviation 1."""

    share: float  # of the column's variance that the law explains
    slope: float  # c1, at the mean of the position
    bend: float  # c2, in standard errors
    correlation: float = 0.0  # of the column and the position


def contact_law(position: Floats, force: Floats) -> ContactEvidence:
    """Return the law of a column over a position and its rate, by least squares: c0 + c1 z + c2 z^2 + c3 z' + c4 z z'.

    The evidence is the share of the variance that it explains, c1, c2 in standard errors, and the correlation. A short
    record has the correlation alone, which is enough for the sign of the slope.
    """
    if len(position) < 2 or np.ptp(position) <= 0 or np.ptp(force) <= 0:
        return ContactEvidence(0.0, 0.0, 0.0)
    if len(position) < _MIN_LAW_SAMPLES:
        return ContactEvidence(0.0, 0.0, 0.0, float(np.corrcoef(position, force)[0, 1]))
    # In units of their standard deviations, without the ends, which have no rate.
    z = _standardized(position[_RATE_SAMPLES:-_RATE_SAMPLES])
    rate = _slope(position, 1.0, _RATE_SAMPLES)
    rate = rate / max(float(rate.std()), _SMALLEST)
    response = _standardized(force[_RATE_SAMPLES:-_RATE_SAMPLES])
    # Normal equations as sums over stretches.
    terms = np.column_stack([np.ones(len(z)), z, z**2, rate, z * rate])
    cuts = np.linspace(0, len(response), _STRETCHES + 1).astype(int)
    stretches = [slice(begin, end) for begin, end in itertools.pairwise(cuts.tolist())]
    squares = np.array([terms[rows].T @ terms[rows] for rows in stretches])
    products = np.array([terms[rows].T @ response[rows] for rows in stretches])
    ridge = _RIDGE * np.eye(terms.shape[1]) * len(response)
    coefficients = np.linalg.solve(squares.sum(axis=0) + ridge, products.sum(axis=0))
    share = 1.0 - float(np.mean((response - terms @ coefficients) ** 2))
    bend_error = _bend_error(squares, products, ridge)
    bend = float(coefficients[_BEND] / bend_error) if bend_error > 0 else 0.0
    return ContactEvidence(share, float(coefficients[1]), bend, float(np.mean(z * response)))


def _standardized(column: Floats) -> Floats:
    """Return a column (n,) less its mean, in units of its standard deviation."""
    deviations = column - column.mean()
    return np.asarray(deviations / max(float(column.std()), _SMALLEST))


def _bend_error(squares: Floats, products: Floats, ridge: Floats) -> float:
    """Return the standard error of the bend by a jackknife over m stretches, sqrt((m - 1)/m sum (b_i - mean b)^2).

    b_i is the bend without a stretch; neighbouring samples are not independent evidence. Normal equations of the
    stretches (m, t, t) and (m, t), and the `ridge` (t, t) of their sum.
    """
    products_without = (products.sum(axis=0) - products)[..., None]
    bends_without = np.linalg.solve(squares.sum(axis=0) - squares + ridge, products_without)[:, _BEND, 0]
    return float(np.sqrt((_STRETCHES - 1) * np.mean((bends_without - bends_without.mean()) ** 2)))


def rest_level(force: Floats) -> tuple[float, float]:
    """Return the level at which a force rests in air, and the share of the record in which it is there.

    It is the densest level. Where the record begins at another one, that may be the air and the densest one a hold: the
    begin is taken where it is steady and the densest level not clearly nearer to zero, or where it is clearly nearer
    to zero itself.
    """
    ordered = np.sort(force)
    window_size = max(len(ordered) // _DENSEST_PART, 1)
    densest = int(np.argmin(ordered[window_size:] - ordered[:-window_size]))
    level = float(np.median(ordered[densest : densest + window_size + 1]))
    tolerance = max(_REST_NOISE * noise(force), _REST_SPAN * float(np.ptp(force)))
    begin = force[: max(len(force) // _BEGIN_PART, _MIN_BEGIN)]
    first_level = float(np.median(begin))
    # Within the tolerance to either side.
    is_steady = float(np.ptp(begin)) < 2.0 * tolerance
    is_air = is_steady and _ONE_SIDED_RATIO * abs(level) > abs(first_level)
    is_near_zero = _ONE_SIDED_RATIO * abs(first_level) < abs(level)
    if abs(first_level - level) > 2.0 * tolerance and (is_air or is_near_zero):
        level = first_level
    return level, float(np.mean(np.abs(force - level) < tolerance))


@dataclass(frozen=True)
class Sign:
    """The sign of a force in contact, the reason for it, and whether that is certain."""

    value: int
    why: str
    sure: bool


def force_sign(force: Floats, law: ContactEvidence) -> Sign:
    """Return the sign of a force in contact: by the side of its rest that it leaves to, by its bend, by its mean.

    `law` is the force over the position, by least squares; its bend is in standard errors.
    """
    # The side to which it leaves its rest, if it rests and leaves to one side.
    level, rest_share = rest_level(force)
    high, low = (float(x) for x in np.percentile(force, _SPAN_PERCENTILES))
    up, down = high - level, level - low
    is_one_sided = max(up, down) > _ONE_SIDED_RATIO * max(min(up, down), _SMALLEST)
    rests = rest_share > _REST_SHARE and is_one_sided
    side = 1 if up >= down else -1
    # The sign by which it grows faster than the depth, as in contact with a round tip.
    bend_sign = 1 if law.bend >= 0 else -1
    sigmas = abs(law.bend)
    is_bent = sigmas > _BEND_SIGMAS
    if rests and (not is_bent or side == bend_sign):
        return Sign(side, "it leaves its rest value to one side", is_bent)
    if is_bent and not rests:
        is_sure = sigmas > 2 * _BEND_SIGMAS or _one_side(force) == bend_sign
        return Sign(bend_sign, "it grows faster than the depth", is_sure)
    # Rest and bend contradict each other: a bend is believed that is three times as significant as it has to be (a
    # choice, as the two above).
    if sigmas > 3 * _BEND_SIGMAS:  # the rest is one in contact
        return Sign(bend_sign, "it grows faster than the depth", True)
    if is_bent:
        return Sign(bend_sign, "it grows faster than the depth, but leaves its rest value to the other side", False)
    return Sign(_one_side(force) or side, "it is mostly on this side of zero", False)


def _one_side(force: Floats) -> int:
    """Return the side of zero on which all of a force is; 0 where it is on both."""
    low, high = (float(x) for x in np.percentile(force, _SIDE_PERCENTILES))
    if low > 0:
        return 1
    return -1 if high < 0 else 0
