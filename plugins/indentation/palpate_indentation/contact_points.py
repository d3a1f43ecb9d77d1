"""The surface of a press by every method, side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from palpate import Floats
from palpate_engine import change_point
from palpate_kit.numerics.contact_point import CONTACT_METHODS, Approach, ContactPoint, contact_point

from palpate_indentation.approach_fit import CurveFit
from palpate_indentation.press import Branch, Press

_DRAWS = 8  # of noise, a choice: the mean of a method is known to a third of its scatter
_POWER = 1.5  # of the depth in the law of the change point (Hertz)
_GRID_HEIGHTS = 41  # of the line and parabola, a choice
_GRID_LEVELS = 3  # a choice: the last spacing is a 16 000th of the travel
_WINDOW_SHARE = 0.1  # of the approach, a choice: length of the windows whose variances are compared
_MIN_WINDOW = 5  # samples, a choice: below, a variance is arbitrary
_MIN_VARIANCE = 1e-3  # of that of the noise, a choice: keeps the ratio of variances finite where readings are equal
_RECTANGLE = 12.0  # width^2 of a rectangular distribution over its variance
_MIN_DEPTH = 1e-300  # [m] guards against a division by 0


@dataclass(frozen=True)
class ContactPointResult:
    """The surface by a method, and the one that it would find if the fit were the truth."""

    surface: float  # [m]
    std: float  # [m] of the surface over the draws of noise
    usual: float  # [m] mean over fitted curves with the fit's own residuals, shifted in a circle

    @property
    def odd(self) -> float:
        """Difference [m] of the surface to that in the fitted curve, which the fit does not explain."""
        return self.surface - self.usual


def contact_points(press: Press, fit: CurveFit, branch: Branch) -> dict[str, ContactPointResult]:
    """Return the surface by every method that finds one; `fit` is that of the model to a branch, and one of them.

    By force alone: a threshold of 5 sigma, a smoothed force 3 sigma off its baseline, a tenth of the steepest rise; a
    two-piece law with the power 1.5; a line that goes over into a parabola; the largest ratio of variances behind and
    before. Most of them are late by nature, the more the softer the material: so each is applied to the fitted curve
    as well. They are methods for a way in, so that a fit of the way out stands alone.
    """
    results = {"fit": ContactPointResult(fit.surface, fit.surface_std, fit.surface)}
    approach = press.approach
    if branch is not approach:
        return results
    force = approach.force - fit.baseline(approach.height)
    fitted_force = force - fit.residual
    # Eight draws of noise: the residual, shifted by ninths of the record.
    shift = len(approach) / (_DRAWS + 1)  # samples
    drawn_forces = [fitted_force + np.roll(fit.residual, round((k + 1) * shift)) for k in range(_DRAWS)]
    low, high = float(approach.height.min()), float(approach.height.max())

    for name, method in _METHODS.items():
        point = method(press, force)
        if point is not None and low < point.surface < high:
            drawn_points = [method(press, drawn_force) for drawn_force in drawn_forces]
            result = _compared_result(point, [drawn.surface for drawn in drawn_points if drawn is not None])
            if result is not None:
                results[name] = result
    return results


def _compared_result(point: ContactPoint, drawn_surfaces: Sequence[float]) -> ContactPointResult | None:
    """Return a method's surface with those [m] that it finds in the fitted curve; None if it seldom finds any there."""
    if len(drawn_surfaces) < _DRAWS // 2:
        return None
    # Surfaces that are all the same show no scatter: the method's own uncertainty stands in.
    own_std = point.std if np.std(drawn_surfaces) == 0 else 0.0
    std = float(np.hypot(np.std(drawn_surfaces, ddof=1), own_std))
    return ContactPointResult(point.surface, std, float(np.mean(drawn_surfaces)))


def _force_point(press: Press, force: Floats, method: str) -> ContactPoint | None:
    """Return the surface by one of the kit's methods, which use the force alone."""
    interval = float(np.median(np.diff(press.approach.time)))
    return contact_point(method, Approach(press.approach.height, force, press.air, interval), None)


def _change_point(press: Press, force: Floats) -> ContactPoint | None:
    """Return the surface z_s of a constant that changes to b + c (z_s - z)^1.5."""
    height = press.approach.height
    change = change_point(height, force)
    if change is None:
        return None
    depth = np.maximum(change.surface - height, 0.0)
    max_depth = max(float(depth.max()), _MIN_DEPTH)
    rise = change.rise / max_depth**_POWER
    columns = np.column_stack([np.ones(len(height)), (depth / max_depth) ** _POWER])
    return ContactPoint(change.surface, _height_std(_POWER * rise * depth**0.5, columns, change.rms))


