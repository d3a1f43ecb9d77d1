"""Tables of one material with everything that is not exactly known of them, and their errors by a law.

Unknowns of a fit (p,): the logarithms of the law's values, then unknowns with a prior of mean 0 and variance 1: one for
the scale of each table, one for Poisson's ratio, and those of the shifts of a master curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from palpate import Floats
from palpate_kit.numerics.material_laws import LinearLaw

from palpate_reference.material_table import MaterialTable

_MIN_RATIO = 1e-30  # of a prediction over the reading: keeps its logarithm finite


@dataclass(frozen=True)
class FitProblem:
    """Tables of one material, and the uncertainties that their readings have in common."""

    tables: tuple[MaterialTable, ...]
    poisson: float
    poisson_std: float
    scales: tuple[float, ...]  # relative standard uncertainty of all values of a table together; 0: exact
    shift_root: Floats | None = None  # R (2, n, m): errors of ln x and ln y of the first table are R z, z of variance 1

    @property
    def count(self) -> int:
        """Number of readings."""
        return sum(table.y.size for table in self.tables)

    @property
    def shift_count(self) -> int:
        """Number of unknowns that the shifts of a master curve add."""
        return 0 if self.shift_root is None else self.shift_root.shape[2]

    @property
    def prior_count(self) -> int:
        """Number of unknowns with a prior."""
        return len(self.tables) + 1 + self.shift_count


def shear_factor(table: MaterialTable, poisson: float) -> float:
    """Return Young's modulus over the modulus of a table: E = 2 (1 + nu) G for moduli of shear."""
    return 2.0 * (1.0 + poisson) if table.shear else 1.0


def predictions(law: LinearLaw, table: MaterialTable, values: Sequence[float], poisson: float) -> Floats:
    """Return the readings (n, 1 or 2) of a table if a law held at its values."""
    factor = shear_factor(table, poisson)
    if table.kind == "oscillation":
        modulus = law.complex_modulus(table.x, values, poisson) / factor
        return np.column_stack([modulus.real, modulus.imag])
    if table.kind == "creep":
        return law.creep(table.x, values, poisson)[:, None] * factor
    return law.relaxation(table.x, values, poisson)[:, None] / factor


def log_errors(law: LinearLaw, problem: FitProblem, x: Floats) -> list[Floats]:
    """Return the relative errors of each table (n,): logarithms of predictions over readings."""
    count, table_count = len(law.parameters), len(problem.tables)
    values, priors = np.exp(x[:count]), x[count:]
    poisson_share = problem.poisson_std / (1.0 + problem.poisson)
    errors = []
    for k, table in enumerate(problem.tables):
        # The first table may be a master curve, whose shifts move the axis, and the values by log_rise (n,).
        shifted_table, log_rise = table, np.zeros(len(table.x))
        if k == 0 and problem.shift_root is not None:
            log_shift, log_rise = problem.shift_root @ priors[table_count + 1 :]
            shifted_table = replace(table, x=table.x * np.exp(log_shift))
        with np.errstate(over="ignore", invalid="ignore"):
            ratio = predictions(law, shifted_table, values.tolist(), problem.poisson) / table.y
        # Scale and Poisson's ratio; a compliance falls by as much as a modulus rises.
        sign = -1.0 if table.kind == "creep" else 1.0
        common = priors[k] * problem.scales[k] + (priors[table_count] * poisson_share if table.shear else 0.0)
        table_errors = np.log(np.maximum(np.nan_to_num(ratio), _MIN_RATIO)) + sign * common - log_rise[:, None]
        errors.append(table_errors.ravel(order="F"))
    return errors


def scaled_residuals(law: LinearLaw, problem: FitProblem, x: Floats, sigmas: Sequence[float]) -> list[Floats]:
    """Return the residuals of each table (n,) in standard uncertainties, last those of the priors.

    A table that states no uncertainty has one of `sigmas`, relative.
    """
    residuals = []
    for table, sigma, error in zip(problem.tables, sigmas, log_errors(law, problem, x), strict=True):
        residuals.append(error / (sigma if table.std is None else (table.std / table.y).ravel(order="F")))
    return [*residuals, x[len(law.parameters) :]]
