"""Lines of one or many recordings as one set of data: their common errors, and the scatter between recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.spectral_lines import Phasors

# Choices.
_MAX_ITERATIONS = 20  # of a fit whose covariance follows from its own prediction
_CONVERGED_SHARE = 1e-6  # of the largest modulus: a prediction that changes by less has converged
_MIN_SCATTER, _MAX_SCATTER = 1e-5, 3.0  # of moduli between recordings, as a share of them
_ZERO_SCATTER = 2 * _MIN_SCATTER  # an estimate up to this is at its lower bound, and means no scatter
_SCATTER_GRID = (1e-4, 2e-3, 1e-2, 5e-2, 0.25)  # shares from the best of which, for G' and for G'', the search starts
_SEARCH_TOLERANCES = {"xatol": 1e-4, "fatol": 1e-7}  # of the logarithm of a share, and of -2 log(likelihood)
_SINGULAR_SHARE = 1e-9  # of the largest singular value; directions below it are rounding
_UPPER_QUANTILE = 0.975  # of an interval of 95 %
_MIN_VALUE = 1e-300  # keeps a division by a norm or a variance finite


@dataclass(frozen=True)
class RecordingScatter:
    """Standard deviation of the moduli between recordings, as a share of them, beyond their own uncertainty."""

    storage: float = 0.0
    loss: float = 0.0
    recordings: int = 1

    @property
    def parameter_count(self) -> int:
        """Number of the shares that were estimated and are not 0."""
        return int(self.storage > 0) + int(self.loss > 0)


@dataclass(frozen=True)
class WeightedFit:
    """A least-squares fit to n lines under one covariance."""

    residual: Floats  # (2 n,) data less model [Pa], as `stack_moduli` orders them
    derivatives: Floats  # (2 n, p) of the model by its free parameters
    prediction: Phasors  # (n,) the model's G* [Pa]


@dataclass(frozen=True)
class JointFit:
    """A fit under the covariance that its own prediction gives."""

    fit: WeightedFit
    cholesky_factor: Floats  # (2 n, 2 n) of the covariance [Pa]
    scatter: RecordingScatter
    scatter_covariances: tuple[Floats, ...]  # (2 n, 2 n) [Pa^2] parts of the covariance by the scatter of G', of G''

    @property
    def chi2(self) -> float:
        """Sum of the squares of the residuals, uncorrelated and in units of their standard deviation."""
        whitened_residual = np.linalg.solve(self.cholesky_factor, self.fit.residual)
        return float(whitened_residual @ whitened_residual)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the covariance's determinant."""
        return 2.0 * float(np.log(self.cholesky_factor.diagonal()).sum())

    def uncertainty(self, derivatives: Floats) -> Floats:
        """Return the standard uncertainties (p,) of parameters, by derivatives (2 n, p) of the data.

        Where recordings scatter they are widened by t(nu)/t(inf) of 95 %, nu the degrees of freedom that the estimates
        of the scatter leave.
        """
        from scipy.stats import t

        whitened = np.linalg.solve(self.cholesky_factor, derivatives)
        norms = np.maximum(np.linalg.norm(whitened, axis=0), _MIN_VALUE)
        design = whitened / norms
        covariance = scaled_inverse(design.T @ design)
        std = np.sqrt(np.maximum(covariance.diagonal(), _MIN_VALUE)) / norms
        freedom = self._freedom(design, covariance)
        return np.asarray(std * t.ppf(_UPPER_QUANTILE, freedom) / t.ppf(_UPPER_QUANTILE, np.inf))

    def _freedom(self, design: Floats, covariance: Floats) -> Floats:
        """Return the degrees of freedom (p,) of the variances of parameters; infinite without scatter.

        Satterthwaite's 2 V^2/var(V): V the variance of a parameter, var(V) by its derivatives with respect to the parts
        of the scatter and by their information I_ij = tr(P V_i P V_j)/2 in the restricted likelihood, P the projection
        off the whitened `design` (2 n, p), V_i the whitened part. `covariance` (p, p) is that of the parameters.
        """
        variance = np.maximum(covariance.diagonal(), _MIN_VALUE)
        parts = [self._whiten(part) for part in self.scatter_covariances if part.any()]
        if not parts:
            return np.full(len(variance), np.inf)
        # Each part counts in units of its own size, so that its share is 1.
        projection = np.eye(len(design)) - design @ covariance @ design.T
        projected_parts = [projection @ part @ projection for part in parts]
        information = np.array([[0.5 * np.sum(a * b) for b in projected_parts] for a in projected_parts])
        gradient = np.array([np.diag(covariance @ design.T @ part @ design @ covariance) for part in parts])
        variance_of_variance = np.sum(gradient * (scaled_inverse(information) @ gradient), axis=0)
        return np.asarray(np.maximum(2.0 * variance**2 / np.maximum(variance_of_variance, _MIN_VALUE), 1.0))

    def _whiten(self, part: Floats) -> Floats:
        """Return L^-1 C L^-T (2 n, 2 n) of a covariance C, L the Cholesky factor of the whole."""
        half_whitened = np.linalg.solve(self.cholesky_factor, part)
        return np.asarray(np.linalg.solve(self.cholesky_factor, half_whitened.T), np.float64)