@dataclass(frozen=True)
class _Parabola:
    """A constant that changes to a slope and a curvature at a surface, fitted by least squares."""

    squares: float  # [N^2]
    surface: float  # [m]
    coefficients: Floats  # (3,) [N] constant, slope and curvature, by depths in units of the travel


def _line_and_parabola_point(press: Press, force: Floats) -> ContactPoint | None:
    """Return the surface at which a constant changes to a slope and a curvature that are not negative.

    By least squares: on a grid of heights, then on finer ones about the best of them.
    """
    height = press.approach.height
    low, high = float(height.min()), float(height.max())
    centre, half_width = 0.5 * (low + high), 0.5 * (high - low)
    spacing = (high - low) / (_GRID_HEIGHTS - 1)
    best: _Parabola | None = None
    for _ in range(_GRID_LEVELS):
        surfaces = np.linspace(centre - half_width, centre + half_width, _GRID_HEIGHTS).tolist()
        for surface in (surface for surface in surfaces if low < surface < high):
            parabola = _parabola_at(surface, height, force)
            is_rising = parabola.coefficients[1] >= 0 and parabola.coefficients[2] >= 0
            if is_rising and (best is None or parabola.squares < best.squares):
                best = parabola
        if best is None:
            return None
        centre, half_width = best.surface, spacing
        spacing = 2 * spacing / (_GRID_HEIGHTS - 1)
    assert best is not None
    columns = _parabola_columns(best.surface, height)
    _, slope, curvature = best.coefficients
    depth = columns[:, 1]
    force_slope = np.where(depth > 0, slope + 2 * curvature * depth, 0.0) / (high - low)  # [N/m]
    rms = float(np.sqrt(best.squares / len(height)))
    return ContactPoint(best.surface, _height_std(force_slope, columns, rms))


def _parabola_at(surface: float, height: Floats, force: Floats) -> _Parabola:
    columns = _parabola_columns(surface, height)
    coefficients = np.linalg.lstsq(columns, force, rcond=None)[0]
    squares = float(((force - columns @ coefficients) ** 2).sum())
    return _Parabola(squares, surface, np.asarray(coefficients, np.float64))


def _parabola_columns(surface: float, height: Floats) -> Floats:
    """Return the columns (n, 3) of a constant, depth and its square, with depths in units of the travel."""
    depth = np.maximum(surface - height, 0.0) / (float(height.max()) - float(height.min()))
    return np.column_stack([np.ones(len(height)), depth, depth**2])


def _variance_ratio_point(press: Press, force: Floats) -> ContactPoint | None:
    """Return the height with the largest ratio of the variances of the next and the last readings (Gavara 2016)."""
    height = press.approach.height
    window = max(int(_WINDOW_SHARE * len(force)), _MIN_WINDOW)  # samples
    if len(force) < 3 * window:
        return None
    # Variance within every window, by running sums of the force about its first mean.
    centred = force - force[:window].mean()
    sums, squares = (np.concatenate([[0.0], np.cumsum(centred**power)]) for power in (1, 2))
    mean = (sums[window:] - sums[:-window]) / window
    mean_square = (squares[window:] - squares[:-window]) / window
    variance = np.maximum(mean_square - mean**2, _MIN_VARIANCE * press.noise**2)

    ratio = variance[window:] / variance[:-window]
    contact_row = int(np.argmax(ratio)) + window
    first, last = max(contact_row - window, 0), min(contact_row + window, len(height) - 1)
    two_windows = abs(float(height[last] - height[first]))  # [m]
    return ContactPoint(float(height[contact_row]), two_windows / np.sqrt(_RECTANGLE))


def _height_std(slope: Floats, columns: Floats, rms: float) -> float:
    """Return the standard deviation [m] of a surface by noise [N] of the force.

    `slope` (n,) [N/m] is the derivative of the force by the surface; other unknowns of the fit have `columns` (n, k).
    """
    distinct_slope = slope - columns @ np.linalg.lstsq(columns, slope, rcond=None)[0]
    norm = float(np.linalg.norm(distinct_slope))
    return rms / norm if norm > 0 else float("inf")


_METHODS: Mapping[str, Callable[[Press, Floats], ContactPoint | None]] = {
    **{method: partial(_force_point, method=method) for method in CONTACT_METHODS},
    "change-point": _change_point,
    "line-and-parabola": _line_and_parabola_point,
    "ratio-of-variances": _variance_ratio_point,
}
