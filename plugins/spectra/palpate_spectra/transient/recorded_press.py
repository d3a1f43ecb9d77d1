"""One press from a recording: free air, a ramp, a hold, perhaps more of them, and free air again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Flag, Floats, LogError
from palpate_kit.numerics.holds import Hold, holds_of

from palpate_spectra.complex_moduli import area
from palpate_spectra.recorded_oscillation import ReplayedSamples, touch_of

_WINDOW = 0.02  # [s] of the local cubic for height and acceleration
_AIR = 50  # samples
_RAMP = 5  # samples from the touch to a hold
_BEFORE = 0.2  # [s] of air before the touch that belong to the press
_CLEAR = 2e-4  # [m] over the place of the touch that is free air for sure


@dataclass(frozen=True)
class RecordedPress:
    """A press from just before the touch to the end of its last hold."""

    name: str
    model: ContactModel
    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N] of the contact: without inertia, and without offset and drift where the air shows them
    height: Floats  # (n,) [m] of the arm's tip, smoothed
    holds: tuple[Hold, ...]
    touch: float  # [m] height at the first sample in contact
    seen: tuple[float, float] | None  # [m] height of the first touch, and how far from there the skin may be
    offset_std: float  # [N] standard uncertainty of the force's zero
    drift: float | None  # [N] that was taken off, between the air before and after; None: no air after
    rig: Mapping[str, Any]  # as `Replayed` has it
    uncertainties: Mapping[str, Any]
    flags: tuple[Flag, ...]

    def depth(self, surface: float, compliance: float) -> Floats:
        """Depth (n,) [m] of the tip under a surface [m], where arm and sensor give way by a compliance [m/N]."""
        return surface - self.height - compliance * self.force

    def area(self, surface: float, compliance: float) -> Floats:
        """Area A(d) c(d) (n,) [m^2] of the tip in the reduced plane."""
        return area(self.model, self.depth(surface, compliance))


def longest_press(replayed: ReplayedSamples, name: str) -> RecordedPress:
    """Return the longest contact of a recording, up to the end of its last hold; raises LogError where nothing is
    held."""
    from scipy.signal import savgol_filter

    samples = replayed.samples[np.isfinite(replayed.samples.force) & np.isfinite(replayed.samples.position)]
    first, last = _longest(samples.contact, name)
    time, step = samples.time, float(np.median(np.diff(samples.time)))
    window = max(2 * round(_WINDOW / step / 2) + 1, 5)
    height = np.asarray(savgol_filter(samples.position, window, 3), np.float64)
    bend = np.asarray(savgol_filter(samples.position, window, 3, deriv=2, delta=step), np.float64)
    force = samples.force + float(replayed.rig["tip_mass"]) * bend
    touch = float(samples.position[first])
    begin = max(first - round(_BEFORE / step), 0)
    before, after = _air(samples.contact, samples.position, begin, last, touch)
    if len(before) < _AIR:
        raise LogError(f"{name}: begins in contact, or nearly so; without its ramp a hold does not determine E(t)")
    zero, offset_std, drift = _zero(time, force, before, after)
    rows = slice(begin, last)
    contact = force - zero
    # By the heights as they were read: of smoothed ones the noise, and so the band of what is held, would be too small.
    holds = holds_of(time[rows], np.maximum(touch - samples.position[rows], 0.0), contact[rows])
    found = [hold for hold in holds if hold.begin >= first - begin + _RAMP]  # air is steady, too
    if not found:
        raise LogError(f"{name}: nothing is held: neither depth nor force is steady for half a second in contact")
    end = found[-1].end
    if found[0].kind == "creep":  # of one force, however often it left its band
        found = [Hold("creep", found[0].begin, end)]
    return RecordedPress(
        name, replayed.model, time[rows][:end], contact[rows][:end], height[rows][:end], tuple(found), touch,
        touch_of(samples), offset_std, drift, replayed.rig, replayed.uncertainties, replayed.flags,
    )  # fmt: skip


def _longest(contact: NDArray[np.bool_], name: str) -> tuple[int, int]:
    """First row and the row after the last of the longest contact."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], contact.astype(np.int8), [0]])))
    if not len(edges):
        raise LogError(f"{name}: the tip never touches")
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])


def _air(
    contact: NDArray[np.bool_], height: Floats, begin: int, last: int, touch: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows in free air before and after a contact."""
    free = ~contact & (height > touch + _CLEAR)
    before, after = np.flatnonzero(~contact[:begin]), last + np.flatnonzero(free[last:])
    return before, after


def _zero(
    time: Floats, force: Floats, before: NDArray[np.int64], after: NDArray[np.int64]
) -> tuple[Floats, float, float | None]:
    """Return the force's zero (n,) [N], its standard uncertainty, and its drift where there is air after the
    contact."""
    mean, std = _mean(force[before])
    if len(after) < _AIR:
        return np.full(len(time), mean), std, None
    later, later_std = _mean(force[after])
    here, there = float(time[before].mean()), float(time[after].mean())
    drift = later - mean
    return mean + drift * (time - here) / (there - here), float(np.hypot(std, later_std) / 2**0.5), drift


def _mean(values: Floats) -> tuple[float, float]:
    """Mean and its standard deviation, by the scatter of ten blocks."""
    blocks = [float(block.mean()) for block in np.array_split(values, 10)]
    return float(values.mean()), float(np.std(blocks, ddof=1) / np.sqrt(10))
