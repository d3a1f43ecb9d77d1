"""A first estimate from a short window: variable projection over the height of the surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Samples, contact_force

Floats = NDArray[np.float64]

_SPAN = 5  # samples to either side over which acceleration is differenced
_FEWEST = 30  # samples
_DEEPEST = 0.012  # [m] of surface above the highest position of the window
_GRID = 49


@dataclass(frozen=True)
class StartFit:
    """Surface and parameters that explain a window best."""

    surface: float  # [m]
    surface_std: float  # [m]
    theta: Floats  # (k,)
    theta_std: Floats  # (k,); 0 where the parameter was not fitted


def fittable(model: ContactModel) -> bool:
    """Whether there is anything that `fit_start` could find: a parameter that the force is proportional to."""
    return any(parameter.role is not None for parameter in model.parameters)


def fit_start(model: ContactModel, mass: float, window: Samples, guess: Floats) -> StartFit | None:
    """Surface height and parameters by least squares on u + m z'' = F(d, d'); None where the window does not tell.

    For every surface height the parameters that the force is proportional to follow from a linear fit, and the height
    from a search (Golub and Pereyra 1973). Parameters without such a role keep their guess. The surface may lie within
    the window's motion: out of contact the force is 0.
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

    surface = _search(lambda height: _misfit(columns(height), force)[0], position)
    misfit, theta = _misfit(columns(surface), force)
    variance = misfit / (len(force) - len(fitted) - 1)
    step = 1e-6
    slope = (columns(surface + step) - columns(surface - step)) @ theta / (2 * step)
    design = np.column_stack([slope, columns(surface)])
    scale = np.linalg.norm(design, axis=0)
    if not (np.isfinite(design).all() and (scale > 0).all() and (theta > 0).all()):
        return None
    information = (design / scale).T @ (design / scale)
    if np.linalg.cond(information) > 1e14:
        return None
    std = np.sqrt(np.diag(np.linalg.inv(information)) * variance) / scale
    if std[1] > theta[0]:  # the first parameter is lost in noise
        return None
    values, deviations = guess.copy(), np.zeros(len(guess))
    values[fitted], deviations[fitted] = theta, std[1:]
    return StartFit(surface, float(std[0]), values, deviations)


def _kinematics(mass: float, window: Samples) -> tuple[Floats, Floats, Floats]:
    """Position [m], depth rate [m/s] and contact force [N] of the samples that have them all."""
    n = _SPAN
    if len(window) <= 2 * n:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    span = window.time[2 * n :] - window.time[: -2 * n]
    acceleration = (window.velocity[2 * n :] - window.velocity[: -2 * n]) / span
    force = window.force[n:-n] + mass * acceleration
    position, rate = window.position[n:-n], -window.velocity[n:-n]
    known = np.isfinite(force) & np.isfinite(rate) & np.isfinite(position)
    return position[known], rate[known], force[known]


def _misfit(columns: Floats, force: Floats) -> tuple[float, Floats]:
    from scipy.optimize import nnls

    scale = np.linalg.norm(columns, axis=0)
    if not np.isfinite(columns).all() or not (scale > 0).all():
        return float(force @ force), np.zeros(columns.shape[1])
    theta, residual = nnls(columns / scale, force)
    return float(residual) ** 2, np.asarray(theta / scale, float)


def _search(misfit: Callable[[float], float], position: Floats) -> float:
    """The surface height of the smallest misfit: a grid from amid the motion upwards, then a bounded search."""
    from scipy.optimize import minimize_scalar

    lowest, highest = float(position.min()), float(position.max())
    reach = np.linspace(0.0, 1.0, _GRID) ** 2 * _DEEPEST
    heights = np.concatenate([np.linspace(lowest, highest, 12)[1:-1], highest + reach])
    costs = [misfit(float(height)) for height in heights]
    best = int(np.argmin(costs))
    low, high = heights[max(best - 1, 0)], heights[min(best + 1, len(heights) - 1)]
    found: Any = minimize_scalar(misfit, bounds=(float(low), float(high)), method="bounded", options={"xatol": 1e-8})
    return float(found.x) if found.fun <= costs[best] else float(heights[best])
