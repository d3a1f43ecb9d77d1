"""Where contact begins, by every method side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from palpate import Floats
from palpate_engine import change_point
from palpate_kit.numerics.contact_point import CONTACT_METHODS, Approach, ContactPoint, contact_point

from palpate_indentation.approach_fit import CurveFit
from palpate_indentation.press import Press

_SHARE = 0.1  # of the approach: length of the windows whose variances are compared
_GRID = 41  # heights that are tried together
_LEVELS = 3
_DRAWS = 8  # of noise


@dataclass(frozen=True)
class ContactPointResult:
    """Where a method sees contact begin, and where it would if the fit were the truth."""

    surface: float  # [m]
    std: float  # [m] of what it sees over the draws of noise
    usual: float  # [m] mean of what it sees in the fit's own curve with the fit's own residuals, shifted in a circle

    @property
    def odd(self) -> float:
        """What it sees beyond what the fit explains [m]."""
        return self.surface - self.usual


def contact_points(press: Press, fit: CurveFit) -> dict[str, ContactPointResult]:
    """Return the surface by every method that finds one; `fit` is that of the model, which is one of them.

    By force alone: a threshold of 5 sigma, a smoothed force 3 sigma off its baseline, a tenth of the steepest rise; a
    two-piece law with the power 1.5; a line that goes over into a parabola; the largest ratio of variances behind and
    before. Most of them are late by nature, the more the softer the material: so each is asked for the fitted curve,
    too.
    """
    branch = press.approach
    level = branch.force - fit.baseline(branch.height)
    clean = level - fit.residual
    found = {"fit": ContactPointResult(fit.surface, fit.surface_std, fit.surface)}
    step = len(branch) / (_DRAWS + 1)
    drawn = [clean + np.roll(fit.residual, round((k + 1) * step)) for k in range(_DRAWS)]
    low, high = float(branch.height.min()), float(branch.height.max())
    for method, search in _METHODS.items():
        point = search(press, level)
        if point is None or not low < point.surface < high:
            continue
        others = [other.surface for force in drawn if (other := search(press, force)) is not None]
        if len(others) >= _DRAWS // 2:
            std = float(np.hypot(np.std(others, ddof=1), point.std if np.std(others) == 0 else 0.0))
            found[method] = ContactPointResult(point.surface, std, float(np.mean(others)))
    return found


def _by_force(method: str) -> Callable[[Press, Floats], ContactPoint | None]:
    def search(press: Press, force: Floats) -> ContactPoint | None:
        interval = float(np.median(np.diff(press.approach.time)))
        return contact_point(method, Approach(press.approach.height, force, press.air, interval), None)

    return search


def _by_change_point(press: Press, force: Floats) -> ContactPoint | None:
    height = press.approach.height
    found = change_point(height, force)
    if found is None:
        return None
    surface = found.surface
    depth = np.maximum(surface - height, 0.0)
    reach = max(float(depth.max()), 1e-300)
    rise = found.rise / reach**1.5
    others = np.column_stack([np.ones(len(height)), (depth / reach) ** 1.5])
    return ContactPoint(surface, _std(1.5 * rise * depth**0.5, others, found.rms))


def _by_parabola(press: Press, force: Floats) -> ContactPoint | None:
    """Return a constant, then slope and curvature that are not negative; by least squares over where they begin."""
    height = press.approach.height
    low, high = float(height.min()), float(height.max())
    best: tuple[float, float, Floats] | None = None
    width = (high - low) / (_GRID - 1)
    centre, reach = 0.5 * (low + high), 0.5 * (high - low)
    for _ in range(_LEVELS):
        for surface in np.linspace(centre - reach, centre + reach, _GRID).tolist():
            if low < surface < high:
                depth = np.maximum(surface - height, 0.0) / (high - low)
                matrix = np.column_stack([np.ones(len(height)), depth, depth**2])
                found = np.linalg.lstsq(matrix, force, rcond=None)[0]
                left = float(((force - matrix @ found) ** 2).sum())
                if found[1] >= 0 and found[2] >= 0 and (best is None or left < best[0]):
                    best = left, surface, np.asarray(found, np.float64)
        if best is None:
            return None
        centre, reach, width = best[1], width, 2 * width / (_GRID - 1)
    assert best is not None
    left, surface, found = best
    depth = np.maximum(surface - height, 0.0) / (high - low)
    slope = np.where(depth > 0, found[1] + 2 * found[2] * depth, 0.0) / (high - low)
    others = np.column_stack([np.ones(len(height)), depth, depth**2])
    return ContactPoint(surface, _std(slope, others, float(np.sqrt(left / len(height)))))


def _by_variances(press: Press, force: Floats) -> ContactPoint | None:
    """Where the variance of the readings that follow is largest against that of those before (Gavara 2016)."""
    height, noise = press.approach.height, press.noise
    count = max(int(_SHARE * len(force)), 5)
    if len(force) < 3 * count:
        return None
    sums, squares = (np.concatenate([[0.0], np.cumsum((force - force[:count].mean()) ** k)]) for k in (1, 2))
    mean = (sums[count:] - sums[:-count]) / count
    variance = np.maximum((squares[count:] - squares[:-count]) / count - mean**2, 1e-3 * noise**2)
    ratio = variance[count:] / variance[:-count]
    at = int(np.argmax(ratio))
    place = at + count
    step = abs(float(height[min(place + count, len(height) - 1)] - height[max(place - count, 0)]))
    return ContactPoint(float(height[place]), step / np.sqrt(12.0))


def _std(slope: Floats, others: Floats, rms: float) -> float:
    """Standard deviation [m] of a height of which the force has `slope` (n,), fitted with linear unknowns (n, k)."""
    left = slope - others @ np.linalg.lstsq(others, slope, rcond=None)[0]
    size = float(np.linalg.norm(left))
    return rms / size if size > 0 else float("inf")


_METHODS: Mapping[str, Callable[[Press, Floats], ContactPoint | None]] = {
    **{method: _by_force(method) for method in CONTACT_METHODS},
    "change-point": _by_change_point,
    "line-and-parabola": _by_parabola,
    "ratio-of-variances": _by_variances,
}
