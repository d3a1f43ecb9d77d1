"""A first estimate from a short window: variable projection over the height of the surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from palpate import ContactModel, Floats, Layout, Samples, contact_force
from palpate_kit.numerics.local_cubic import cubic_weights
from palpate_kit.numerics.normal_equations import scaled_inverse, standard_errors
from palpate_kit.numerics.variable_projection import linear_part

from palpate_filters.bounded_minimum import bounded_minimum

PAUSE = 0.02  # [s], a choice: over a longer pause the measured position carries the depth, not the process
_PAUSE_INTERVALS = 1.5  # a choice: usual intervals of a record of less than 75 Hz, beyond which one is a pause
_HALF_SPAN = 5  # samples, a choice (0150): the motion is smoothed, and acceleration differenced, over 11
_MIN_SAMPLES = 30  # a choice: a shorter window determines no surface
_MAX_RISE = 0.012  # [m], a choice: how far the surface may lie above the highest position of the window
_HEIGHTS_ABOVE = 49  # a choice: grid of the search above the motion, denser near it (the roots are equidistant)
_HEIGHTS_WITHIN = 10  # a choice: grid of the search within the motion
_HEIGHT_TOLERANCE = 1e-8  # [m], a choice: a hundredth of the noise of a height
_HEIGHT_STEP = 1e-6  # [m], a choice: central difference of the force by the height
_SIGNIFICANT_BITS = 24  # of a result (0045): 6e-8 of it, where a standard deviation is 1e-3 at best
_MAX_CONDITION = 1e14  # a choice: beyond it an inverse has no two digits left of a double's 16
_MAX_RELATIVE_STD = 1.0  # a choice: a first parameter that is less certain is lost in noise


@dataclass(frozen=True)
class BiasPrior:
    """The prior of a force bias, and the noise of the force."""

    std: float  # [N]
    noise: float  # [N]


@dataclass(frozen=True)
class StartFit:
    """Surface and parameters that explain a window best."""

    surface: float  # [m]
    surface_std: float  # [m]
    theta: Floats  # (k,)
    theta_std: Floats  # (k,); 0 where the parameter was not fitted
    bias: float = 0.0  # [N]
    # (2 + k, 2 + k) of the window, without the prior: surface [m], chart of `palpate.KinematicProcess`, bias [N]
    information: Floats = field(default_factory=lambda: np.zeros((0, 0)))


def fittable(model: ContactModel) -> bool:
    """Return True if `fit_start` can find anything: a parameter that the force is proportional to."""
    return any(parameter.role is not None for parameter in model.parameters)


@dataclass(frozen=True)
class _FitWindow:
    """Motion and contact force of a window, and the force's columns by the fitted parameters."""

    model: ContactModel
    position: Floats  # (m,) [m]
    rate: Floats  # (m,) [m/s] of the depth
    force: Floats  # (m,) [N]
    guess: Floats  # (k,)
    fitted: list[int]  # parameters that the force is proportional to

    def columns(self, surface: float) -> Floats:
        """Return the force (m, f) of one unit of each fitted parameter, for a height of the surface [m]."""
        depth = surface - self.position
        memory = (np.zeros_like(depth),) * len(self.model.memory)
        columns = []
        for i in self.fitted:
            theta = self.guess.copy()
            theta[self.fitted] = 0.0
            theta[i] = 1.0
            columns.append(contact_force(self.model, depth, self.rate, list(theta), memory))
        return np.column_stack(columns)

    def design(self, surface: float, theta: Floats) -> Floats:
        """Return the slopes (m, 1 + f) of the force by the surface [m] and by the fitted parameters theta (f,)."""
        rise = self.columns(surface + _HEIGHT_STEP) - self.columns(surface - _HEIGHT_STEP)
        slope = rise @ theta / (2 * _HEIGHT_STEP)
        return np.column_stack([slope, self.columns(surface)])