def stack_moduli(lines: Sequence[ModulusLine], delay: float = 0.0) -> Floats:
    """Return G' of all lines, then G'' (2 n,) [Pa], if the force is late by `delay` [s]."""
    moduli = [line.shear_of_delay(delay) if delay else line.shear for line in lines]
    return stack_parts(np.array(moduli, np.complex128))


def stack_parts(values: Phasors) -> Floats:
    """Return the real parts of values (n,), then the imaginary parts (2 n,)."""
    return np.concatenate([values.real, values.imag])


def shared_covariance(lines: Sequence[ModulusLine], prediction: Phasors, without: Sequence[str] = ()) -> Floats:
    """Return the covariance (2 n, 2 n) [Pa^2] of `stack_moduli` by noise and by the errors that lines have in common.

    `without` are sources of error that are left out. A common factor moves every line by the same share of the
    material's true modulus. Scaled by the measured values it would make small ones more certain than large ones, and a
    joint value below all of them (Peelle's puzzle; D'Agostini 1994), so it is scaled by the prediction (n,) [Pa].
    """
    covariance = np.diag([line.noise**2 for line in lines] * 2)
    for source in dict.fromkeys(source for line in lines for source in line.shifts if source not in without):
        groups = [line.error_groups.get(source, "") for line in lines]
        shifts = [
            _predicted_shift(line, source, predicted)
            for line, predicted in zip(lines, prediction.tolist(), strict=True)
        ]
        # The lines of a group share one error; those of other groups are not correlated with it.
        for group in dict.fromkeys(groups):
            members = np.array(groups) == group
            group_shift = stack_parts(np.where(members, np.array(shifts, np.complex128), 0.0))
            covariance = covariance + np.outer(group_shift, group_shift)
    return np.asarray(covariance)


def _predicted_shift(line: ModulusLine, source: str, predicted: complex) -> complex:
    """Return the shift of the predicted G* [Pa] by one standard uncertainty of a source.

    All but the mass are factors of the modulus; inertia does not depend on it.
    """
    shift = complex(line.shifts.get(source, 0.0))
    return shift if source == "mass" else shift * predicted / line.shear


