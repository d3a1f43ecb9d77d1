"""Smooth profiles: quantities over time whose value, rate and second derivative are continuous."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

# Fifth-order Hermite basis on 0..1, highest power first: of value and rate at both ends, second derivatives zero.
_BASIS = np.array(
    [
        [-6.0, 15.0, -10.0, 0.0, 0.0, 1.0],
        [-3.0, 8.0, -6.0, 0.0, 1.0, 0.0],
        [6.0, -15.0, 10.0, 0.0, 0.0, 0.0],
        [-3.0, 7.0, -4.0, 0.0, 0.0, 0.0],
    ]
)
TURN = 5.0 / 16.0  # way that a turn from speed v to -v takes, of v times its duration
PEAK = 1.875  # highest speed of a rest-to-rest move, of its mean speed


@dataclass(frozen=True)
class KnotProfile:
    """A quantity that follows fifth-order polynomials from knot to knot and rests before and after."""

    times: Floats  # (k,) [s]
    coefficients: Floats  # (k - 1, 6) in the fraction of the stretch, highest power first
    ends: tuple[float, float]

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Value and rate (n,) at times (n,) [s]."""
        last = len(self.times) - 2
        stretch = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, last)
        length = np.diff(self.times)[stretch]
        fraction = (time - self.times[stretch]) / length
        value, rate = np.zeros_like(fraction), np.zeros_like(fraction)
        for coefficient in self.coefficients[stretch].T:  # Horner's scheme, of value and rate at once
            rate = rate * fraction + value
            value = value * fraction + coefficient
        before, after = time < self.times[0], time >= self.times[-1]
        value = np.where(before, self.ends[0], np.where(after, self.ends[1], value))
        return value, np.where(before | after, 0.0, rate / length)


@dataclass(frozen=True)
class Knot:
    """Where a profile has a given value and rate; its second derivative is zero there."""

    time: float  # [s]
    value: float
    rate: float = 0.0


def profile(knots: Sequence[Knot]) -> KnotProfile:
    """The profile through knots, whose times must increase; knots of one time count once."""
    kept = [knots[0]]
    for knot in knots[1:]:
        if knot.time > kept[-1].time + 1e-12:
            kept.append(knot)
    if len(kept) == 1:
        kept.append(Knot(kept[0].time + 1.0, kept[0].value))
    times = np.array([knot.time for knot in kept])
    rows = []
    for a, b in itertools.pairwise(kept):
        length = b.time - a.time
        # About the first value, so that a long straight line loses no digits.
        rows.append(np.array([0.0, a.rate * length, b.value - a.value, b.rate * length]) @ _BASIS)
        rows[-1][5] += a.value
    return KnotProfile(times, np.array(rows), (kept[0].value, kept[-1].value))


def rest_profile(value: float) -> KnotProfile:
    """A profile that does not move."""
    return profile([Knot(0.0, value), Knot(1.0, value)])
