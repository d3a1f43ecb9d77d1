"""The surface of a record by methods that use the force alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from palpate import Floats

CONTACT_METHODS = ("threshold", "deviation-from-baseline", "gradient")
# Choices.
_AVERAGING_TIME = 0.03  # [s] of the force, for the baseline method
_BINS = 150  # of height on the way down
_MIN_BINS = 10  # that hold a sample, for the gradient method
_SMOOTH_BINS = 5  # that the mean force is averaged over, for its gradient
_MIN_AIR_BINS = 6  # for the scatter of the gradient
_DEVIATION_SIGMAS = 3.0  # of the averaged force, or of the gradient in air
_GRADIENT_SHARE = 0.1  # of the steepest rise
_THRESHOLD_SIGMAS = 5.0  # of the threshold, where none is given
_RECTANGLE = 12.0  # width^2 of a rectangular distribution over its variance
_RISE_SAMPLES = 20  # behind the contact point, of the slope by which noise becomes an error of height


@dataclass(frozen=True)
class ContactPoint:
    """The height of the surface by one method."""

    surface: float  # [m]
    std: float  # [m] by noise and spacing of the samples, without the method's systematic error


@dataclass(frozen=True)
class Approach:
    """The first way down: heights falling, force rising at the end."""

    height: Floats  # (n,) [m]
    force: Floats  # (n,) [N]
    air: int  # samples before touch
    interval: float  # [s]

    @cached_property
    def noise(self) -> float:
        """Standard deviation [N] of one sample in the air."""
        return float(self.force[: self.air].std(ddof=1))


def contact_point(method: str, approach: Approach, threshold: float | None) -> ContactPoint | None:
    """Return the surface by one of CONTACT_METHODS; None where the method finds none.

    `approach` has height [m] and force [N] of the first way down, and how many of its samples are before a touch.
    "threshold": the force exceeds its mean in air by a threshold [N], 5 standard deviations if none is given.
    "deviation-from-baseline": the averaged force exceeds the straight line of the air by 3 of its standard deviations.
    "gradient": the rise of the force over depth exceeds a tenth of its largest, and 3 standard deviations in air.
    """
    if method == "threshold":
        level = threshold if threshold is not None else _THRESHOLD_SIGMAS * approach.noise
        force = approach.force - approach.force[: approach.air].mean()
        return _crossing(approach, force, level, approach.noise)
    if method == "deviation-from-baseline":
        deviation = _baseline_deviation(approach)
        std = float(deviation[: approach.air].std(ddof=1))
        return _crossing(approach, deviation, _DEVIATION_SIGMAS * std, std)
    return _gradient_point(approach)


def _baseline_deviation(approach: Approach) -> Floats:
    """Return the force (n,) [N] less the line of the air, averaged; the line goes on level from the touch."""
    width = max(int(_AVERAGING_TIME / approach.interval) // 2 * 2 + 1, 1)  # odd
    level, slope = _line(np.arange(float(approach.air)), approach.force[: approach.air])
    baseline_steps = np.minimum(np.arange(len(approach.force)), approach.air)
    deviation = approach.force - level - slope * baseline_steps
    padded = np.pad(deviation, width // 2, mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))


def _crossing(approach: Approach, force: Floats, level: float, noise: float) -> ContactPoint | None:
    """Return the height of the last crossing of a level [N] on the way down, halfway between two samples.

    Its uncertainty is that of a place between two samples, a step over sqrt(12), and of the force's noise [N] over its
    rise. `approach` has the heights (n,) [m] of the way down, `force` (n,) [N] is its force less a baseline. None where
    the force is never below the level, or only there.
    """
    rows_below = np.flatnonzero(force <= level)
    if not len(rows_below) or rows_below[-1] >= len(force) - 2:
        return None
    last_below = int(rows_below[-1])
    rows = slice(last_below, min(last_below + _RISE_SAMPLES, len(force)))
    _, rise = _line(approach.height[rows], force[rows])
    upper, lower = approach.height[last_below], approach.height[last_below + 1]
    step = abs(float(lower - upper))
    height = 0.5 * float(lower + upper)
    return ContactPoint(height, float(np.hypot(step / np.sqrt(_RECTANGLE), noise / abs(rise) if rise else np.inf)))


def _line(x: Floats, y: Floats) -> tuple[float, float]:
    """Return value at 0 and slope of the straight line through points (n,); slope 0 where all x are the same."""
    centred = x - x.mean()
    square = float(centred @ centred)
    slope = float(centred @ y) / square if square > 0 else 0.0
    return float(y.mean()) - slope * float(x.mean()), slope


def _gradient_point(approach: Approach) -> ContactPoint | None:
    """Return the last height above the steepest rise of the binned force at which the rise is below its level.

    The level is a tenth of the steepest rise, at least 3 standard deviations of the rise in air. The uncertainty is the
    width of a bin, and as much of it as the rise in air scatters. None for too few bins, or without such a height.
    """
    edges, means = bin_force(approach)
    if len(means) < _MIN_BINS:
        return None
    centres = 0.5 * (edges[1:] + edges[:-1])
    weights = np.full(_SMOOTH_BINS, 1.0 / _SMOOTH_BINS)
    smooth_force = np.convolve(np.pad(means, _SMOOTH_BINS // 2, mode="edge"), weights, mode="valid")
    rise = -np.gradient(smooth_force, centres)  # [N/m] of depth
    in_air = centres > approach.height[: approach.air].min()
    std = float(rise[in_air].std()) if in_air.sum() >= _MIN_AIR_BINS else 0.0
    steepest = int(np.argmax(rise))
    level = max(_GRADIENT_SHARE * rise[steepest], _DEVIATION_SIGMAS * std)
    bins_below = np.flatnonzero(rise[: steepest + 1] <= level)
    if not len(bins_below) or rise[steepest] <= level:
        return None
    width = abs(float(centres[1] - centres[0]))
    return ContactPoint(float(centres[bins_below[-1]]), float(np.hypot(width, width * std / rise[steepest])))


def bin_force(approach: Approach) -> tuple[Floats, Floats]:
    """Return edges (m + 1,) of height [m], falling, and the mean force (m,) [N] between them; empty bins are joined."""
    top, bottom = float(approach.height.max()), float(approach.height.min())
    edges = np.linspace(top, bottom, _BINS + 1)
    bins = np.clip(((top - approach.height) / (top - bottom) * _BINS).astype(int), 0, _BINS - 1)
    counts = np.bincount(bins, minlength=_BINS)
    sums = np.bincount(bins, approach.force, minlength=_BINS)
    filled = np.flatnonzero(counts)
    return np.concatenate([edges[filled], [bottom]]), sums[filled] / counts[filled]