def fit_start(
    model: ContactModel,
    mass: float,
    window: Samples,
    guess: Floats,
    prior: BiasPrior | None = None,
    lenient: bool = False,
) -> StartFit | None:
    """Return surface height and parameters by least squares on u + m z'' = F(d, d') + b; None where undetermined.

    u is the measured force of the `window`, z the tip's height, d the depth; `guess` (k,) has all parameters.
    For every surface height the parameters that the force is proportional to, and with a prior the bias b, follow from
    a linear fit, and the height from a search (Golub and Pereyra 1973). Parameters without such a role keep their
    guess. The surface may lie within the window's motion: out of contact the force is 0. A `lenient` fit takes a
    viscosity that comes out as 0 for its own standard deviation, where otherwise the window does not determine it.
    """
    position, rate, force = _kinematics(mass, window)
    fitted = [i for i, parameter in enumerate(model.parameters) if parameter.role is not None]
    if len(force) < _MIN_SAMPLES or not fitted:
        return None
    fit_window = _FitWindow(model, position, rate, force, guess, fitted)

    # The surface of the smallest misfit, and the linear fit there.
    solve = partial(_misfit, force=force, prior=prior)
    surface = _search(lambda height: solve(fit_window.columns(height))[0], position)
    misfit, theta, bias = solve(fit_window.columns(surface))
    variance = misfit / (len(force) - len(fitted) - 1)  # of the force [N^2]; the surface takes one degree of freedom

    # The window must determine each fitted parameter, and find it positive. The design's columns are the slopes of the
    # force by the surface, and by each fitted parameter.
    design = fit_window.design(surface, theta)
    scale = np.linalg.norm(design, axis=0)
    if not (np.isfinite(design).all() and (scale > 0).all()):
        return None
    if lenient and prior is None and theta[0] > 0:
        # The standard deviation of one parameter alone: that of the force over the length of its column.
        theta = np.where(theta > 0, theta, np.sqrt(variance) / scale[1:])
    if not (theta > 0).all():
        return None
    values = guess.copy()
    values[fitted] = theta
    if prior is not None:
        return _with_bias(surface, theta=values, fitted=fitted, bias=bias, design=design, prior=prior)
    return _without_bias(surface, values, fitted, design, variance)


def _without_bias(
    surface: float, values: Floats, fitted: list[int], design: Floats, variance: float
) -> StartFit | None:
    """Return the fit with the standard deviations of surface and parameters; None where they are not determined."""
    scale = np.linalg.norm(design, axis=0)
    information = (design / scale).T @ (design / scale)
    if np.linalg.cond(information) > _MAX_CONDITION:
        return None
    surface_std, *std = standard_errors(design) * np.sqrt(variance)
    if std[0] > _MAX_RELATIVE_STD * values[fitted[0]]:
        return None
    values_std = np.zeros(len(values))
    values_std[fitted] = std
    return StartFit(float(_rounded(surface)), float(_rounded(surface_std)), _rounded(values), _rounded(values_std))


def _rounded(value: Any) -> Any:
    """Return a result of the fit to `_SIGNIFICANT_BITS`, without the digits of rounding: every machine starts alike."""
    mantissa, exponent = np.frexp(value)
    return np.ldexp(np.rint(np.ldexp(mantissa, _SIGNIFICANT_BITS)), exponent - _SIGNIFICANT_BITS)


def _with_bias(
    surface: float, theta: Floats, fitted: list[int], bias: float, design: Floats, prior: BiasPrior
) -> StartFit | None:
    """Return the fit with a bias, and the information of surface, parameters and bias; None where undetermined.

    `fitted` are the indexes of the parameters among `theta`, `design` (n, 1 + len(fitted)) the slopes of the force by
    the surface and by these. Parameters are in the chart of their logarithms.
    """
    layout = Layout(surface=1, chart=len(theta), bias=1)
    slopes = np.column_stack([design[:, 0], _chart_slopes(design[:, 1:], theta, fitted), np.ones(len(design))])
    slopes = slopes / prior.noise
    information = slopes.T @ slopes

    # The covariance of what window and prior determine, unless they hardly do.
    rows = np.r_[layout.at("surface"), layout["chart"].start + np.array(fitted), layout.at("bias")]
    total = information[np.ix_(rows, rows)].copy()
    total[-1, -1] += 1.0 / prior.std**2
    scale = np.sqrt(np.diag(total))
    if np.linalg.cond(total / np.outer(scale, scale)) > _MAX_CONDITION:
        return None
    covariance = np.zeros((layout.size, layout.size))
    covariance[np.ix_(rows, rows)] = scaled_inverse(total)

    std = np.sqrt(np.diag(covariance))
    chart_std = std[layout["chart"]]  # of logarithms, so relative
    if chart_std[fitted[0]] > _MAX_RELATIVE_STD:
        return None
    return StartFit(
        surface=float(_rounded(surface)),
        surface_std=float(_rounded(std[layout.at("surface")])),
        theta=_rounded(theta),
        theta_std=_rounded(theta * chart_std),
        bias=float(_rounded(bias)),
        information=information,
    )


