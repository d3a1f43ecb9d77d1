"""E_n, Shewhart's chart for individuals and the EWMA chart: their limits, and the state of each check."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from palpate_kit.numerics.normalised_error import normalised_error

BASELINE = 25  # checks in control, from whose scatter the limits are then taken: a choice
SHEWHART = 3.0  # standard deviations (ISO 7870-2:2023)
WEIGHT = 0.2  # lambda of the EWMA (Lucas and Saccucci 1990)
EWMA = 2.859  # its standard deviations: 370 checks on average until a false alarm (Lucas and Saccucci 1990)
_MAX_E_N = 1.0  # beyond which a value is not that of the reference (ISO 13528)
_RANGE = 2 / math.sqrt(math.pi)  # d_2: mean moving range of two values over their standard deviation


@dataclass(frozen=True)
class CheckValue:
    """The value of a check [SI], with its uncertainties."""

    value: float
    std: float  # combined standard uncertainty
    repeat_std: float  # of it, what differs from one check to the next


@dataclass(frozen=True)
class CheckState:
    """The state of a check in the chart [SI]: its limits, and those that it fails."""

    e_n: float
    centre: float
    limit: float  # distance from the centre that Shewhart's chart allows
    ewma: float
    ewma_limit: float
    own_scatter: bool  # True: the limits are by the chart's own scatter
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
        """Largest distance from the centre in control."""
        return EWMA * math.hypot(math.sqrt(self.variance), self.common)


def check_states(readings: Sequence[CheckValue], reference: float, reference_std: float) -> list[CheckState]:
    """Return the state of every check, in their order, against a reference value and its standard uncertainty.

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
    average, scatter = _Average(reference, reference), None
    for reading in readings:
        # Once the baseline is whole, centre and limits are its own.
        if scatter is None and len(baseline) == BASELINE:
            scatter, mean = _scatter(baseline), sum(baseline) / BASELINE
            average = _Average(mean, mean) if scatter else average

        # E_n and Shewhart's chart; a check that keeps both is part of the moving average.
        e_n = normalised_error(reading.value, reading.std, reference, reference_std)
        limit = SHEWHART * (scatter or math.hypot(reading.std, reference_std))
        reasons = list(_single_reasons(e_n, reading.value - average.centre, limit))
        if not reasons:
            shared_variance = max(reading.std**2 - reading.repeat_std**2, 0.0) + reference_std**2
            average.add(reading.value, scatter or reading.repeat_std, 0.0 if scatter else math.sqrt(shared_variance))
            if abs(average.value - average.centre) > average.limit:
                reasons.append("the moving average (EWMA) is beyond its limits: a small change that lasts")
        has_scatter = bool(scatter)
        states.append(CheckState(e_n, average.centre, limit, average.value, average.limit, has_scatter, tuple(reasons)))
        if not reasons and len(baseline) < BASELINE:
            baseline.append(reading.value)
    return states


def _scatter(values: Sequence[float]) -> float:
    """Return the standard deviation by the mean moving range, which contains no drift."""
    ranges = [abs(after - before) for before, after in pairwise(values)]
    return sum(ranges) / len(ranges) / _RANGE


def _single_reasons(e_n: float, distance: float, limit: float) -> Iterator[str]:
    """Yield a sentence for each limit that a check fails by itself."""
    if abs(e_n) > _MAX_E_N:
        yield f"E_n is {e_n:.2f}, beyond 1: the value is not that of the reference"
    if abs(distance) > limit:
        yield "the value is beyond the 3 sigma limits of the chart"
