"""Cumulative sums: a sequential test that shows during the motion where the stiffness has changed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from operator import attrgetter

import numpy as np

from palpate_maps.line_peaks import LineCurve, Peak, lump_of_peak, peaks
from palpate_maps.lump_criteria import Findings, LumpSettings
from palpate_maps.sites import merge_sites

# Choices of accuracy: of the run length as a Markov chain, and of the threshold that is inverted from it.
_CHAIN_STATES = 40  # of the chain between 0 and the threshold
_MAX_CHAIN_THRESHOLD = 12.0  # that the chain is asked for; beyond it the run length grows like exp(2 k h)
_MAX_RUN_LENGTH = 1e12  # [blocks] up to which the chain's equations are well conditioned
_MAX_EXPONENT = 600.0  # of that growth: exp(600) times the largest run length is still a finite number
_THRESHOLD_STEP = 1e-4  # [standard deviations] to which the threshold is determined
_MIN_THRESHOLD = 1e-6  # [standard deviations] from which it is looked for
_SLACK_STEPS = 4  # of k in a standard deviation: so few values that their thresholds are tabled
_MIN_SLACK = 0.5  # [standard deviations]: Page's for a step of one


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
        """Take in the logarithm of the next block's stiffness, and its standard deviation; return an alarm, or None.

        Each of the two sums has half of the rate: a sweep without a change raises either alarm with `rate`. The scores
        of blocks with the standard deviation s have that of the block and of the reference's mean, s sqrt(1 + 1/n).
        """
        self.seen.append(value)
        self.count += 1
        if not self.reference:
            self.reference.append(value)
            return None
        # The block against the mean of the reference, in standard deviations.
        n = len(self.reference)
        score = (value - sum(self.reference) / n) / (std * math.sqrt(1 + 1 / n))
        k = slack(self.step / std, self.rate / 2, self.blocks)
        alarm = None
        for side, signed_score in enumerate((score, -score)):  # rises, then falls
            increased = self.sums[side] + signed_score - k
            # A sum that falls to 0 begins again with the next block.
            if increased <= 0:
                self.sums[side], self.since[side] = 0.0, self.count
                continue
            self.sums[side] = increased
            if increased > threshold(k, self.rate / 2, self.blocks):
                p = min(1.0, 2 * self.blocks / run_length(k, increased))
                alarm = Alarm(rising=side == 0, since=self.since[side], at=self.count - 1, p=p)
        # After an alarm the reference is what came since the change.
        if alarm is None:
            self.reference.append(value)
        else:
            self.reference = self.seen[alarm.since :]
            self.sums, self.since = [0.0, 0.0], [self.count, self.count]
        return alarm


@lru_cache(maxsize=4096)
def slack(change: float, rate: float, blocks: int) -> float:
    """Return k for a change [standard deviations]: half of it, with a threshold not below 0, on a grid."""
    from scipy.stats import norm

    largest = np.floor(_SLACK_STEPS * float(norm.isf(rate / blocks))) / _SLACK_STEPS
    half = round(_SLACK_STEPS / 2 * change) / _SLACK_STEPS
    return float(np.clip(half, min(_MIN_SLACK, largest), largest))


@lru_cache(maxsize=4096)  # a choice: the values that the search for a threshold comes back to
def run_length(k: float, h: float) -> float:
    """Return the mean number of standard normal values until the one-sided sum exceeds h, from 0.

    The sum as a Markov chain on a grid between 0 and h (Brook and Evans 1972); beyond it like exp(2 k h).
    """
    if h > _MAX_CHAIN_THRESHOLD:
        exponent = min(2 * k * (h - _MAX_CHAIN_THRESHOLD), _MAX_EXPONENT)
        return run_length(k, _MAX_CHAIN_THRESHOLD) * float(np.exp(exponent))
    from scipy.stats import norm

    # Probabilities of going from each state to each; the sum has its mass at 0 in the first.
    width = 2 * h / (2 * _CHAIN_STATES - 1)
    states = width * np.arange(_CHAIN_STATES)
    upper = norm.cdf(states[None] - states[:, None] + k + width / 2)
    transition = np.column_stack([upper[:, 0], np.diff(upper, axis=1)])
    # The probability of leaving at once is lost to rounding in 1 - sum of a row, so that the diagonal is made of it.
    leaving = norm.sf(h - states + k)
    system = np.eye(_CHAIN_STATES) - transition
    system[np.diag_indices(_CHAIN_STATES)] = leaving + transition.sum(axis=1) - np.diag(transition)
    # Run lengths L of all states: (I - P) L = 1.
    length = float(np.linalg.solve(system, np.ones(_CHAIN_STATES))[0])
    return length if 0 < length < _MAX_RUN_LENGTH else _MAX_RUN_LENGTH


@lru_cache(maxsize=256)
def threshold(k: float, rate: float, blocks: int) -> float:
    """Return h at which the mean run length of one sum is blocks/rate."""
    low, high = _MIN_THRESHOLD, _MAX_CHAIN_THRESHOLD
    while high - low > _THRESHOLD_STEP:
        middle = 0.5 * (low + high)
        if run_length(k, middle) < blocks / rate:
            low = middle
        else:
            high = middle
    return high


def by_cusum(curve: LineCurve, settings: LumpSettings) -> Findings:
    """Return lumps as a rise and the fall after it, each an alarm of the cumulative sums over blocks of the sweep.

    `curve` is the logarithm of the stiffness along the sweep. Blocks of `width` are taken in the order of time, the
    last stay before the sweep first. The lump of a rise is the highest peak of the smoothed curve between the two
    changes, as wide and as high as it is there.
    """
    half = 0.5 * settings.width  # a change lies anywhere in its block
    candidates = peaks(curve, float(np.log1p(settings.contrast)))
    p_of_peak: dict[Peak, float] = {}  # the least of its alarms
    for begin, end, p in _raised_spans(curve, settings):
        inside = [peak for peak in candidates if begin - half <= peak.highest <= end + half]
        if inside:
            peak = max(inside, key=attrgetter("height"))
            p_of_peak[peak] = min(p, p_of_peak.get(peak, 1.0))
    lumps = [lump_of_peak(curve, peak, settings, p) for peak, p in p_of_peak.items()]
    return curve.findings(lumps, f"cumulative sums over blocks of {1e3 * settings.width:g} mm")


def _raised_spans(curve: LineCurve, settings: LumpSettings) -> list[tuple[float, float, float]]:
    """Return begin and end [m] along the sweep, and p-value, of each rise that a fall ends, by their place."""
    blocks = merge_sites(curve.sites, settings.width)
    noise = np.sqrt(settings.spread**2 + curve.sites.kept**2 * blocks.std**2)
    along = np.interp(blocks.time, curve.sites.time, curve.along)
    test = Cusum(settings.rate, len(blocks), float(np.log1p(settings.contrast)))
    answers = map(test.feed, blocks.log.tolist(), noise.tolist())
    alarms = [alarm for alarm in answers if alarm is not None]
    spans = []
    for first, last, p in _rises_and_falls(alarms):
        # A sweep may go backwards.
        begin, end = sorted((float(along[first]), float(along[last])))
        spans.append((begin, end, p))
    return sorted(spans)


def _rises_and_falls(alarms: list[Alarm]) -> Iterator[tuple[int, int, float]]:
    """Yield first block, last block and p-value of each rise, or several in a row, that a fall ends."""
    rise: Alarm | None = None
    p = 1.0
    for alarm in alarms:
        if alarm.rising:
            p = alarm.p if rise is None else min(p, alarm.p)
            rise = rise or alarm
        elif rise is not None:
            yield rise.since, alarm.at, max(p, alarm.p)
            rise = None
