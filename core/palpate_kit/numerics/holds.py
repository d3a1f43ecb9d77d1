"""Where a record holds still: at a depth, so that the force relaxes, or at a force, so that the tip creeps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, Samples

_STEADY = 0.01  # of the largest depth: less is not motion
_EVEN = 0.02  # of the largest force
_NOISE = 8.0  # standard deviations of smoothed noise that a still reading spreads over
_SMOOTH = 0.02  # [s]
_SHORTEST = 0.5  # [s]
_FEWEST = 100  # samples
_SHARE = 0.1  # of the longest hold
_CLEARLY = 0.8  # of the time that the force is still, and it is the depth that is held: both are, of an elastic body


@dataclass(frozen=True)
class Hold:
    """A stretch of a record in which depth, or force, is held."""

    kind: Literal["relaxation", "creep"]
    begin: int
    end: int  # the row after the last

    @property
    def rows(self) -> slice:
        """Its rows."""
        return slice(self.begin, self.end)


def holds_of(time: Floats, depth: Floats, force: Floats) -> list[Hold]:
    """The holds of one contact, at times (n,) [s] with depths (n,) [m] and forces (n,) [N]; all of the longest's kind.

    A hold is a longest stretch in which the smoothed reading stays within 1 % of the largest depth, or 2 % of the
    largest force, or its noise. Of depth and force, that which is held for longer is what is held: a force that has
    relaxed, or a tip that has crept, is still, too, but later.
    """
    if len(time) < _FEWEST:
        return []
    step = float(np.median(np.diff(time)))
    width = max(round(_SMOOTH / step), 1)
    stretches = {}
    for name, values, share in (("relaxation", depth, _STEADY), ("creep", force, _EVEN)):
        padded = np.pad(values, (width // 2, width - 1 - width // 2), "edge")
        smooth = np.convolve(padded, np.ones(width) / width, "valid")
        noise = float(np.std(np.diff(values, 2)) / np.sqrt(6.0 * width))
        within = max(share * float(values.max() - min(values.min(), 0.0)), _NOISE * noise)
        least = max(_FEWEST, round(_SHORTEST / step))
        stretches[name] = list(_still(smooth, within, 0, least))
    longest = {name: max((b - a for a, b in found), default=0) for name, found in stretches.items()}
    held = longest["relaxation"] >= _CLEARLY * longest["creep"]
    kind: Literal["relaxation", "creep"] = "relaxation" if held else "creep"
    kept = [(a, b) for a, b in stretches[kind] if b - a >= _SHARE * longest[kind]]
    return [Hold(kind, a, b) for a, b in sorted(kept)]


def hold_rows(samples: Samples) -> NDArray[np.bool_]:
    """(n,) the samples in the holds of each contact."""
    held = np.zeros(len(samples), bool)
    known = np.flatnonzero(np.isfinite(samples.force) & np.isfinite(samples.position) & samples.contact)
    if len(known):
        for contact in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
            depth = np.maximum(samples.position[contact[0]] - samples.position[contact], 0.0)
            for hold in holds_of(samples.time[contact], depth, samples.force[contact]):
                held[contact[hold.rows]] = True
    return held


def _still(values: Floats, within: float, first: int, least: int) -> Iterator[tuple[int, int]]:
    """Yield the longest stretch in which values stay within a range, and those before and after it."""
    begin, end = _longest(values, within)
    if end - begin < least:
        return
    yield first + begin, first + end
    yield from _still(values[:begin], within, first, least)
    yield from _still(values[end:], within, first + end, least)


def _longest(values: Floats, within: float) -> tuple[int, int]:
    """First and last row (exclusive) of the longest stretch whose largest value less its smallest is `within`."""
    from collections import deque

    high, low = deque[int](), deque[int]()
    best, begin = (0, 0), 0
    listed = values.tolist()
    for i, value in enumerate(listed):
        while high and listed[high[-1]] <= value:
            high.pop()
        while low and listed[low[-1]] >= value:
            low.pop()
        high.append(i)
        low.append(i)
        while listed[high[0]] - listed[low[0]] > within:
            begin += 1
            if high[0] < begin:
                high.popleft()
            if low[0] < begin:
                low.popleft()
        if i + 1 - begin > best[1] - best[0]:
            best = (begin, i + 1)
    return best