def _chart_slopes(columns: Floats, theta: Floats, fitted: list[int]) -> Floats:
    """Return the slopes (m, k) of the force by the chart of `palpate.KinematicProcess`.

    The first logarithm multiplies the whole force, each other one the part of its parameter.
    """
    parts = [column * theta[i] for column, i in zip(columns.T, fitted, strict=True)]
    chart = np.zeros((len(columns), len(theta)))
    for i, part in zip(fitted, parts, strict=True):
        chart[:, i] = part
    if fitted[0] == 0:
        chart[:, 0] = np.sum(parts, axis=0)
    return chart


def _kinematics(mass: float, window: Samples) -> tuple[Floats, Floats, Floats]:
    """Return position [m], depth rate [m/s] and contact force [N] of the samples that have them all.

    Position and rate are those of local cubics: noise of a regressor takes from what it multiplies, and a filter that
    is linearised in the wrong place at first does not forget it.
    """
    n = _HALF_SPAN
    if len(window) <= 2 * n:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    span = window.time[2 * n :] - window.time[: -2 * n]
    acceleration = (window.velocity[2 * n :] - window.velocity[: -2 * n]) / span
    force = window.force[n:-n] + mass * acceleration
    position, rate = _smooth(window.position), -_smooth(window.velocity)
    # No difference reaches over a pause, which is longer than the usual interval of slow readings.
    steps = np.diff(window.time)
    pauses = np.concatenate([[0], np.cumsum(steps > max(PAUSE, _PAUSE_INTERVALS * float(np.median(steps))))])
    has_all = np.isfinite(force) & np.isfinite(rate) & np.isfinite(position) & (pauses[2 * n :] == pauses[: -2 * n])
    return position[has_all], rate[has_all], force[has_all]


def _smooth(values: Floats) -> Floats:
    """Return local cubics (m - 2 n,) of readings (m,); the reading itself next to a missing one."""
    smooth = np.convolve(values, cubic_weights(2 * _HALF_SPAN + 1), "valid")
    return np.where(np.isfinite(smooth), smooth, values[_HALF_SPAN:-_HALF_SPAN])


def _misfit(columns: Floats, force: Floats, prior: BiasPrior | None = None) -> tuple[float, Floats, float]:
    """Return sum of squares, parameters (none negative) and, with a prior, bias [N] that explain a force best."""
    scale = np.linalg.norm(columns, axis=0)
    if not np.isfinite(columns).all() or not (scale > 0).all():
        return float(force @ force), np.zeros(columns.shape[1]), 0.0
    fitted, low, target = columns.shape[1], np.zeros(columns.shape[1]), force
    if prior is not None:  # a column for the bias, and the prior as one more reading
        columns = np.column_stack([columns, np.ones(len(force))])
        columns = np.vstack([columns, [*np.zeros(fitted), prior.noise / prior.std]])
        low, target = np.append(low, -np.inf), np.append(force, 0.0)
    fit = linear_part(columns, target, low, np.full(len(low), np.inf))
    bias = float(fit.unknowns[-1]) if prior is not None else 0.0
    return fit.squares, fit.unknowns[:fitted], bias


def _search(misfit: Callable[[float], float], position: Floats) -> float:
    """Return the surface height of the smallest misfit: by a grid from within the motion upwards, then a search."""
    lowest, highest = float(position.min()), float(position.max())
    within = np.linspace(lowest, highest, _HEIGHTS_WITHIN + 2)[1:-1]
    above = highest + np.linspace(0.0, 1.0, _HEIGHTS_ABOVE) ** 2 * _MAX_RISE
    heights = np.concatenate([within, above])
    costs = [misfit(float(height)) for height in heights]
    best = int(np.argmin(costs))
    low, high = heights[max(best - 1, 0)], heights[min(best + 1, len(heights) - 1)]
    height, cost = bounded_minimum(misfit, float(low), float(high), _HEIGHT_TOLERANCE)
    return height if cost <= costs[best] else float(heights[best])
