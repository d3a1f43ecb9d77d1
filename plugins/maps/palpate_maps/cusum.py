"""Cumulative sums: a sequential test that shows during the motion where the stiffness has changed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from palpate_maps.line_peaks import LineCurve
from palpate_maps.lump_criteria import Findings, Lump, LumpSettings
from palpate_maps.sites import merge_sites

_CELLS = 40  # of the chain between 0 and the threshold
_TABLED = 12.0  # largest threshold that the chain is asked for; beyond it the run length grows like exp(2 k h)
_LARGEST = 1e12  # run length [blocks] up to which the chain's equations are well conditioned


@dataclass(frozen=True)
class Alarm:
    """A significant change of the mean."""

    rising: bool
    since: int  # first block after the change, by the sum
    at: int  # block that raised the alarm
    p: float  # chance of such a sum in a sweep without a change


@dataclass
class Cusum:
    """Page's two cumulative sums over blocks, with a self-starting reference that restarts after each alarm.

    z = (x - m)/(s sqrt(1 + 1/j)), m the mean of the j blocks since the last change (Hawkins 1987, with s known):
    standard normal and independent where nothing changes. U <- max(0, U + z - k) and D <- max(0, D - z - k)
    (Page 1954); k is half of the least contrast over s, best for a step of that contrast. The threshold is where the
    mean run length of the two together is blocks/rate: one sweep in 1/rate raises an alarm without a change.
    """

    rate: float  # chance of an alarm in a sweep without a change
    blocks: int  # in a sweep
    step: float  # least change of the logarithm that matters
    reference: list[float] = field(default_factory=list)
    sums: list[float] = field(default_factory=lambda: [0.0, 0.0])  # of rises, of falls
    since: list[int] = field(default_factory=lambda: [0, 0])
    count: int = 0
    seen: list[float] = field(default_factory=list)

    def feed(self, value: float, std: float) -> Alarm | None:
        """Take in the next block's logarithm and its standard deviation; an alarm where there is one."""
        self.seen.append(value)
        self.count += 1
        if not self.reference:
            self.reference.append(value)
            return None
        n = len(self.reference)
        score = (value - sum(self.reference) / n) / (std * math.sqrt(1 + 1 / n))
        k = slack(self.step / std, self.rate / 2, self.blocks)
        found = None
        for side, signed in enumerate((score, -score)):
            grown = self.sums[side] + signed - k
            if grown <= 0:
                self.sums[side], self.since[side] = 0.0, self.count
                continue
            self.sums[side] = grown
            if grown > threshold(k, self.rate / 2, self.blocks):
                p = min(1.0, 2 * self.blocks / run_length(k, grown))
                found = Alarm(side == 0, self.since[side], self.count - 1, p)
        if found is None:
            self.reference.append(value)
        else:
            self.reference = self.seen[found.since :]
            self.sums, self.since = [0.0, 0.0], [self.count, self.count]
        return found


@lru_cache(maxsize=4096)
def slack(change: float, rate: float, blocks: int) -> float:
    """k for a change in standard deviations: half of it, but so little that the threshold is not below 0; on a grid."""
    from scipy.stats import norm

    most = np.floor(4 * float(norm.isf(rate / blocks))) / 4
    return float(np.clip(round(2 * change) / 4, min(0.5, most), most))


@lru_cache(maxsize=4096)
def run_length(k: float, h: float) -> float:
    """Mean number of standard normal values until the one-sided sum exceeds h, from 0.

    The sum as a Markov chain on a grid between 0 and h (Brook and Evans 1972); beyond it like exp(2 k h).
    """
    if h > _TABLED:
        return run_length(k, _TABLED) * float(np.exp(min(2 * k * (h - _TABLED), 600.0)))
    from scipy.stats import norm

    width = 2 * h / (2 * _CELLS - 1)
    grid = width * np.arange(_CELLS)
    upper = norm.cdf(grid[None] - grid[:, None] + k + width / 2)
    chain = np.column_stack([upper[:, 0], np.diff(upper, axis=1)])
    chance = norm.sf(h - grid + k)  # of leaving at once: what is lost to rounding in 1 - sum of a row
    system = np.eye(_CELLS) - chain
    system[np.diag_indices(_CELLS)] = chance + chain.sum(axis=1) - np.diag(chain)
    length = float(np.linalg.solve(system, np.ones(_CELLS))[0])
    return length if 0 < length < _LARGEST else _LARGEST


