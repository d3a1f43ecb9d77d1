"""Laws fitted to tables of one material together: values with a budget, and the choice among laws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_kit.numerics.least_squares import least_squares, normal_by_differences
from palpate_kit.numerics.material_laws import LinearLaw

from palpate_reference.law_fit import TableFit
from palpate_reference.material_table import MaterialTable

_FIRST = 0.03  # relative scatter of a table that states none, before it is known
_EXACT = 1e-7  # relative scatter of a table without noise, as its digits leave it
_ROUNDS = 3  # in which it is found
_LOG = 60.0  # bounds of logarithms
_LEAST = 1e-30  # of a prediction over the reading
_WORST = 0.9  # autocorrelation of residuals, above which it says no more
_NO_SLOPE = 1e-6  # sum of squares
_RANK = 1e-10  # of the largest eigenvalue of the information, below which it counts as none
_NOTHING = 1e-13  # of it, below which a direction counts for nothing
_HELD = 0.5  # information from what is known before: 1 for each such unknown
_SHARE = 1e-3  # of a direction
_UNDETERMINED = 1.0  # relative standard uncertainty


@dataclass(frozen=True)
class FitProblem:
    """Tables of one material, and what is not exactly known of them."""

    tables: tuple[MaterialTable, ...]
    poisson: float
    poisson_std: float
    scales: tuple[float, ...]  # relative standard uncertainty of all values of a table together; 0: exact
    shift_root: Floats | None = None  # R (2, n, m): errors of ln x and ln y of the first table are R z, z of variance 1

    @property
    def count(self) -> int:
        """How many readings there are."""
        return sum(table.y.size for table in self.tables)

    @property
    def shift_count(self) -> int:
        """How many unknowns the shifts of the tables add."""
        return 0 if self.shift_root is None else self.shift_root.shape[2]


def predictions(law: LinearLaw, table: MaterialTable, values: Sequence[float], poisson: float) -> Floats:
    """What a table would read (n, 1 or 2) if a law held."""
    per = 2.0 * (1.0 + poisson) if table.shear else 1.0
    if table.kind == "oscillation":
        found = law.complex_modulus(table.x, values, poisson) / per
        return np.column_stack([found.real, found.imag])
    if table.kind == "creep":
        return law.creep(table.x, values, poisson)[:, None] * per
    return law.relaxation(table.x, values, poisson)[:, None] / per


def fit_law(law: LinearLaw, problem: FitProblem) -> TableFit[LinearLaw] | None:
    """Return a law by least squares of relative errors; None where the readings are too few for it, or it fits nowhere.

    Readings that state an uncertainty are weighed by it; those of another table by its scatter, which is found with
    the law. All values of a table share an error of its scale, and all moduli of shear that of Poisson's ratio:
    unknowns with a prior each.
    """
    count = len(law.parameters)
    if problem.count <= count + 1:
        return None
    sigmas = [_FIRST] * len(problem.tables)
    best: Floats | None = None
    for _ in range(_ROUNDS):
        best = _minimum(law, problem, sigmas, best)
        if best is None:
            return None
        errors = _errors(law, problem, best)
        share = 1.0 - count / problem.count
        sigmas = [max(math.sqrt(float(np.mean(e**2)) / share), _EXACT) for e in errors]
        if all(table.std is not None for table in problem.tables):
            break
    assert best is not None
    return _outcome(law, problem, best, sigmas)


def _level_and_times(problem: FitProblem) -> tuple[float, Floats]:
    """Return the usual Young's modulus [Pa], and the times [s] of all readings."""
    levels, times = [], []
    for table in problem.tables:
        per = 2.0 * (1.0 + problem.poisson) if table.shear else 1.0
        values = np.hypot(*table.y.T) if table.kind == "oscillation" else table.y[:, 0]
        levels.append(np.median(per / values if table.kind == "creep" else per * values))
        times.append(1.0 / (2 * np.pi * table.x) if table.kind == "oscillation" else table.x)
    return float(np.exp(np.mean(np.log(levels)))), np.concatenate(times)


def _errors(law: LinearLaw, problem: FitProblem, x: Floats) -> list[Floats]:
    """Relative errors (n,) of each table: logarithms of what is predicted over what was read."""
    values = np.exp(x[: len(law.parameters)])
    priors = x[len(law.parameters) :]
    tables = len(problem.tables)
    found = []
    for k, table in enumerate(problem.tables):
        there, up = table, np.zeros(len(table.x))
        if k == 0 and problem.shift_root is not None:
            along, up = problem.shift_root @ priors[tables + 1 :]
            there = replace(table, x=table.x * np.exp(along))
        with np.errstate(over="ignore", invalid="ignore"):
            ratio = predictions(law, there, values.tolist(), problem.poisson) / table.y
        sign = -1.0 if table.kind == "creep" else 1.0
        shift = priors[k] * problem.scales[k] + (priors[tables] * _poisson_share(problem) if table.shear else 0.0)
        errors = np.log(np.maximum(np.nan_to_num(ratio), _LEAST)) + sign * shift - up[:, None]
        found.append(errors.ravel(order="F"))
    return found


def _poisson_share(problem: FitProblem) -> float:
    return problem.poisson_std / (1.0 + problem.poisson)


def _weighted(law: LinearLaw, problem: FitProblem, x: Floats, sigmas: Sequence[float]) -> list[Floats]:
    """Residuals of each table, then of what is known before."""
    parts = []
    for table, sigma, error in zip(problem.tables, sigmas, _errors(law, problem, x), strict=True):
        parts.append(error / (sigma if table.std is None else (table.std / table.y).ravel(order="F")))
    return [*parts, x[len(law.parameters) :]]