def fit_jointly(
    lines: Sequence[ModulusLine], fit_under: Callable[[Floats, int], WeightedFit], without: Sequence[str] = ()
) -> JointFit:
    """Return a fit to all lines under the covariance that its own prediction gives.

    `fit_under` is least squares under a covariance, of which it gets the Cholesky factor (2 n, 2 n) [Pa] and the number
    of fits before. `without` are sources of error that are left out. Common factors are scaled by the fit's prediction,
    and the scatter of the recordings is estimated from its residuals, until the prediction stays.
    """
    recordings = len({line.run for line in lines})
    measured = np.array([line.shear for line in lines], np.complex128)
    # The first fit takes each line by itself.
    cholesky_factor = np.diag(np.sqrt(shared_covariance(lines, measured, without).diagonal()))
    fit = fit_under(cholesky_factor, 0)
    scatter = RecordingScatter()
    scatter_covariances = tuple[Floats, ...]()
    for iteration in range(1, _MAX_ITERATIONS):
        shared = shared_covariance(lines, fit.prediction, without)
        if recordings > 1:
            unit_covariances = _unit_scatter_covariances(lines, fit.prediction)
            scatter = _estimate_scatter(fit, shared, unit_covariances, recordings)
            storage, loss = unit_covariances
            scatter_covariances = (scatter.storage**2 * storage, scatter.loss**2 * loss)
        cholesky_factor = np.asarray(np.linalg.cholesky(sum(scatter_covariances, shared)), np.float64)
        previous = fit.prediction
        fit = fit_under(cholesky_factor, iteration)
        if np.abs(fit.prediction - previous).max() < _CONVERGED_SHARE * np.abs(previous).max():
            break
    return JointFit(fit, cholesky_factor, scatter, scatter_covariances)


def _unit_scatter_covariances(lines: Sequence[ModulusLine], prediction: Phasors) -> tuple[Floats, Floats]:
    """Return the covariances (2 n, 2 n) [Pa^2] of recordings whose G', and whose G'', scatter by all of themselves."""
    runs = list(dict.fromkeys(line.run for line in lines))
    membership = np.array([[line.run == run for line in lines] for run in runs], float)  # (runs, n)
    zeros = np.zeros_like(membership)
    storage = np.hstack([membership * prediction.real, zeros])
    loss = np.hstack([zeros, membership * prediction.imag])
    return storage.T @ storage, loss.T @ loss


def _estimate_scatter(
    fit: WeightedFit, shared: Floats, unit_covariances: tuple[Floats, Floats], recordings: int
) -> RecordingScatter:
    """Return the scatter of the recordings by restricted maximum likelihood (Patterson and Thompson 1971).

    With the covariance V = shared + s'^2 C' + s''^2 C'' of residuals r and derivatives X, the shares s', s'' minimise
    log|V| + log|X^T V^-1 X| + r^T P r, P the inverse of V without the column space of X.
    """
    from scipy.optimize import minimize

    # In units of the standard deviations without scatter, so that the search is well scaled.
    scale = np.sqrt(shared.diagonal())
    scale_products = scale[:, None] * scale
    unit, storage, loss = (covariance / scale_products for covariance in (shared, *unit_covariances))
    residual = fit.residual / scale
    design = _column_space(fit.derivatives / scale[:, None])

    def deviance(log_shares: Floats) -> float:
        """Return -2 log(restricted likelihood), up to a constant, by the Cholesky factor of V and a QR of L^-1 X."""
        storage_variance, loss_variance = np.exp(2.0 * log_shares)
        cholesky_factor = np.linalg.cholesky(unit + storage_variance * storage + loss_variance * loss)
        whitened_residual = np.linalg.solve(cholesky_factor, residual)
        q, r = np.linalg.qr(np.linalg.solve(cholesky_factor, design))
        projected = whitened_residual - q @ (q.T @ whitened_residual)
        half_log_determinants = np.log(cholesky_factor.diagonal()).sum() + np.log(np.abs(r.diagonal())).sum()
        return float(projected @ projected + 2.0 * half_log_determinants)

    bounds = [(math.log(_MIN_SCATTER), math.log(_MAX_SCATTER))] * 2
    start = min(product(np.log(_SCATTER_GRID), repeat=2), key=lambda pair: deviance(np.array(pair)))
    best = minimize(deviance, start, bounds=bounds, method="Nelder-Mead", options=_SEARCH_TOLERANCES)
    shares = [share if share > _ZERO_SCATTER else 0.0 for share in np.exp(best.x).tolist()]
    return RecordingScatter(storage=shares[0], loss=shares[1], recordings=recordings)


def _column_space(derivatives: Floats) -> Floats:
    """Return an orthonormal basis (2 n, r) of the column space of derivatives (2 n, p)."""
    norms = np.linalg.norm(derivatives, axis=0)
    basis, singular_values, _ = np.linalg.svd(derivatives[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return np.asarray(basis[:, singular_values > _SINGULAR_SHARE * singular_values.max(initial=0.0)])
