"""Least squares of a whole approach: modulus, surface, baseline and its tilt, viscosity; robust where it is wanted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

_GRID = 61  # heights that are tried together
_LEVELS = 4  # each a tenth of the one before
_ROBUST = 1.5  # noise standard deviations from which on a reading counts less
_LAGS = 400  # samples over which residuals may hang together


@dataclass(frozen=True)
class CurveFit:
    """What least squares finds."""

    modulus: float
    modulus_std: float
    surface: float  # [m]
    surface_std: float  # [m]
    offset: float  # [N] of the baseline at the surface
    tilt: float  # [N/m] of it over height
    residual: Floats  # (n,) [N] force less law
    correlation_time: float  # samples that count as one; 1 where residuals are white
    rms: float  # [N]
    offset_std: float  # [N]
    tilt_std: float  # [N/m]
    viscosity: float  # [SI] beyond what the law holds; 0 where it is not looked for
    viscosity_std: float

    def baseline(self, height: Floats) -> Floats:
        """(n,) [N]."""
        return self.offset + self.tilt * (height - self.surface)

    @property
    def effective(self) -> float:
        """How many samples count."""
        return len(self.residual) / self.correlation_time


@dataclass(frozen=True)
class _Columns:
    """What the force is linear in, at any height of the surface: modulus, offset, and what else is looked for."""

    law: ElasticLaw
    branch: Branch
    tilt: bool
    viscous: bool

    def at(self, surface: float) -> tuple[Floats, Floats]:
        """Columns (n, k), and the force (n,) [N] less what is held."""
        depth = surface - self.branch.height
        columns = [self.law.geometry(depth), np.ones(len(self.branch))]
        if self.tilt:
            columns.append(self.branch.height - surface)
        if self.viscous:
            columns.append(self.law.damping(depth, self.branch.rate))
        return np.column_stack(columns), self.branch.force - self.law.rest(depth, self.branch.rate)

    def scales(self, modulus: float) -> Floats:
        """Sizes (k,) of the unknowns."""
        force, rate = float(np.ptp(self.branch.force)), float(np.max(np.abs(self.branch.rate)))
        reach, size = float(np.ptp(self.branch.height)), max(abs(modulus), 1e-300)
        tilt, viscous = [force / reach] * self.tilt, [size * reach / max(rate, 1e-300)] * self.viscous
        return np.array([size, force, *tilt, *viscous])


def fit_curve(
    law: ElasticLaw,
    branch: Branch,
    noise: float,
    *,
    tilt: bool,
    robust: bool = False,
    surface: float | None = None,
    viscous: bool = False,
) -> CurveFit:
    """The fit of a branch; a `surface` [m] that is given is held, and viscosity is looked for where `viscous`."""
    columns = _Columns(law, branch, tilt, viscous)
    heights = _grid(branch) if surface is None else np.array([surface])
    best = min((_linear(columns, float(z)) for z in heights), key=lambda found: found[0])
    if surface is None:
        width = float(np.ptp(heights)) / (_GRID - 1)
        for _ in range(_LEVELS):
            around = best[2] + np.linspace(-width, width, 21)
            best = min([best, *(_linear(columns, float(z)) for z in around)], key=lambda found: found[0])
            width /= 10.0
    return _refined(columns, noise, robust, best[1], best[2], surface is not None)


def _grid(branch: Branch) -> Floats:
    """Heights on the way, denser where the force is small."""
    low, high = float(branch.height.min()), float(branch.height.max())
    return np.linspace(low + 0.02 * (high - low), high, _GRID)


def _linear(columns: _Columns, surface: float) -> tuple[float, Floats, float]:
    """Sum of squares, linear unknowns and the surface; a modulus below 0 does not count."""
    matrix, force = columns.at(surface)
    scale = np.sqrt((matrix**2).sum(axis=0))
    scale[scale == 0] = 1.0
    found = np.linalg.lstsq(matrix / scale, force, rcond=None)[0] / scale
    left = float(((force - matrix @ found) ** 2).sum())
    return (left if found[0] > 0 else np.inf), found, surface


def _refined(columns: _Columns, noise: float, robust: bool, linear: Floats, surface: float, held: bool) -> CurveFit:
    from scipy.optimize import least_squares

    reach, scale = float(np.ptp(columns.branch.height)), columns.scales(float(linear[0]))

    def residual(x: Floats) -> Floats:
        matrix, force = columns.at(surface + x[-1] * reach)
        return np.asarray((force - matrix @ (x[:-1] * scale)) / noise)

    def frozen(x: Floats) -> Floats:
        return residual(np.append(x, 0.0))

    start = np.append(linear / scale, 0.0)
    function, x = (frozen, start[:-1]) if held else (residual, start)
    loss = "soft_l1" if robust else "linear"
    solved = least_squares(function, x, loss=loss, f_scale=_ROBUST, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    x = np.append(solved.x, 0.0) if held else solved.x
    left = residual(x)
    covariance, time = _covariance(np.asarray(solved.jac), left, robust)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values, errors = x[:-1] * scale, (std if held else std[:-1]) * scale
    names = ["modulus", "offset", *(["tilt"] * columns.tilt), *(["viscosity"] * columns.viscous)]
    found = {"tilt": 0.0, "viscosity": 0.0, **dict(zip(names, values.tolist(), strict=True))}
    stds = {"tilt": 0.0, "viscosity": 0.0, **dict(zip(names, errors.tolist(), strict=True))}
    return CurveFit(
        found["modulus"], stds["modulus"], surface + float(x[-1]) * reach, 0.0 if held else float(std[-1] * reach),
        found["offset"], found["tilt"], noise * left, time, noise * float(np.sqrt(np.mean(left**2))), stds["offset"],
        stds["tilt"], found["viscosity"], stds["viscosity"],
    )  # fmt: skip


def _covariance(jacobian: Floats, left: Floats, robust: bool) -> tuple[Floats, float]:
    """Of the scaled unknowns (k, k), from residuals (n,) in standard deviations; and how many of them count as one."""
    if robust:  # scipy's Jacobian is scaled by the loss
        jacobian = jacobian / np.maximum((1 + (left / _ROBUST) ** 2) ** -0.75, 1e-12)[:, None]
    influence = left / np.sqrt(1 + (left / _ROBUST) ** 2) if robust else left
    slope = (1 + (left / _ROBUST) ** 2) ** -1.5 if robust else np.ones(len(left))
    time = correlation_time(influence)
    bread = np.linalg.pinv(jacobian.T @ (slope[:, None] * jacobian))
    variance = float((influence**2).sum()) / max(len(left) - time * jacobian.shape[1], 0.1 * len(left))
    return time * variance * bread @ (jacobian.T @ jacobian) @ bread, time


def correlation_time(residual: Floats) -> float:
    """How many samples count as one: 1 + 2 sum of autocorrelations, over a window that grows with it (Sokal 1997)."""
    left = residual - residual.mean()
    power = float(left @ left)
    if power == 0:
        return 1.0
    most = min(_LAGS, len(left) // 4)
    total = 1.0
    for lag in range(1, most):
        total += 2.0 * float(left[:-lag] @ left[lag:]) / power
        if lag >= 5.0 * total:
            break
    return max(total, 1.0)
