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
# Both follow from the basis.
TURN = 5.0 / 16.0  # distance of a turn from speed v to -v, over v times its duration; by the basis at its middle
PEAK = 1.875  # highest speed of a rest-to-rest move over its mean speed; the slope 30 x^2 (1 - x)^2 at 1/2
_SAME_TIME = 1e-12  # [s], a choice: knots closer than this are one


@dataclass(frozen=True)
class KnotProfile:
    """A quantity that follows fifth-order polynomials from knot to knot and rests before and after."""

    times: Floats  # (k,) [s]
    coefficients: Floats  # (k - 1, 6) in the fraction of the stretch, highest power first
    ends: tuple[float, float]

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Return value and rate (n,) at times (n,) [s]."""
        # The stretch between two knots in which each time lies, and the fraction of it.
        last = len(self.times) - 2
        stretch = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, last)
        length = np.diff(self.times)[stretch]
        fraction = (time - self.times[stretch]) / length
        value, rate = np.zeros_like(fraction), np.zeros_like(fraction)
        for coefficient in self.coefficients[stretch].T:  # Horner's scheme, of value and rate at once
            rate = rate * fraction + value
            value = value * fraction + coefficient
        # At rest before the first knot and from the last one on.
        is_early, is_late = time < self.times[0], time >= self.times[-1]
        value = np.where(is_early, self.ends[0], np.where(is_late, self.ends[1], value))
        return value, np.where(is_early | is_late, 0.0, rate / length)


@dataclass(frozen=True)
class Knot:
    """A time at which a profile has a value and rate; its second derivative is zero there."""

    time: float  # [s]
    value: float
    rate: float = 0.0


def profile(knots: Sequence[Knot]) -> KnotProfile:
    """Return the profile through knots, whose times must increase; knots of one time count once."""
    # Knots of one time count once; a single one becomes a rest of 1 s, as a stretch needs two ends.
    distinct = [knots[0]]
    for knot in knots[1:]:
        if knot.time > distinct[-1].time + _SAME_TIME:
            distinct.append(knot)
    if len(distinct) == 1:
        distinct.append(Knot(distinct[0].time + 1.0, distinct[0].value))
    # Coefficients of each stretch about its first value, so that a long straight line loses no digits. The basis is of
    # value and rate at both ends, where the second derivative is 0.
    rows = []
    for begin, end in itertools.pairwise(distinct):
        length = end.time - begin.time
        row = np.array([0.0, begin.rate * length, end.value - begin.value, end.rate * length]) @ _BASIS
        row[-1] += begin.value
        rows.append(row)
    times = np.array([knot.time for knot in distinct])
    return KnotProfile(times, np.array(rows), (distinct[0].value, distinct[-1].value))


def rest_profile(value: float) -> KnotProfile:
    """Return a profile that does not move."""
    return profile([Knot(0.0, value), Knot(1.0, value)])
