"""Cramer-Rao bounds of a palpation's parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import ContactModel, Floats
from palpate_engine import force_slopes

from palpate_studies.design.tip_path import DepthPath


@dataclass(frozen=True)
class Nuisances:
    """What else is not known, by its standard uncertainty; the height of the surface is never known."""

    bias: float  # [N] offset of the force
    skew: float | None  # [s] between force and motion; None: known
    mass: float | None = None  # [kg] of the tip; None: known


@dataclass(frozen=True)
class CramerRaoBound:
    """The smallest standard deviations that any unbiased estimator can reach."""

    parameters: Mapping[str, float]  # [SI] by name; infinite where the data do not tell them
    surface: float  # [m]
    bias: Mapping[str, float]  # [SI] by name: what the interpolation of the force moves the parameters by

    def rmse(self, name: str) -> float:
        """Root mean square error [SI] of an estimator that reaches the bound: standard deviation and bias together."""
        return math.hypot(self.parameters[name], self.bias[name])


def cramer_rao(
    model: ContactModel,
    theta: Sequence[float],
    path: DepthPath,
    tip_mass: float,
    noise: float | Floats,
    nuisances: Nuisances,
    slopes: tuple[Floats, Floats, Floats, Floats] | None = None,
    error: Floats | None = None,
) -> CramerRaoBound:
    """Bounds from the force along a motion, u = F(d, d'; theta) + m d'' + bias, with white `noise` [N] (n,) or one.

    Fisher information J^T J/sigma^2 + priors, with columns dF/dtheta, dF/dd (the surface), 1 (bias), du/dt (skew) and
    d'' (mass); priors 1/u^2 on the nuisances, none on parameters and surface. Source: Cramer 1946, Rao 1945; van Trees
    1968 for the priors. `slopes` are those of `force_slopes` along the path, where they are at hand. A systematic
    `error` of the force (n,) [N] moves the parameters of least squares by (J^T J)^-1 J^T error, with columns for
    parameters and surface: a fit takes offset, timing and mass as it is told.
    """
    _, by_parameter, by_depth, by_rate = slopes or force_slopes(model, path.depth, path.rate, theta)
    columns = [*by_parameter.T, by_depth, np.ones_like(path.time)]
    priors = [0.0] * (len(theta) + 1) + [nuisances.bias]
    if nuisances.skew is not None:
        columns.append(by_depth * path.rate + by_rate * path.acceleration + tip_mass * path.jerk)
        priors.append(nuisances.skew)
    if nuisances.mass is not None:
        columns.append(path.acceleration)
        priors.append(nuisances.mass)
    weight = 1.0 / np.broadcast_to(noise, path.time.shape)
    std = _stds(np.column_stack(columns) * weight[:, None], np.array(priors))
    moved = np.zeros(len(theta))
    if error is not None and np.isfinite(std).all():
        jacobian = np.column_stack(columns[: len(theta) + 1])
        scale = np.linalg.norm(jacobian, axis=0)  # the parameters' units differ by many powers of ten
        moved = (np.linalg.lstsq(jacobian / scale, error, rcond=None)[0] / scale)[: len(theta)]
    names = [parameter.name for parameter in model.parameters]
    std_of, bias_of = (dict(zip(names, values.tolist(), strict=False)) for values in (std, moved))
    return CramerRaoBound(std_of, float(std[len(theta)]), bias_of)


def _stds(jacobian: Floats, priors: Floats) -> Floats:
    """Square roots of the diagonal of the inverse information; infinite where the columns cannot be told apart."""
    # Columns of length one: the parameters' units differ by many powers of ten.
    scale = np.linalg.norm(jacobian, axis=0)
    if not (scale[: np.flatnonzero(priors)[0]] > 0).all():
        return np.full(len(priors), np.inf)
    scale = np.where(scale > 0, scale, 1.0)
    known = np.where(priors > 0, 1.0 / (np.where(priors > 0, priors, 1.0) * scale), 0.0)
    rows = np.vstack([jacobian / scale, np.diag(known)])
    _, singular, turned = np.linalg.svd(rows, full_matrices=False)
    if singular[-1] < 1e-9 * singular[0]:
        return np.full(len(priors), np.inf)
    variance = ((turned.T / singular) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(variance) / scale)
