"""Laws fitted to tables of one material together: values with a budget, and the choice among laws."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.least_squares import least_squares, normal_by_differences
from palpate_kit.numerics.material_laws import LinearLaw

from palpate_reference.fit_problem import FitProblem, log_errors, scaled_residuals, shear_factor
from palpate_reference.law_fit import MAX_CORRELATION, TableFit

# Choices, where nothing else is said.
_FIRST_SCATTER = 0.03  # relative, of a table that states none, before it is known
_MIN_SCATTER = 1e-7  # relative, of a table without noise, as its digits leave it
_SCATTER_ROUNDS = 3  # in which the scatter is found
_MAX_LOG_VALUE = 60.0  # bounds of logarithms of values in SI: 1e26 either way
_MAX_PRIOR = 10.0  # standard uncertainties, bounds of the unknowns with a prior
_GAIN = 1e-12  # relative gain of a step, below which the minimum is found
_SLOPE_STEP = 1e-5  # of scaled unknowns, between curvature and rounding
_MIN_SLOPE_SQUARES = 1e-6  # below, the tables do not depend on an unknown
_MIN_INFORMATION = 1e-10  # of the largest eigenvalue of the information, below which a direction is not determined
_MIN_EIGENVALUE = 1e-13  # of the largest, below which a direction is rounding
_PRIOR_INFORMATION = 0.5  # half of the 1 by which a prior holds its unknown: such a direction is determined
_MIN_SHARE = 1e-3  # of an unknown in a direction that is not determined
_MAX_RELATIVE_STD = 1.0  # from which on a value is not determined
_MIN_SQUARE = 1e-18  # of the relative scatter: keeps the logarithm finite


def fit_law(law: LinearLaw, problem: FitProblem) -> TableFit[LinearLaw] | None:
    """Return a law by least squares of relative errors; None where the readings are too few for it, or it fits nowhere.

    Readings that state an uncertainty are weighed by it; those of another table by its scatter, which is found with
    the law. All values of a table share an error of its scale, and all moduli of shear that of Poisson's ratio:
    unknowns with a prior each.
    """
    count = len(law.parameters)
    if problem.count <= count + 1:
        return None
    sigmas = [_FIRST_SCATTER] * len(problem.tables)
    unknowns: Floats | None = None
    for _ in range(_SCATTER_ROUNDS):
        unknowns = _least_squares(law, problem, sigmas, unknowns)
        if unknowns is None:
            return None
        # Scatter of each table about the law, for the degrees of freedom that the law leaves.
        errors = log_errors(law, problem, unknowns)
        free_share = 1.0 - count / problem.count
        sigmas = [max(math.sqrt(float(np.mean(error**2)) / free_share), _MIN_SCATTER) for error in errors]
        if all(table.std is not None for table in problem.tables):
            break
    assert unknowns is not None
    return _table_fit(law, problem, unknowns, sigmas)


def _least_squares(
    law: LinearLaw, problem: FitProblem, sigmas: Sequence[float], before: Floats | None
) -> Floats | None:
    """Return the unknowns of the least squares: from those `before`, or the best of the law's starts; None for none.

    Unknowns are the logarithms of the law's values, then those with a prior (see `fit_problem`), which begin at 0.
    """
    prior_count = problem.prior_count
    log_uppers = [math.log(upper) if upper < math.inf else _MAX_LOG_VALUE for upper in law.uppers]
    high = np.array(log_uppers + [_MAX_PRIOR] * prior_count)
    low = np.array([-_MAX_LOG_VALUE] * len(law.parameters) + [-_MAX_PRIOR] * prior_count)
    if before is not None:
        starts = [before]
    else:
        level, times = _level_and_times(problem)
        starts = [np.array([*np.log(start), *[0.0] * prior_count]) for start in law.starts(level, times)]
    normal = normal_by_differences(lambda x: np.concatenate(scaled_residuals(law, problem, x, sigmas)), high)
    minima = [least_squares(normal, start, low, high, gain=_GAIN) for start in starts]
    finite = [minimum for minimum in minima if math.isfinite(minimum.cost)]
    return min(finite, key=lambda minimum: minimum.cost).x if finite else None


def _level_and_times(problem: FitProblem) -> tuple[float, Floats]:
    """Return the usual Young's modulus [Pa], and the times [s] of all readings."""
    levels, times = [], []
    for table in problem.tables:
        factor = shear_factor(table, problem.poisson)
        values = np.hypot(*table.y.T) if table.kind == "oscillation" else table.y[:, 0]
        levels.append(np.median(factor / values if table.kind == "creep" else factor * values))
        times.append(1.0 / (2 * np.pi * table.x) if table.kind == "oscillation" else table.x)
    return float(np.exp(np.mean(np.log(levels)))), np.concatenate(times)


def _table_fit(law: LinearLaw, problem: FitProblem, x: Floats, sigmas: Sequence[float]) -> TableFit[LinearLaw]:
    """Return the fit at unknowns of the least squares, with its budget and its evidence."""
    count = len(law.parameters)
    *residuals, prior_residuals = scaled_residuals(law, problem, x, sigmas)
    slopes = _slopes(law, problem, x, sigmas)
    correlation = _autocorrelation(residuals)
    budget, covariance, is_loose = _budget(problem, slopes, count, correlation)

    # A standard uncertainty of a logarithm is a relative one; NaN where the tables do not determine the value.
    values = np.exp(x[:count])
    relative_stds = np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
    slope_squares = np.sum([(slope**2).sum(axis=0) for slope in slopes], axis=0)[:count]
    relative_stds[slope_squares < _MIN_SLOPE_SQUARES] = math.nan
    relative_stds[is_loose[:count]] = math.nan
    is_determined = relative_stds < _MAX_RELATIVE_STD

    chi2, freedom = _chi2(problem, residuals, count)
    errors = log_errors(law, problem, x)
    return TableFit(
        law,
        values,
        stds=values * relative_stds,
        covariance=covariance[:count, :count],
        budget={name: values * share for name, share in budget.items()},
        scatter=tuple(math.sqrt(float(np.mean(error**2))) for error in errors),
        chi2=chi2,
        freedom=freedom,
        bic=_bic(problem, errors, chi2 + float(prior_residuals @ prior_residuals), count),
        autocorrelation=correlation,
        undetermined=tuple(
            name for (name, _), determined in zip(law.parameters, is_determined, strict=True) if not determined
        ),
    )


