"""Least squares of a whole approach: modulus, surface, baseline and its tilt, robust where it is wanted."""

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

    def baseline(self, height: Floats) -> Floats:
        """(n,) [N]."""
        return self.offset + self.tilt * (height - self.surface)

    @property
    def effective(self) -> float:
        """How many samples count."""
        return len(self.residual) / self.correlation_time


def fit_curve(
    law: ElasticLaw, branch: Branch, noise: float, *, tilt: bool, robust: bool = False, surface: float | None = None
) -> CurveFit:
    """The fit of a branch; with a `surface` [m] that is held, of modulus and baseline only."""
    heights = _grid(branch) if surface is None else np.array([surface])
    best = min((_linear(law, branch, float(z), tilt) for z in heights), key=lambda found: found[0])
    if surface is None:
        width = float(np.ptp(heights)) / (_GRID - 1)
        for _ in range(_LEVELS):
            around = best[2] + np.linspace(-width, width, 21)
            best = min([best, *(_linear(law, branch, float(z), tilt) for z in around)], key=lambda found: found[0])
            width /= 10.0
    return _refined(law, branch, noise, tilt, robust, best[1], best[2], surface is not None)


def _grid(branch: Branch) -> Floats:
    """Heights on the way, denser where the force is small."""
    low, high = float(branch.height.min()), float(branch.height.max())
    return np.linspace(low + 0.02 * (high - low), high, _GRID)


def _columns(law: ElasticLaw, branch: Branch, surface: float, tilt: bool) -> tuple[Floats, Floats]:
    depth = surface - branch.height
    columns = [law.geometry(depth), np.ones(len(branch))]
    if tilt:
        columns.append(branch.height - surface)
    return np.column_stack(columns), branch.force - law.rest(depth, branch.rate)


def _linear(law: ElasticLaw, branch: Branch, surface: float, tilt: bool) -> tuple[float, Floats, float]:
    """Sum of squares, linear unknowns and the surface; a modulus below 0 does not count."""
    matrix, force = _columns(law, branch, surface, tilt)
    scale = np.sqrt((matrix**2).sum(axis=0))
    scale[scale == 0] = 1.0
    found = np.linalg.lstsq(matrix / scale, force, rcond=None)[0] / scale
    left = float(((force - matrix @ found) ** 2).sum())
    return (left if found[0] > 0 else np.inf), found, surface


def _refined(
    law: ElasticLaw, branch: Branch, noise: float, tilt: bool, robust: bool, linear: Floats, surface: float, held: bool
) -> CurveFit:
    from scipy.optimize import least_squares

    reach = float(np.ptp(branch.height))
    scale = np.array(
        [max(abs(linear[0]), 1e-300), float(np.ptp(branch.force)), *([np.ptp(branch.force) / reach] * tilt)]
    )

    def residual(x: Floats) -> Floats:
        matrix, force = _columns(law, branch, surface + x[-1] * reach, tilt)
        return np.asarray((force - matrix @ (x[:-1] * scale)) / noise)

    def frozen(x: Floats) -> Floats:
        return residual(np.append(x, 0.0))

    start = np.append(linear / scale, 0.0)
    function, x = (frozen, start[:-1]) if held else (residual, start)
    loss = "soft_l1" if robust else "linear"
    solved = least_squares(function, x, loss=loss, f_scale=_ROBUST, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    x = np.append(solved.x, 0.0) if held else solved.x
    left = residual(x)
    jacobian = np.asarray(solved.jac)
    if robust:  # scipy's Jacobian is scaled by the loss
        jacobian = jacobian / np.maximum((1 + (left / _ROBUST) ** 2) ** -0.75, 1e-12)[:, None]
    influence = left / np.sqrt(1 + (left / _ROBUST) ** 2) if robust else left
    slope = (1 + (left / _ROBUST) ** 2) ** -1.5 if robust else np.ones(len(left))
    time = correlation_time(influence)
    bread = np.linalg.pinv(jacobian.T @ (slope[:, None] * jacobian))
    variance = float((influence**2).sum()) / max(len(left) - time * len(solved.x), 0.1 * len(left))
    covariance = time * variance * bread @ (jacobian.T @ jacobian) @ bread
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values = x[:-1] * scale
    height = surface + x[-1] * reach
    rms = noise * float(np.sqrt(np.mean(left**2)))
    return CurveFit(
        float(values[0]), float(std[0] * scale[0]), height, 0.0 if held else float(std[-1] * reach),
        float(values[1]), float(values[2]) if tilt else 0.0, noise * left, time, rms, float(std[1] * scale[1]),
        float(std[2] * scale[2]) if tilt else 0.0,
    )  # fmt: skip


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
