"""Holds of a record: at a depth, so that the force relaxes, or at a force, so that the tip creeps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, Samples

# Choices.
_STEADY_DEPTH = 0.01  # of the largest depth, within which it is held
_STEADY_FORCE = 0.02  # of the largest force, within which it is held
_NOISE_SIGMAS = 8.0  # of smoothed noise, within which a held reading stays
_SMOOTHING_TIME = 0.02  # [s]
_MIN_DURATION = 0.5  # [s]
_MIN_SAMPLES = 100  # of a contact, and of a hold
_MIN_SHARE = 0.1  # of the longest hold
_SECOND_DIFFERENCE = 6.0  # variance of second differences of white noise of variance 1: 1 + 4 + 1
_DEPTH_PREFERENCE = 0.8  # of the longest hold of the force, from which on the depth is held: both of an elastic body


@dataclass(frozen=True)
class Hold:
    """A stretch of a record in which depth, or force, is held."""

    kind: Literal["relaxation", "creep"]
    begin: int
    end: int  # the row after the last

    @property
    def rows(self) -> slice:
        """The rows of the hold."""
        return slice(self.begin, self.end)


def holds_of(time: Floats, depth: Floats, force: Floats) -> list[Hold]:
    """Return the holds of one contact, at times (n,) [s] with depths (n,) [m] and forces (n,) [N].

    A hold is a longest stretch in which the smoothed reading stays within 1 % of the largest depth, or 2 % of the
    largest force, or its noise. All are of the kind whose longest hold is the longer one: a force that has relaxed, or
    a tip that has crept, stands still as well, but later. Those under a tenth of the longest are left out.
    """
    if len(time) < _MIN_SAMPLES:
        return []
    interval = float(np.median(np.diff(time)))
    depth_holds = _stretches(depth, interval, _STEADY_DEPTH)
    force_holds = _stretches(force, interval, _STEADY_FORCE)
    longest_depth_hold = max((end - begin for begin, end in depth_holds), default=0)
    longest_force_hold = max((end - begin for begin, end in force_holds), default=0)
    if longest_depth_hold >= _DEPTH_PREFERENCE * longest_force_hold:
        kind: Literal["relaxation", "creep"] = "relaxation"
        stretches, longest = depth_holds, longest_depth_hold
    else:
        kind, stretches, longest = "creep", force_holds, longest_force_hold
    return [Hold(kind, begin, end) for begin, end in sorted(stretches) if end - begin >= _MIN_SHARE * longest]


def _stretches(values: Floats, interval: float, steady_share: float) -> list[tuple[int, int]]:
    """Return the stretches in which a reading (n,), smoothed, stays within a share of its largest value, or its noise.

    White noise of standard deviation s has second differences of sqrt(6) s; averaged over w samples it is s/sqrt(w).
    """
    width = max(round(_SMOOTHING_TIME / interval), 1)
    padded = np.pad(values, (width // 2, width - 1 - width // 2), "edge")
    smooth = np.convolve(padded, np.ones(width) / width, "valid")
    smooth_noise = float(np.std(np.diff(values, 2)) / np.sqrt(_SECOND_DIFFERENCE * width))
    largest = float(values.max() - min(values.min(), 0.0))
    band = max(steady_share * largest, _NOISE_SIGMAS * smooth_noise)
    return list(_steady_stretches(smooth, band, 0, max(_MIN_SAMPLES, round(_MIN_DURATION / interval))))


def hold_rows(samples: Samples) -> NDArray[np.bool_]:
    """Return the samples (n,) in the holds of each contact."""
    is_held = np.zeros(len(samples), bool)
    touching = np.flatnonzero(np.isfinite(samples.force) & np.isfinite(samples.position) & samples.contact)
    if not len(touching):
        return is_held
    for contact in np.split(touching, np.flatnonzero(np.diff(touching) > 1) + 1):
        depth = np.maximum(samples.position[contact[0]] - samples.position[contact], 0.0)
        for hold in holds_of(samples.time[contact], depth, samples.force[contact]):
            is_held[contact[hold.rows]] = True
    return is_held


def _steady_stretches(values: Floats, band: float, first: int, min_samples: int) -> Iterator[tuple[int, int]]:
    """Yield the longest stretch in which values (n,) stay within a band, then those before and after it.

    `first` is the row of the first value. Stretches under `min_samples` are left out.
    """
    begin, end = _longest_stretch(values, band)
    if end - begin < min_samples:
        return
    yield first + begin, first + end
    yield from _steady_stretches(values[:begin], band, first, min_samples)
    yield from _steady_stretches(values[end:], band, first + end, min_samples)


def _longest_stretch(values: Floats, band: float) -> tuple[int, int]:
    """Return first and last row (exclusive) of the longest stretch whose largest less its smallest value is in a band.

    A window slides over the values. One queue holds the rows of its falling maxima, another those of its rising minima,
    so that the first of each is the window's largest and smallest value.
    """
    from collections import deque

    maxima, minima = deque[int](), deque[int]()
    longest, begin = (0, 0), 0
    numbers = values.tolist()
    for row, number in enumerate(numbers):
        while maxima and numbers[maxima[-1]] <= number:
            maxima.pop()
        while minima and numbers[minima[-1]] >= number:
            minima.pop()
        maxima.append(row)
        minima.append(row)
        # Drop the first rows of the window until it is within the band.
        while numbers[maxima[0]] - numbers[minima[0]] > band:
            begin += 1
            if maxima[0] < begin:
                maxima.popleft()
            if minima[0] < begin:
                minima.popleft()
        if row + 1 - begin > longest[1] - longest[0]:
            longest = (begin, row + 1)
    return longest
