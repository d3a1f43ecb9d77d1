"""E_n, Shewhart's chart for individuals and the EWMA chart: limits, and what lies beyond them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from palpate_kit.numerics.normalised_error import normalised_error

BASELINE = 25  # checks in control, from whose scatter the limits are then taken
SHEWHART = 3.0  # standard deviations
WEIGHT = 0.2  # lambda of the EWMA
EWMA = 2.859  # its standard deviations: 370 checks on average until a false alarm
_RANGE = 2 / math.sqrt(math.pi)  # d_2: mean moving range of two values over their standard deviation


@dataclass(frozen=True)
class CheckValue:
    """The value of a check [SI], with its uncertainties."""

    value: float
    std: float  # combined standard uncertainty
    repeat_std: float  # of it, what differs from one check to the next


@dataclass(frozen=True)
class CheckState:
    """A check in the chart [SI]: the limits that it has to keep, and what it fails."""

    e_n: float
    centre: float
    limit: float  # distance from the centre that Shewhart's chart allows
    ewma: float
    ewma_limit: float
    own_scatter: bool  # whether the limits are those of the chart's own scatter
    reasons: tuple[str, ...]

    @property
    def in_control(self) -> bool:
        """True if it keeps all of them."""
        return not self.reasons


@dataclass
class _Average:
    """An EWMA since its centre: its variance from check to check, and its part of an error that all checks share."""

    centre: float
    value: float
    variance: float = 0.0
    common: float = 0.0

    def add(self, value: float, scatter: float, common: float) -> None:
        """Take in a check."""
        self.value += WEIGHT * (value - self.value)
        self.variance = (1 - WEIGHT) ** 2 * self.variance + (WEIGHT * scatter) ** 2
        self.common = (1 - WEIGHT) * self.common + WEIGHT * common

    @property
    def limit(self) -> float:
        """Distance from the centre that it is allowed."""
        return EWMA * math.hypot(math.sqrt(self.variance), self.common)


def check_states(readings: Sequence[CheckValue], reference: float, reference_std: float) -> list[CheckState]:
    """Return the state of every check, in their order.

    At first the centre is the reference, and the limits follow from the stated uncertainties: what all checks share
    (tip, gain, reference) does not average out of the EWMA, what differs from check to check does. From the 26th check
    on the centre is the mean of the first 25 that were in control, their standard deviation the mean moving range over
    1.128, and the EWMA begins at the centre. A check that is out of control by itself is not part of the EWMA, which
    would call the next ones wrong, too.
    Sources: ISO 7870-2:2023 (chart for individuals), ISO 7870-6:2016 (EWMA); Lucas and Saccucci 1990 (3 sigma, lambda
    0.2 and L 2.859: 370 checks until a false alarm, each chart by itself).
    """
    states: list[CheckState] = []
    baseline: list[float] = []
    average, own = _Average(reference, reference), None
    for reading in readings:
        if own is None and len(baseline) == BASELINE:
            own, middle = _scatter(baseline), sum(baseline) / BASELINE
            average = _Average(middle, middle) if own else average
        e_n = normalised_error(reading.value, reading.std, reference, reference_std)
        limit = SHEWHART * (own or math.hypot(reading.std, reference_std))
        reasons = list(_alone(e_n, reading.value - average.centre, limit))
        if not reasons:
            shared = 0.0 if own else math.sqrt(max(reading.std**2 - reading.repeat_std**2, 0.0) + reference_std**2)
            average.add(reading.value, own or reading.repeat_std, shared)
            if abs(average.value - average.centre) > average.limit:
                reasons.append("the moving average (EWMA) is beyond its limits: a small change that lasts")
        states.append(CheckState(e_n, average.centre, limit, average.value, average.limit, bool(own), tuple(reasons)))
        if not reasons and len(baseline) < BASELINE:
            baseline.append(reading.value)
    return states


def _scatter(values: Sequence[float]) -> float:
    """Standard deviation by the mean moving range, which contains no drift."""
    ranges = [abs(after - before) for before, after in pairwise(values)]
    return sum(ranges) / len(ranges) / _RANGE


def _alone(e_n: float, distance: float, limit: float) -> Iterator[str]:
    """What a check fails by itself, a sentence each."""
    if abs(e_n) > 1:
        yield f"E_n is {e_n:.2f}, beyond 1: the value is not that of the reference"
    if abs(distance) > limit:
        yield "the value is beyond the 3 sigma limits of the chart"
