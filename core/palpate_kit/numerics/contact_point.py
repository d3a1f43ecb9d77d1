"""Where the surface is, by methods that look at the force alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from palpate import Floats

CONTACT_METHODS = ("threshold", "deviation-from-baseline", "gradient")
_SMOOTH = 0.03  # [s] that the force is averaged over for the baseline method
_BINS = 150  # of height on the way down
_DEVIATION = 3.0  # standard deviations of the averaged force
_GRADIENT = 0.1  # of the steepest rise
_SIGMAS = 5.0  # of the threshold, where none is given


@dataclass(frozen=True)
class ContactPoint:
    """A height at which a method sees the surface."""

    surface: float  # [m]
    std: float  # [m] from noise and spacing of the samples; what the method gets wrong by nature is not in it


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
    """Return the surface by one of CONTACT_METHODS; None where the method finds none."""
    noise = approach.noise
    if method == "threshold":
        level = threshold if threshold is not None else _SIGMAS * noise
        return _crossing(approach, approach.force - approach.force[: approach.air].mean(), level, noise)
    if method == "deviation-from-baseline":
        width = max(int(_SMOOTH / approach.interval) // 2 * 2 + 1, 1)
        level, slope = _line(np.arange(float(approach.air)), approach.force[: approach.air])
        lifted = approach.force - level - slope * np.minimum(np.arange(len(approach.force)), approach.air)
        smooth = np.convolve(np.pad(lifted, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")
        spread = float(smooth[: approach.air].std(ddof=1))
        return _crossing(approach, smooth, _DEVIATION * spread, spread)
    return _by_gradient(approach)


def _crossing(approach: Approach, force: Floats, level: float, noise: float) -> ContactPoint | None:
    """Return the last sample on the way down at or below a level, seen from the deepest one back."""
    below = np.flatnonzero(force <= level)
    if not len(below) or below[-1] >= len(force) - 2:
        return None
    at = int(below[-1])
    beyond = slice(at, min(at + 20, len(force)))
    rise = _line(approach.height[beyond], force[beyond])[1]
    step = abs(float(approach.height[at + 1] - approach.height[at]))
    height = 0.5 * float(approach.height[at + 1] + approach.height[at])
    return ContactPoint(height, float(np.hypot(step / np.sqrt(12.0), noise / abs(rise) if rise else np.inf)))


def _line(x: Floats, y: Floats) -> tuple[float, float]:
    """Value at 0 and slope of the straight line through points (n,); no slope where they stand above one another."""
    across = x - x.mean()
    square = float(across @ across)
    slope = float(across @ y) / square if square > 0 else 0.0
    return float(y.mean()) - slope * float(x.mean()), slope


def _by_gradient(approach: Approach) -> ContactPoint | None:
    edges, means = bin_force(approach)
    if len(means) < 10:
        return None
    centres = 0.5 * (edges[1:] + edges[:-1])
    rise = -np.gradient(np.convolve(np.pad(means, 2, mode="edge"), np.full(5, 0.2), mode="valid"), centres)
    air = centres > approach.height[: approach.air].min()
    spread = float(rise[air].std()) if air.sum() > 5 else 0.0
    peak = int(np.argmax(rise))
    level = max(_GRADIENT * rise[peak], _DEVIATION * spread)
    below = np.flatnonzero(rise[: peak + 1] <= level)
    if not len(below) or rise[peak] <= level:
        return None
    width = abs(float(centres[1] - centres[0]))
    return ContactPoint(float(centres[below[-1]]), float(np.hypot(width, width * spread / rise[peak])))


def bin_force(approach: Approach) -> tuple[Floats, Floats]:
    """Edges (m + 1,) of height [m], falling, and mean force (m,) [N] between them; empty bins are joined."""
    top, bottom = float(approach.height.max()), float(approach.height.min())
    edges = np.linspace(top, bottom, _BINS + 1)
    place = np.clip(((top - approach.height) / (top - bottom) * _BINS).astype(int), 0, _BINS - 1)
    counts = np.bincount(place, minlength=_BINS)
    sums = np.bincount(place, approach.force, minlength=_BINS)
    filled = np.flatnonzero(counts)
    return np.concatenate([edges[filled], [bottom]]), sums[filled] / counts[filled]
