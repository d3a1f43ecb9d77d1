"""Least squares of a whole approach: modulus, surface, baseline and its tilt, viscosity; robust if requested."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch
from palpate_indentation.surface_search import LinearModel, SurfaceCandidate, best_surface, with_best_adhesion

_MAX_LOG_ADHESION = 9.0  # a choice: a factor of 8000 either way keeps the exponential finite
_ROBUST_SIGMAS = 1.5  # of the noise, a choice: from there on a reading counts less
_MIN_LOSS_SCALE = 1e-12  # guards against a division by 0
_PRECISION = 1e-14  # relative, of the refined fit: some roundings of a double
_MAX_LAG = 400  # samples, a choice: over which residuals are examined for correlation
_MAX_LAG_SHARE = 4  # of the samples: longer lags have too few pairs, a choice
_WINDOW = 5.0  # correlation times that the sum of autocorrelations extends over (Sokal 1997)
_MIN_FREEDOM = 0.1  # of the samples, a choice: fewer degrees of freedom would make the variance arbitrary


@dataclass(frozen=True)
class CurveFit:
    """The estimate of least squares, with standard uncertainties."""

    modulus: float
    modulus_std: float
    surface: float  # [m]
    surface_std: float  # [m]
    offset: float  # [N] of the baseline at the surface
    offset_std: float  # [N]
    tilt: float  # [N/m] of the baseline over height
    tilt_std: float  # [N/m]
    residual: Floats  # (n,) [N] force less law
    correlation_time: float  # samples that count as one; 1 where residuals are white
    rms: float  # [N]
    viscosity: float  # [SI] beyond that of the law; 0 where it is not an unknown
    viscosity_std: float
    work: float = 0.0  # [J/m^2] of adhesion; 0 of a law without adhesion
    work_std: float = 0.0

    def baseline(self, height: Floats) -> Floats:
        """Return the force (n,) [N] without contact at heights (n,) [m]."""
        return self.offset + self.tilt * (height - self.surface)

    @property
    def effective(self) -> float:
        """Number of independent samples that the correlated ones are worth."""
        return len(self.residual) / self.correlation_time

    def bic_above(self, other: CurveFit, more: int) -> float:
        """Return the BIC above that of another fit of the same readings, which has `more` unknowns less.

        The readings count as many as in that of the two fits whose residual is correlated over the shorter time.
        """
        count = max(self.effective, other.effective)
        return 2.0 * count * float(np.log(self.rms / other.rms)) + more * float(np.log(count))


def fit_curve(
    law: ElasticLaw,
    branch: Branch,
    noise: float,
    *,
    tilt: bool,
    robust: bool = False,
    viscous: bool = False,
) -> CurveFit:
    """Return the least-squares fit of a branch whose readings have a noise [N].

    Unknowns: modulus, surface and offset; with `tilt` that of the baseline, with `viscous` a viscosity beyond that of
    the law, and the work of adhesion of a law that has one, about that of the law. `robust`: by the soft-L1 loss.
    """
    model = LinearModel(law, branch, tilt, viscous)
    if law.adhesion:
        model = with_best_adhesion(model)
    return _refined_fit(_scaled_problem(model, best_surface(model), noise), robust)


@dataclass(frozen=True)
class _ScaledProblem:
    """Least squares over all unknowns at once, from the best surface of the search.

    Scaled unknowns x (p,): the k linear ones in units of their sizes, for an adhesive law the logarithm of the factor
    on its adhesion, and last the shift of the surface in units of the travel.
    """

    model: LinearModel
    start: SurfaceCandidate
    sizes: Floats  # (k,)
    travel: float  # [m]
    noise: float  # [N]

    @property
    def is_adhesive(self) -> bool:
        """True if the work of adhesion is an unknown."""
        return self.model.law.adhesion > 0

    def linear_unknowns(self, x: Floats) -> Floats:
        """Return the linear part of scaled unknowns, or of their uncertainties, (k,) [SI]."""
        return x[: len(self.sizes)] * self.sizes

    def residual(self, x: Floats) -> Floats:
        """Return the residuals (n,) in units of the noise."""
        factor = 1.0
        if self.is_adhesive:
            factor = float(np.exp(np.clip(x[-2], -_MAX_LOG_ADHESION, _MAX_LOG_ADHESION)))
        columns, force = self.model.columns_at(self.start.surface + x[-1] * self.travel, factor)
        return np.asarray((force - columns @ self.linear_unknowns(x)) / self.noise)


def _scaled_problem(model: LinearModel, start: SurfaceCandidate, noise: float) -> _ScaledProblem:
    """Return the problem whose readings in contact stay those of the start, if the law is adhesive.

    A force that jumps where the tip touches would leave least squares without a slope.
    """
    sizes, travel = model.sizes(float(start.unknowns[0])), float(np.ptp(model.branch.height))
    if model.law.adhesion:
        model = replace(model, touching=model.law.geometry(start.surface - model.branch.height) != 0)
    return _ScaledProblem(model, start, sizes, travel, noise)


def _refined_fit(problem: _ScaledProblem, robust: bool) -> CurveFit:
    """Return the least squares of a problem in the units of its unknowns, with standard uncertainties."""
    from scipy.optimize import least_squares

    model, start = problem.model, problem.start
    solution = least_squares(
        problem.residual,
        np.concatenate([start.unknowns / problem.sizes, [0.0] * (1 + problem.is_adhesive)]),
        loss="soft_l1" if robust else "linear",
        f_scale=_ROBUST_SIGMAS,  # the linear loss has no scale
        x_scale="jac",
        xtol=_PRECISION,
        ftol=_PRECISION,
        gtol=_PRECISION,
    )
    x, residual = solution.x, problem.residual(solution.x)
    covariance, correlation = _covariance(np.asarray(solution.jac), residual, robust)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))

    # Back to the units of the unknowns.
    values = dict(zip(model.unknown_names, problem.linear_unknowns(x).tolist(), strict=True))
    stds = dict(zip(model.unknown_names, problem.linear_unknowns(std).tolist(), strict=True))
    work = work_std = 0.0
    if problem.is_adhesive:
        work, work_std = _adhesion_work(model.law, x, covariance, values["modulus"])
    return CurveFit(
        modulus=values["modulus"],
        modulus_std=stds["modulus"],
        surface=start.surface + float(x[-1]) * problem.travel,
        surface_std=float(std[-1] * problem.travel),
        offset=values["offset"],
        offset_std=stds["offset"],
        tilt=values.get("tilt", 0.0),
        tilt_std=stds.get("tilt", 0.0),
        residual=problem.noise * residual,
        correlation_time=correlation,
        rms=problem.noise * float(np.sqrt(np.mean(residual**2))),
        viscosity=values.get("viscosity", 0.0),
        viscosity_std=stds.get("viscosity", 0.0),
        work=work,
        work_std=work_std,
    )


def _adhesion_work(law: ElasticLaw, x: Floats, covariance: Floats, modulus: float) -> tuple[float, float]:
    """Return the work of adhesion [J/m^2] and its standard uncertainty, from the scaled unknowns (p,) and (p, p).

    w = a exp(x_a) E with the law's adhesion a, the logarithm x_a, last but one of the unknowns, and the modulus E,
    which is in proportion to the first: var(w)/w^2 = var(x_0)/x_0^2 + var(x_a) + 2 cov(x_0, x_a)/x_0.
    """
    work = law.adhesion * float(np.exp(x[-2])) * modulus
    relative_variance = covariance[0, 0] / x[0] ** 2 + covariance[-2, -2] + 2 * covariance[0, -2] / x[0]
    return work, work * float(np.sqrt(max(relative_variance, 0.0)))


def _covariance(jacobian: Floats, residual: Floats, robust: bool) -> tuple[Floats, float]:
    """Return the covariance (p, p) of the unknowns of a fit, and how many samples count as one.

    From the slopes (n, p) and residuals r (n,) in units of the noise. An M-estimator has the covariance t s^2
    B J^T J B with B = (J^T diag(psi') J)^-1 (Huber 1981): psi = r, or for the soft-L1 loss of scale C, with
    z = 1 + (r/C)^2, psi = r z^(-1/2) and psi' = z^(-3/2). s^2 is the variance of psi, t its correlation time.
    """
    influence = residual
    influence_slope = np.ones(len(residual))
    if robust:
        z = 1 + (residual / _ROBUST_SIGMAS) ** 2
        # scipy returns the slopes multiplied by the root of psi'.
        jacobian = jacobian / np.maximum(z**-0.75, _MIN_LOSS_SCALE)[:, None]
        influence = residual / np.sqrt(z)
        influence_slope = z**-1.5
    count, unknown_count = jacobian.shape
    correlation = correlation_time(influence)
    bread = scaled_inverse(jacobian.T @ (influence_slope[:, None] * jacobian))
    freedom = max(count - correlation * unknown_count, _MIN_FREEDOM * count)
    variance = float((influence**2).sum()) / freedom
    return correlation * variance * bread @ (jacobian.T @ jacobian) @ bread, correlation


def correlation_time(residual: Floats) -> float:
    """Return how many samples (n,) count as one: 1 + 2 sum of autocorrelations.

    The sum ends at the first lag beyond five times its own value (Sokal 1997, automatic windowing).
    """
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power == 0:
        return 1.0
    total = 1.0
    for lag in range(1, min(_MAX_LAG, len(centred) // _MAX_LAG_SHARE)):
        total += 2.0 * float(centred[:-lag] @ centred[lag:]) / power
        if lag >= _WINDOW * total:
            break
    return max(total, 1.0)
