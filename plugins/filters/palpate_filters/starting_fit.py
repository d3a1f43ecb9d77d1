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

PAUSE = 0.02  # [s]; over a longer one the measured position carries the depth, not the process
_SPAN = 5  # samples to either side over which acceleration is differenced, and the motion smoothed
_FEWEST = 30  # samples
_DEEPEST = 0.012  # [m] of surface above the highest position of the window
_GRID = 49
_NEAR = 1e-8  # [m]
_BITS = 24  # of what a window determines


@dataclass(frozen=True)
class BiasPrior:
    """What is known beforehand of a force bias, and how noisy the force is."""

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
    """Whether there is anything that `fit_start` could find: a parameter that the force is proportional to."""
    return any(parameter.role is not None for parameter in model.parameters)


def fit_start(
    model: ContactModel,
    mass: float,
    window: Samples,
    guess: Floats,
    prior: BiasPrior | None = None,
    lenient: bool = False,
) -> StartFit | None:
    """Surface height and parameters by least squares on u + m z'' = F(d, d') + b; None where undetermined.

    For every surface height the parameters that the force is proportional to, and with a prior the bias b, follow from
    a linear fit, and the height from a search (Golub and Pereyra 1973). Parameters without such a role keep their
    guess. The surface may lie within the window's motion: out of contact the force is 0. A `lenient` fit takes a
    viscosity that comes out as 0 for its own standard deviation, where otherwise the window does not determine it.
    """
    position, rate, force = _kinematics(mass, window)
    fitted = [i for i, parameter in enumerate(model.parameters) if parameter.role is not None]
    if len(force) < _FEWEST or not fitted:
        return None

    def columns(surface: float) -> Floats:
        depth = surface - position
        units = np.eye(len(model.parameters))
        rest = (np.zeros_like(depth),) * len(model.memory)
        theta = [np.where(units[i] > 0, 1.0, 0.0 * guess) for i in fitted]
        for one in theta:  # parameters of no role are not zero
            one[[j for j in range(len(guess)) if j not in fitted]] = np.delete(guess, fitted)
        return np.column_stack([contact_force(model, depth, rate, list(one), rest) for one in theta])

    solve = partial(_misfit, force=force, prior=prior)
    surface = _search(lambda height: solve(columns(height))[0], position)
    misfit, theta, bias = solve(columns(surface))
    variance = misfit / (len(force) - len(fitted) - 1)
    step = 1e-6
    slope = (columns(surface + step) - columns(surface - step)) @ theta / (2 * step)
    design = np.column_stack([slope, columns(surface)])
    scale = np.linalg.norm(design, axis=0)
    if lenient and prior is None and theta[0] > 0 and np.isfinite(design).all() and (scale > 0).all():
        theta = np.where(theta > 0, theta, np.sqrt(variance) / scale[1:])
    if not (np.isfinite(design).all() and (scale > 0).all() and (theta > 0).all()):
        return None
    values, deviations = guess.copy(), np.zeros(len(guess))
    values[fitted] = theta
    if prior is not None:
        return _with_bias(surface, values, fitted, bias, design, prior)
    information = (design / scale).T @ (design / scale)
    if np.linalg.cond(information) > 1e14:
        return None
    std_surface, *std = standard_errors(design) * np.sqrt(variance)
    if std[0] > theta[0]:  # the first parameter is lost in noise
        return None
    deviations[fitted] = std
    return StartFit(float(_told(surface)), float(_told(std_surface)), _told(values), _told(deviations))


def _told(value: Any) -> Any:
    """A result of the fit without the digits that only rounding has made, so that every machine starts alike."""
    mantissa, exponent = np.frexp(value)
    return np.ldexp(np.rint(np.ldexp(mantissa, _BITS)), exponent - _BITS)