@lru_cache(maxsize=256)
def threshold(k: float, rate: float, blocks: int) -> float:
    """h at which the mean run length of one sum is blocks/rate."""
    low, high = 1e-6, _TABLED
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if run_length(k, middle) < blocks / rate else (low, middle)
    return high


def by_cusum(curve: LineCurve, settings: LumpSettings) -> Findings:
    """Lumps as a rise and the fall after it, each an alarm of the cumulative sums over blocks of the sweep.

    Blocks of `width` are taken in the order of time, the last stay before the sweep first. Where the lump is, how wide
    and how high, is read off the smoothed curve between the two changes.
    """
    blocks = merge_sites(curve.sites, settings.width)
    noise = np.sqrt(settings.spread**2 + curve.sites.kept**2 * blocks.std**2)
    along = np.interp(blocks.time, curve.sites.time, curve.along)
    test = Cusum(settings.rate, len(blocks), float(np.log1p(settings.contrast)))
    alarms = [a for a in map(test.feed, blocks.log.tolist(), noise.tolist()) if a is not None]
    half = 0.5 * settings.width
    found = sorted((*sorted((along[first], along[last])), p) for first, last, p in _rises_and_falls(alarms))
    lumps: list[Lump] = []
    for number, (begin, end, p) in enumerate(found):
        ends = found[number - 1][1] if number else -np.inf, found[number + 1][0] if number + 1 < len(found) else np.inf
        lump = _lump(curve, (begin - half, end + half), ends, p)
        known = lump is None or any(abs(lump.along - other.along) < settings.width for other in lumps)
        if lump is not None and not known and lump.contrast >= settings.contrast:
            lumps.append(lump)
    return curve.findings(lumps, f"cumulative sums over blocks of {1e3 * settings.width:g} mm")


def _rises_and_falls(alarms: list[Alarm]) -> Iterator[tuple[int, int, float]]:
    """First block, last block and p-value of each rise, or several in a row, that a fall ends."""
    rise: Alarm | None = None
    p = 1.0
    for alarm in alarms:
        if alarm.rising:
            rise, p = (alarm, alarm.p) if rise is None else (rise, min(p, alarm.p))
        elif rise is not None:
            yield rise.since, alarm.at, max(p, alarm.p)
            rise = None


def _lump(curve: LineCurve, span: tuple[float, float], ends: tuple[float, float], p: float) -> Lump | None:
    """The highest point of a span, over the higher of the valleys next to it, which lie before the ends."""
    inside = np.flatnonzero((curve.at >= span[0]) & (curve.at <= span[1]))
    if not len(inside):
        return None
    peak = int(inside[np.argmax(curve.log[inside])])
    left = np.flatnonzero((curve.at >= ends[0]) & (curve.at <= curve.at[peak]))
    right = np.flatnonzero((curve.at <= ends[1]) & (curve.at >= curve.at[peak]))
    valleys = [int(side[np.argmin(curve.log[side])]) for side in (left, right) if len(side)]
    valley = max(valleys, key=lambda v: curve.log[v])
    height = float(curve.log[peak] - curve.log[valley])
    edges = [_crossing(curve, peak, height / 2, step) for step in (-1, 1)]
    middle = float(np.mean(edges))
    std = float(np.hypot(curve.noise[peak], curve.noise[valley]))
    return Lump(curve.place(middle), (abs(edges[1] - edges[0]), 0.0), float(np.expm1(height)), std, p, middle)


def _crossing(curve: LineCurve, peak: int, drop: float, step: int) -> float:
    """Where the curve has fallen by `drop`, going from the peak in one direction."""
    i = peak
    while 0 <= i + step < len(curve.at) and curve.log[i] > curve.log[peak] - drop:
        i += step
    return float(curve.at[i])