def _minimum(law: LinearLaw, problem: FitProblem, sigmas: Sequence[float], before: Floats | None) -> Floats | None:
    count, shifts = len(law.parameters), len(problem.tables) + 1 + problem.shift_count
    high = np.array([math.log(u) if u < math.inf else _LOG for u in law.uppers] + [10.0] * shifts)
    low = np.array([-_LOG] * count + [-10.0] * shifts)
    level, times = _level_and_times(problem)
    starts = [np.array([*np.log(start), *[0.0] * shifts]) for start in law.starts(level, times)]
    normal = normal_by_differences(lambda x: np.concatenate(_weighted(law, problem, x, sigmas)), high)
    found = [
        least_squares(normal, start, low, high, gain=1e-12) for start in ([before] if before is not None else starts)
    ]
    finite = [one for one in found if math.isfinite(one.cost)]
    return min(finite, key=lambda one: one.cost).x if finite else None


def _outcome(law: LinearLaw, problem: FitProblem, x: Floats, sigmas: Sequence[float]) -> TableFit[LinearLaw]:
    count = len(law.parameters)
    parts = _weighted(law, problem, x, sigmas)
    slopes = _slopes(law, problem, x, sigmas)
    covariance, loose_numbers = _covariance(np.vstack(slopes))
    correlation = _autocorrelation(parts[:-1])
    inflation = (1.0 + correlation) / (1.0 - correlation)
    shares: dict[str, Floats] = {}
    total: Floats = np.zeros(covariance.shape)
    names = [f"scatter of {table.name}" for table in problem.tables]
    for name, j in zip(names, slopes, strict=False):
        moved = j @ covariance  # first: a table without noise has slopes of 1e7, which cancel here
        part = inflation * moved.T @ moved
        shares[name], total = np.sqrt(np.maximum(np.diag(part)[:count], 0.0)), total + part
    priors = [(f"scale of {t.name}", s) for t, s in zip(problem.tables, problem.scales, strict=True)]
    for k, (name, size) in enumerate([*priors, ("poisson", problem.poisson_std)]):
        part = np.outer(covariance[:, count + k], covariance[:, count + k])
        total = total + part
        if size:
            shares[name] = np.sqrt(np.diag(part)[:count])
    if problem.shift_count:
        columns = covariance[:, count + len(priors) + 1 :]
        part = columns @ columns.T
        shares["time-temperature shift"], total = np.sqrt(np.diag(part)[:count]), total + part
    values = np.exp(x[:count])
    relative = np.sqrt(np.maximum(np.diag(total)[:count], 0.0))
    relative[np.sum([(j**2).sum(axis=0) for j in slopes], axis=0)[:count] < _NO_SLOPE] = math.nan  # next to nothing
    relative[loose_numbers[:count]] = math.nan
    stated = [part for part, table in zip(parts, problem.tables, strict=False) if table.std is not None]
    chi2 = float(sum(part @ part for part in stated))
    freedom = sum(len(part) for part in stated) - round(count * sum(len(p) for p in stated) / problem.count)
    errors = _errors(law, problem, x)
    loose = [e for e, table in zip(errors, problem.tables, strict=True) if table.std is None]
    bic = chi2 + float(parts[-1] @ parts[-1]) + count * math.log(problem.count)
    bic += sum(len(e) * math.log(max(float(np.mean(e**2)), 1e-18)) for e in loose)
    return TableFit(
        law, values, values * relative, total[:count, :count],
        {name: values * share for name, share in shares.items()},
        tuple(math.sqrt(float(np.mean(e**2))) for e in errors), chi2, freedom if stated else 0, bic, correlation,
        tuple(name for (name, _), one in zip(law.parameters, relative, strict=True) if not one < _UNDETERMINED),
    )  # fmt: skip


def _covariance(slopes: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Covariance (k, k) of the unknowns whose residuals have these slopes (n, k), and which of them are loose (k,).

    Those have a share in a direction along which the tables do not change, as E_1 and tau of a fast arm. What is known
    before holds a direction by 1, however little the tables scatter: it is not loose. The slopes are not squared,
    which would lose that next to a table without noise.
    """
    _, sizes, directions = np.linalg.svd(slopes, full_matrices=False)
    power = sizes**2
    kept = power > min(_NOTHING * power[0], _HELD)
    loose = (directions[power < min(_RANK * power[0], _HELD)] ** 2).sum(axis=0) > _SHARE
    return (directions[kept].T / power[kept]) @ directions[kept], np.asarray(loose)


def _slopes(law: LinearLaw, problem: FitProblem, x: Floats, sigmas: Sequence[float]) -> list[Floats]:
    """Derivatives (n, unknowns) of the residuals of each table, by central differences."""
    columns = []
    for step in np.diag(np.full(len(x), 1e-5)):
        above, below = (_weighted(law, problem, x + sign * step, sigmas) for sign in (1.0, -1.0))
        columns.append([(a - b) / 2e-5 for a, b in zip(above, below, strict=True)])
    return [np.column_stack(parts) for parts in zip(*columns, strict=True)]


def _autocorrelation(parts: Sequence[Floats]) -> float:
    """Of neighbouring residuals of all tables, 0 at least: what a law does not explain is not independent."""
    power = float(sum(part @ part for part in parts))
    product = float(sum(part[1:] @ part[:-1] for part in parts))
    return min(max(product / power, 0.0), _WORST) if power > 0 else 0.0