def _with_bias(
    surface: float, theta: Floats, fitted: list[int], bias: float, design: Floats, prior: BiasPrior
) -> StartFit | None:
    """The fit with a bias, and how surface, parameters and bias hang together."""
    slope, *units = design.T
    parts = [column * theta[i] for column, i in zip(units, fitted, strict=True)]
    # On the chart the first logarithm multiplies the whole force, the others the part of their parameter.
    place = Layout(surface=1, chart=len(theta), bias=1)
    chart = np.zeros((len(slope), len(theta)))
    for i, part in zip(fitted, parts, strict=True):
        chart[:, i] = part
    if fitted[0] == 0:
        chart[:, 0] = np.sum(parts, axis=0)
    whole = np.column_stack([slope, chart, np.ones(len(slope))]) / prior.noise
    information = whole.T @ whole
    determined = np.r_[place.at("surface"), place["chart"].start + np.array(fitted), place.at("bias")]
    known = information[np.ix_(determined, determined)].copy()
    known[-1, -1] += 1.0 / prior.std**2
    scale = np.sqrt(np.diag(known))
    if np.linalg.cond(known / np.outer(scale, scale)) > 1e14:
        return None
    covariance = np.zeros((place.size, place.size))
    covariance[np.ix_(determined, determined)] = scaled_inverse(known)
    std = np.sqrt(np.diag(covariance))
    if std[place["chart"]][fitted[0]] > 1.0:  # the first parameter is lost in noise
        return None
    deviations = _told(theta * std[place["chart"]])
    std_surface = float(_told(std[place.at("surface")]))
    return StartFit(float(_told(surface)), std_surface, _told(theta), deviations, float(_told(bias)), information)


def _kinematics(mass: float, window: Samples) -> tuple[Floats, Floats, Floats]:
    """Position [m], depth rate [m/s] and contact force [N] of the samples that have them all.

    Position and rate are those of local cubics: noise of a regressor takes from what it multiplies, and a filter that
    is linearised in the wrong place at first does not forget it.
    """
    n = _SPAN
    if len(window) <= 2 * n:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    span = window.time[2 * n :] - window.time[: -2 * n]
    acceleration = (window.velocity[2 * n :] - window.velocity[: -2 * n]) / span
    force = window.force[n:-n] + mass * acceleration
    position, rate = _smooth(window.position), -_smooth(window.velocity)
    pauses = np.concatenate([[0], np.cumsum(np.diff(window.time) > PAUSE)])
    known = np.isfinite(force) & np.isfinite(rate) & np.isfinite(position) & (pauses[2 * n :] == pauses[: -2 * n])
    return position[known], rate[known], force[known]


def _smooth(values: Floats) -> Floats:
    """Local cubics (m - 2 n,) of readings (m,); the reading itself next to a missing one."""
    smooth = np.convolve(values, cubic_weights(2 * _SPAN + 1), "valid")
    return np.where(np.isfinite(smooth), smooth, values[_SPAN:-_SPAN])


def _misfit(columns: Floats, force: Floats, prior: BiasPrior | None = None) -> tuple[float, Floats, float]:
    """Sum of squares, parameters (none negative) and, with a prior, bias [N] that explain a force best."""
    scale = np.linalg.norm(columns, axis=0)
    if not np.isfinite(columns).all() or not (scale > 0).all():
        return float(force @ force), np.zeros(columns.shape[1]), 0.0
    fitted, low, target = columns.shape[1], np.zeros(columns.shape[1]), force
    if prior is not None:  # a column for the bias, and the prior as one more reading
        columns = np.column_stack([columns, np.ones(len(force))])
        columns = np.vstack([columns, [*np.zeros(fitted), prior.noise / prior.std]])
        low, target = np.append(low, -np.inf), np.append(force, 0.0)
    found = linear_part(columns, target, low, np.full(len(low), np.inf))
    return found.squares, found.unknowns[:fitted], float(found.unknowns[-1]) if prior is not None else 0.0


def _search(misfit: Callable[[float], float], position: Floats) -> float:
    """The surface height of the smallest misfit: a grid from within the motion upwards, then a bounded search."""
    lowest, highest = float(position.min()), float(position.max())
    reach = np.linspace(0.0, 1.0, _GRID) ** 2 * _DEEPEST
    heights = np.concatenate([np.linspace(lowest, highest, 12)[1:-1], highest + reach])
    costs = [misfit(float(height)) for height in heights]
    best = int(np.argmin(costs))
    low, high = heights[max(best - 1, 0)], heights[min(best + 1, len(heights) - 1)]
    found, cost = bounded_minimum(misfit, float(low), float(high), _NEAR)
    return found if cost <= costs[best] else float(heights[best])