def _budget(
    problem: FitProblem, slopes: Sequence[Floats], count: int, correlation: float
) -> tuple[dict[str, Floats], Floats, NDArray[np.bool_]]:
    """Return the budget, the covariance (p, p) and a mask (p,) of unknowns that the tables do not determine.

    The budget has the share of each source in the standard uncertainty (count,) of the first unknowns: the scatter of
    every table, J C inflated by its autocorrelation, and every prior, one column of the covariance C each.
    """
    inverse, is_loose = _covariance(np.vstack(slopes))
    inflation = (1.0 + correlation) / (1.0 - correlation)
    budget: dict[str, Floats] = {}
    total: Floats = np.zeros(inverse.shape)
    for table, slope in zip(problem.tables, slopes, strict=False):
        moved = slope @ inverse  # first: a table without noise has slopes of 1e7, which cancel here
        part = inflation * moved.T @ moved
        budget[f"scatter of {table.name}"] = np.sqrt(np.maximum(np.diag(part)[:count], 0.0))
        total = total + part

    # Scale of each table, then Poisson's ratio; those that are exact have no row.
    scales = [(f"scale of {table.name}", scale) for table, scale in zip(problem.tables, problem.scales, strict=True)]
    for k, (name, std) in enumerate([*scales, ("poisson", problem.poisson_std)]):
        part = np.outer(inverse[:, count + k], inverse[:, count + k])
        total = total + part
        if std:
            budget[name] = np.sqrt(np.diag(part)[:count])
    if problem.shift_count:
        columns = inverse[:, count + len(scales) + 1 :]
        part = columns @ columns.T
        budget["time-temperature shift"] = np.sqrt(np.diag(part)[:count])
        total = total + part
    return budget, total, is_loose


def _chi2(problem: FitProblem, residuals: Sequence[Floats], count: int) -> tuple[float, int]:
    """Return chi^2 and the degrees of freedom of the tables that state uncertainties; 0 degrees without such tables.

    These tables bear the unknowns in proportion to their readings.
    """
    stated = [residual for residual, table in zip(residuals, problem.tables, strict=True) if table.std is not None]
    chi2 = float(sum(residual @ residual for residual in stated))
    stated_count = sum(len(residual) for residual in stated)
    freedom = stated_count - round(count * stated_count / problem.count)
    return chi2, freedom if stated else 0


def _bic(problem: FitProblem, errors: Sequence[Floats], squares: float, count: int) -> float:
    """Return the BIC: squares of stated tables and of the priors, n log(s^2) of every other table, k log(N)."""
    bic = squares + count * math.log(problem.count)
    unstated_errors = [error for error, table in zip(errors, problem.tables, strict=True) if table.std is None]
    bic += sum(len(error) * math.log(max(float(np.mean(error**2)), _MIN_SQUARE)) for error in unstated_errors)
    return bic


def _covariance(slopes: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the covariance (p, p) of unknowns whose residuals have these slopes (n, p), and a mask of loose ones (p,).

    Loose unknowns have a share in a direction along which the tables do not change, as E_1 and tau of a fast arm. A
    prior holds a direction by 1, however little the tables scatter: it is not loose. The slopes are not squared,
    which would lose that next to a table without noise.
    """
    _, sizes, directions = np.linalg.svd(slopes, full_matrices=False)
    information = sizes**2
    is_kept = information > min(_MIN_EIGENVALUE * information[0], _PRIOR_INFORMATION)
    is_weak = information < min(_MIN_INFORMATION * information[0], _PRIOR_INFORMATION)
    is_loose = (directions[is_weak] ** 2).sum(axis=0) > _MIN_SHARE
    inverse = (directions[is_kept].T / information[is_kept]) @ directions[is_kept]
    return inverse, np.asarray(is_loose)


def _slopes(law: LinearLaw, problem: FitProblem, x: Floats, sigmas: Sequence[float]) -> list[Floats]:
    """Return the derivatives (n, p) of the residuals of each table, last of the priors, by central differences."""
    columns = []
    for step in np.diag(np.full(len(x), _SLOPE_STEP)):
        above, below = (scaled_residuals(law, problem, x + sign * step, sigmas) for sign in (1.0, -1.0))
        columns.append([(a - b) / (2.0 * _SLOPE_STEP) for a, b in zip(above, below, strict=True)])
    return [np.column_stack(parts) for parts in zip(*columns, strict=True)]


def _autocorrelation(residuals: Sequence[Floats]) -> float:
    """Return the autocorrelation of neighbouring residuals of all tables, 0 at least.

    Residuals that a law does not explain are not independent.
    """
    power = float(sum(residual @ residual for residual in residuals))
    product = float(sum(residual[1:] @ residual[:-1] for residual in residuals))
    return min(max(product / power, 0.0), MAX_CORRELATION) if power > 0 else 0.0
