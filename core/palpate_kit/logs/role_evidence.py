"""Evidence in the numbers: which move together as force, position and velocity of a palpation do, and with which sign.

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

_SPAN = (99.8, 0.2)  # [%] of the readings, between which they change: single spikes do not count
_REACH = 25  # samples to either side over which a derivative is taken: noise averages out, and the mean is exact
_EVEN = 0.5  # of a rate's own movement that the slope may leave
_FAR = 0.2  # of its largest value that a rate falls below somewhere
_NEAR = 5  # samples to either side for the rate of a position itself
_MOST = 60_000  # points of the common grid
_RESTS = 0.01  # share of a record
_SURE = 4.0  # ratio of a one-sided force's excursions that determines its sign
_BEGIN, _FEW = 100, 8  # the begin of a record: a part of it, or so many samples
_CURVED = 3.0  # standard errors of a significant curvature, with 50 independent stretches of the record
_STRETCHES = 50


def on_grid(times: list[Floats], columns: list[Floats]) -> tuple[Floats, list[Floats]]:
    """Return a common grid of times [s], and every column on it, without spikes that are not part of its movement."""
    usual = [float(np.median(np.diff(time))) for time in times if len(time) > 2]
    begin, end = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    step = max(min((u for u in usual if u > 0), default=1.0), (end - begin) / _MOST)
    grid: Floats = begin + step * np.arange(max(int((end - begin) / step) + 1, 2), dtype=np.float64)
    return grid, [np.interp(grid, *_clean(t, c)) for t, c in zip(times, columns, strict=True)]


def _clean(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    good = np.isfinite(values) & np.isfinite(time) & (np.abs(values) < 1e100)
    if not good.any():
        return np.array([0.0]), np.array([0.0])
    low, high = np.percentile(values[good], (0.5, 99.5))
    margin = 20.0 * (high - low) + 1e-300
    good &= (values > low - margin) & (values < high + margin)
    order = np.argsort(time[good], kind="stable")
    return time[good][order], values[good][order]


def noise(values: Floats) -> float:
    """Standard deviation of the noise, by second differences: what is smooth gives none; robust against steps."""
    bend = np.abs(np.diff(values, 2))
    return float(np.median(bend) / 0.6745 / np.sqrt(6.0)) if len(bend) else 0.0


def span_of(values: Floats) -> float:
    """Range over which readings (n,) change, as recorded, without single spikes and NaN; 0 for none."""
    known = values[~np.isnan(values)]
    return float(np.subtract(*np.percentile(known, _SPAN))) if len(known) else 0.0


def roughness(values: Floats) -> float:
    """Noise relative to the movement."""
    span = float(np.ptp(values))
    return noise(values) / span if span > 0 else 0.0


def _mean(values: Floats, reach: int) -> Floats:
    """Over the stretches of `_slope`, by trapezia: then it is the slope of what the values are the rate of."""
    near = values - values[0]
    sums = np.cumsum(np.concatenate([[0.0], near]))
    n = 2 * reach
    return np.asarray((sums[n + 1 :] - sums[: -n - 1] - 0.5 * (near[n:] + near[:-n])) / n + values[0])


def _slope(values: Floats, step: float, reach: int) -> Floats:
    n = 2 * reach
    return np.asarray((values[n:] - values[:-n]) / (n * step))


@dataclass(frozen=True)
class Derivative:
    """How well one column is the derivative of another: rate = gain x slope."""

    share: float  # of its movement that this explains
    gain: float


def derivative(position: Floats, rate: Floats, step: float) -> Derivative:
    """Compare a column with the slope of another, both averaged over the same stretches."""
    if len(position) < 6 * _REACH:
        return Derivative(0.0, 0.0)
    slope, mean = _slope(position, step, _REACH), _mean(rate, _REACH)
    power = float(slope @ slope)
    total = float(mean @ mean)
    if power <= 0 or total <= 0 or not np.isfinite(power * total):
        return Derivative(0.0, 0.0)
    gain = float(slope @ mean) / power
    left = float(np.sum((mean - gain * slope) ** 2))
    moved = float(np.sum((mean - mean.mean()) ** 2))
    size = np.abs(mean)
    if left > _EVEN * moved and size.min() > _FAR * size.max():
        return Derivative(0.0, gain)  # a constant explains a constant: a position far from zero is not a rate
    return Derivative(1.0 - left / total, gain)


@dataclass(frozen=True)
class ContactEvidence:
    """How much of a column is a function of a position and its rate, and how that function goes."""

    share: float
    slope: float  # over the middle of the position, per its standard deviation
    bend: float  # in standard errors
    correlation: float = 0.0  # of both as they are


def contact_law(position: Floats, force: Floats) -> ContactEvidence:
    """Regress a column on a position and its rate."""
    if len(position) < 2 or np.ptp(position) <= 0 or np.ptp(force) <= 0:
        return ContactEvidence(0.0, 0.0, 0.0)
    if len(position) < 20 * _NEAR:  # too short for a bend and its error, not for the way in which both go
        return ContactEvidence(0.0, 0.0, 0.0, float(np.corrcoef(position, force)[0, 1]))
    place, answer = position[_NEAR:-_NEAR], force[_NEAR:-_NEAR]
    rate = _slope(position, 1.0, _NEAR)
    place = (place - place.mean()) / max(float(place.std()), 1e-300)
    rate = rate / max(float(rate.std()), 1e-300)
    answer = (answer - answer.mean()) / max(float(answer.std()), 1e-300)
    terms = np.column_stack([np.ones(len(place)), place, place**2, rate, place * rate])
    cuts = np.linspace(0, len(answer), _STRETCHES + 1).astype(int)
    parts = [slice(a, b) for a, b in itertools.pairwise(cuts.tolist())]
    grams = np.array([terms[part].T @ terms[part] for part in parts])
    sides = np.array([terms[part].T @ answer[part] for part in parts])
    ridge = 1e-9 * np.eye(terms.shape[1]) * len(answer)
    found = np.linalg.solve(grams.sum(axis=0) + ridge, sides.sum(axis=0))
    share = 1.0 - float(np.mean((answer - terms @ found) ** 2))
    # A jackknife over stretches: neighbouring samples are not independent evidence.
    without = np.linalg.solve(grams.sum(axis=0) - grams + ridge, (sides.sum(axis=0) - sides)[..., None])[:, 2, 0]
    spread = float(np.sqrt((_STRETCHES - 1) * np.mean((without - without.mean()) ** 2)))
    bend = float(found[2] / spread) if spread > 0 else 0.0
    return ContactEvidence(share, float(found[1]), bend, float(np.mean(place * answer)))


def rest_level(force: Floats) -> tuple[float, float]:
    """Where a force rests in air, and for which share of the record it is there.

    The densest level there is; that of the begin where the force rests there, too, and the other is a hold: nearer to
    zero clearly, or none of them is.
    """
    ordered = np.sort(force)
    width = max(len(ordered) // 20, 1)
    gaps = ordered[width:] - ordered[:-width]
    at = int(np.argmin(gaps))
    level = float(np.median(ordered[at : at + width + 1]))
    near = max(4.0 * noise(force), 0.01 * float(np.ptp(force)))
    begin = force[: max(len(force) // _BEGIN, _FEW)]
    first = float(np.median(begin))
    still = float(np.ptp(begin)) < 2.0 * near and _SURE * abs(level) > abs(first)
    if abs(first - level) > 2.0 * near and (still or _SURE * abs(first) < abs(level)):
        level = first
    return level, float(np.mean(np.abs(force - level) < near))


@dataclass(frozen=True)
class Sign:
    """Which way a force counts, by what, and whether that is certain."""

    value: int
    why: str
    sure: bool


def force_sign(force: Floats, law: ContactEvidence) -> Sign:
    """By the bend of force over height; by which side of its rest the force is on; by its mean."""
    level, share = rest_level(force)
    low, high = (float(x) for x in np.percentile(force, (0.2, 99.8)))
    up, down = high - level, level - low
    rests = share > _RESTS and max(up, down) > _SURE * max(min(up, down), 1e-300)
    side = 1 if up >= down else -1
    bend = 1 if law.bend >= 0 else -1
    curved = abs(law.bend) > _CURVED
    if rests and (not curved or side == bend):
        return Sign(side, "it leaves its rest value to one side", curved)
    if curved and not rests:
        return Sign(bend, "it grows faster than the depth", abs(law.bend) > 2 * _CURVED or _one_side(force) == bend)
    if abs(law.bend) > 3 * _CURVED:
        return Sign(bend, "it grows faster than the depth", True)  # and rests in contact
    if curved:
        return Sign(bend, "it grows faster than the depth, but leaves its rest value to the other side", False)
    return Sign(_one_side(force) or side, "it is mostly on this side of zero", False)


def _one_side(force: Floats) -> int:
    """Return the side of zero on which all of a force is; 0 where it is on both."""
    low, high = (float(x) for x in np.percentile(force, (1.0, 99.0)))
    return 1 if low > 0 else -1 if high < 0 else 0
