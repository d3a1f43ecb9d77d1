"""Least squares of a whole approach: modulus, surface, baseline and its tilt, viscosity; robust if requested."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse
from palpate_kit.numerics.variable_projection import best_place, linear_part

from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

_GRID = 61  # heights that are tried together
_LEVELS = 4  # each a tenth of the one before
_THIN = 500  # readings, by which an adhesion is looked for
_WIDE = 300.0  # times more and less than what it is looked for about
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
    work: float = 0.0  # [J/m^2] of adhesion; 0 of a law that does not stick
    work_std: float = 0.0

    def baseline(self, height: Floats) -> Floats:
        """(n,) [N]."""
        return self.offset + self.tilt * (height - self.surface)

    @property
    def effective(self) -> float:
        """How many samples count."""
        return len(self.residual) / self.correlation_time

    def bic_above(self, other: CurveFit, more: int) -> float:
        """BIC above that of another fit of the same readings that has so many unknowns less.

        The readings count that do in the fit whose residual hangs together over the shorter time.
        """
        count = max(self.effective, other.effective)
        return 2.0 * count * float(np.log(self.rms / other.rms)) + more * float(np.log(count))


@dataclass(frozen=True)
class _Columns:
    """What the force is linear in, at any height of the surface: modulus, offset, and what else is looked for."""

    law: ElasticLaw
    branch: Branch
    tilt: bool
    viscous: bool
    touching: NDArray[np.bool_] | None = None  # (n,) readings in contact, where they do not follow from the surface

    def at(self, surface: float, sticks: float = 1.0) -> tuple[Floats, Floats]:
        """Columns (n, k), and the force (n,) [N] less what is held; of `sticks` times the law's adhesion."""
        depth, law = surface - self.branch.height, self.law
        if sticks != 1.0:
            law = replace(law, adhesion=sticks * law.adhesion)
        geometry = law.geometry(depth) if self.touching is None else np.where(self.touching, law.stuck(depth), 0.0)
        columns = [geometry, np.ones(len(self.branch))]
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
    viscous: bool = False,
) -> CurveFit:
    """Return the fit of a branch; viscosity is looked for where `viscous`, and adhesion about that of a law that
    sticks."""
    columns = _Columns(law, branch, tilt, viscous)
    if law.adhesion:
        columns = _with_adhesion(columns)
    _, linear, surface = _search(columns, _grid(branch))
    return _refined(columns, noise, robust, linear, surface)


def _search(columns: _Columns, heights: Floats) -> tuple[float, Floats, float]:
    """Sum of squares, linear unknowns and the surface [m] of the best height, on a grid that gets finer."""
    best = min((_linear(columns, float(z)) for z in heights), key=lambda found: found[0])
    width = float(np.ptp(heights)) / (_GRID - 1)
    for _ in range(_LEVELS):
        around = best[2] + np.linspace(-width, width, 21)
        best = min([best, *(_linear(columns, float(z)) for z in around)], key=lambda found: found[0])
        width /= 10.0
    return best


def _with_adhesion(columns: _Columns) -> _Columns:
    """Return the columns with the adhesion of the least sum of squares, by some hundred readings, about that of the
    law."""
    thin = columns.branch.part(slice(None, None, max(len(columns.branch) // _THIN, 1)))

    def of(ratio: float, branch: Branch) -> _Columns:
        return replace(columns, law=replace(columns.law, adhesion=ratio), branch=branch)

    ratios = columns.law.adhesion * _WIDE ** np.linspace(-1.0, 1.0, 9)
    ratio, _ = best_place(lambda ratio, surface, _: _linear(of(ratio, thin), surface)[0], ratios, _grid(thin))
    return of(ratio, columns.branch)


def _grid(branch: Branch) -> Floats:
    """Heights on the way, denser where the force is small."""
    low, high = float(branch.height.min()), float(branch.height.max())
    return np.linspace(low + 0.02 * (high - low), high, _GRID)


def _linear(columns: _Columns, surface: float) -> tuple[float, Floats, float]:
    """Sum of squares, linear unknowns and the surface; a modulus below 0 does not count."""
    found = linear_part(*columns.at(surface))
    return found.squares if found.unknowns[0] > 0 else np.inf, found.unknowns, surface


def _refined(columns: _Columns, noise: float, robust: bool, linear: Floats, surface: float) -> CurveFit:
    from scipy.optimize import least_squares

    reach, scale = float(np.ptp(columns.branch.height)), columns.scales(float(linear[0]))
    sticks, count = columns.law.adhesion > 0, len(linear)
    if sticks:  # a force that jumps where the tip touches would leave least squares without a slope
        columns = replace(columns, touching=columns.law.geometry(surface - columns.branch.height) != 0)

    def residual(x: Floats) -> Floats:
        factor = float(np.exp(np.clip(x[count], -9.0, 9.0))) if sticks else 1.0
        matrix, force = columns.at(surface + x[-1] * reach, factor)
        return np.asarray((force - matrix @ (x[:count] * scale)) / noise)

    start = np.concatenate([linear / scale, [0.0] * (1 + sticks)])
    loss = "soft_l1" if robust else "linear"
    solved = least_squares(
        residual, start, loss=loss, f_scale=_ROBUST, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    x, left = solved.x, residual(solved.x)
    covariance, time = _covariance(np.asarray(solved.jac), left, robust)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    values, errors = x[:count] * scale, std[:count] * scale
    names = ["modulus", "offset", *(["tilt"] * columns.tilt), *(["viscosity"] * columns.viscous)]
    found = {"tilt": 0.0, "viscosity": 0.0, **dict(zip(names, values.tolist(), strict=True))}
    stds = {"tilt": 0.0, "viscosity": 0.0, **dict(zip(names, errors.tolist(), strict=True))}
    work, work_std = 0.0, 0.0
    if sticks:  # the product of modulus and what it sticks
        work = columns.law.adhesion * float(np.exp(x[count])) * found["modulus"]
        share = covariance[0, 0] / x[0] ** 2 + covariance[count, count] + 2 * covariance[0, count] / x[0]
        work_std = work * float(np.sqrt(max(share, 0.0)))
    return CurveFit(
        found["modulus"], stds["modulus"], surface + float(x[-1]) * reach, float(std[-1] * reach), found["offset"],
        found["tilt"], noise * left, time, noise * float(np.sqrt(np.mean(left**2))), stds["offset"], stds["tilt"],
        found["viscosity"], stds["viscosity"], work, work_std,
    )  # fmt: skip


def _covariance(jacobian: Floats, left: Floats, robust: bool) -> tuple[Floats, float]:
    """Of the scaled unknowns (k, k), from residuals (n,) in standard deviations; and how many of them count as one."""
    if robust:  # scipy's Jacobian is scaled by the loss
        jacobian = jacobian / np.maximum((1 + (left / _ROBUST) ** 2) ** -0.75, 1e-12)[:, None]
    influence = left / np.sqrt(1 + (left / _ROBUST) ** 2) if robust else left
    slope = (1 + (left / _ROBUST) ** 2) ** -1.5 if robust else np.ones(len(left))
    time = correlation_time(influence)
    bread = scaled_inverse(jacobian.T @ (slope[:, None] * jacobian))
    variance = float((influence**2).sum()) / max(len(left) - time * jacobian.shape[1], 0.1 * len(left))
    return time * variance * bread @ (jacobian.T @ jacobian) @ bread, time


def correlation_time(residual: Floats) -> float:
    """Return how many samples count as one: 1 + 2 sum of autocorrelations, over a window that grows with it (Sokal
    1997)."""
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
