"""Hyperelastic laws fitted to curves of stress over strain: values with a budget."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.numerics.least_squares import least_squares, normal_by_differences
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_reference.hyperelastic.strain_energies import HyperelasticLaw
from palpate_reference.law_fit import MAX_CORRELATION, TableFit
from palpate_reference.material_table import MaterialTable

Loading = Literal["tension", "compression", "shear"]
_MIN_ALPHA = 1e-2  # magnitude of Ogden's exponent, a choice: the law has none at 0
_MAX_SCALED = 1e3  # bound of scaled parameters, a choice: a thousand times the secant modulus
_GAIN = 1e-14  # relative gain of a step, a choice near the rounding of a double
_IMPOSSIBLE = 1e9  # relative residual of a stress that is infinite
_MIN_DRIVE = 0.1  # of the largest strain, a choice: a secant at less is mostly the error of the zero
_MAX_RELATIVE_STD = 1.0  # from which on a value is not determined
_MIN_SQUARE = 1e-18  # of the relative scatter: keeps the logarithm finite


@dataclass(frozen=True)
class StressCurve:
    """One curve as the laws predict it."""

    name: str
    loading: Loading
    x: Floats  # (n,) stretch, of shear its amount
    stress: Floats  # (n,) nominal [Pa]

    def predicted(self, law: HyperelasticLaw, values: Sequence[float]) -> Floats:
        """Return the stress (n,) [Pa] if a law held at its values."""
        return (law.shear if self.loading == "shear" else law.uniaxial)(self.x, values)


def stress_curves(tables: Sequence[MaterialTable], loading: Loading | None) -> list[StressCurve]:
    """Return curves in the signs of mechanics: a compression has stretches below 1 and stresses below 0.

    Strain and stress are nominal: over the first length and area. Tables of a compression may have either sign. Raises
    ConfigurationError where nothing states how a specimen was loaded, and for a curve that does not rise.
    """
    curves = [_stress_curve(table, loading) for table in tables]
    for curve in curves:
        strain = curve.x if curve.loading == "shear" else curve.x - 1.0
        if not float(strain @ curve.stress) > 0.0:
            raise ConfigurationError(
                f"{curve.name}: the stress does not rise with the strain, in {curve.loading}: check signs and --loading"
            )
    return curves


def _stress_curve(table: MaterialTable, stated: Loading | None) -> StressCurve:
    """Return the curve of a table whose loading is stated, or shows in its name or its signs."""
    loading: Loading | None = "shear" if table.shear else stated
    if loading is None and float(np.nanmin(table.x)) < 0.0 < -float(np.nanmin(table.y)):
        loading = "compression"
    if loading is None:
        raise ConfigurationError(f"{table.name}: tension or compression? State --loading tension or compression")
    if loading == "shear":
        return StressCurve(table.name, loading, table.x, table.y[:, 0])
    if loading == "compression":
        stretch, stress = 1.0 - np.abs(table.x), -np.abs(table.y[:, 0])
    else:
        stretch, stress = 1.0 + table.x, table.y[:, 0]
    if float(stretch.min()) <= 0.0:
        raise ConfigurationError(
            f"{table.name}: a compression by {100 * (1 - float(stretch.min())):.4g} % is impossible"
        )
    return StressCurve(table.name, loading, stretch, stress)


@dataclass(frozen=True)
class _CurveProblem:
    """Least squares of a law over curves, each relative to its largest stress, with parameters in units of their size.

    The size of a modulus is the shear modulus by the usual secant of the curves, that of an exponent is 1.
    """

    law: HyperelasticLaw
    curves: Sequence[StressCurve]
    level: float  # [Pa]

    @property
    def sizes(self) -> Floats:
        """Sizes (p,) of the parameters [SI]."""
        return np.array([1.0 if unit == "1" else self.level for _, unit in self.law.parameters])

    def residual(self, x: Floats) -> Floats:
        """Return the residuals (n,) of all curves at scaled parameters (p,)."""
        values = (x * self.sizes).tolist()
        parts = []
        for curve in self.curves:
            max_stress = float(np.abs(curve.stress).max())
            parts.append((curve.predicted(self.law, values) - curve.stress) / max_stress)
        return np.asarray(np.nan_to_num(np.concatenate(parts), posinf=_IMPOSSIBLE), np.float64)


def fit_curves(law: HyperelasticLaw, curves: Sequence[StressCurve], scale: float) -> TableFit[HyperelasticLaw] | None:
    """Return a law by least squares of the stress, over the largest of each curve; None where the rows are too few.

    The scatter is found with the law, and counts more where residuals are correlated; a relative error of all stresses
    together, `scale` (area, load cell), moves moduli alone. All laws are linear in them.
    """
    count = len(law.parameters)
    row_count = sum(len(curve.x) for curve in curves)
    # Simple shear determines only the sum of C10 and C01.
    is_indistinct = law.name == "mooney-rivlin" and all(curve.loading == "shear" for curve in curves)
    if row_count <= count + 1 or is_indistinct:
        return None
    level = float(np.median(np.concatenate([_secant_moduli(curve) for curve in curves])))
    problem = _CurveProblem(law, curves, level)

    high = np.full(count, _MAX_SCALED)
    normal = normal_by_differences(problem.residual, high)
    minima = []
    for start in law.starts(level):
        x = np.array(start) / problem.sizes
        low = np.full(count, -_MAX_SCALED)
        if law.name == "ogden":
            # The exponent keeps the sign of its start.
            low[1], high[1] = (_MIN_ALPHA, _MAX_SCALED) if x[1] > 0 else (-_MAX_SCALED, -_MIN_ALPHA)
        minima.append(least_squares(normal, x, low, high.copy(), gain=_GAIN))
    finite = [minimum for minimum in minima if math.isfinite(minimum.cost)]
    if not finite:
        return None
    best = min(finite, key=lambda minimum: minimum.cost)
    return _table_fit(problem, best.x, normal(best.x), scale)


def _secant_moduli(curve: StressCurve) -> Floats:
    """Return the shear moduli (m,) [Pa] of the rows by a neo-Hookean solid, those near the origin left out.

    Its stress is G (l - l^-2) at a stretch l, and G s at a shear s.
    """
    drive = curve.x if curve.loading == "shear" else curve.x - curve.x**-2
    is_strained = np.abs(drive) > _MIN_DRIVE * float(np.abs(drive).max())
    return np.asarray(curve.stress[is_strained] / drive[is_strained], np.float64)


def _table_fit(problem: _CurveProblem, x: Floats, normal: Floats, scale: float) -> TableFit[HyperelasticLaw]:
    """Return the fit at scaled parameters x (p,), from the normal equations [r, J]^T [r, J] (1 + p, 1 + p) there.

    Covariance: s^2 (1 + rho)/(1 - rho) (J^T J)^-1 with the variance s^2 of the residuals and the autocorrelation rho of
    neighbours along a curve, and the error of the scale, which multiplies all moduli.
    """
    law, sizes = problem.law, problem.sizes
    residual = problem.residual(x)
    count, row_count = len(x), len(residual)
    parts = np.split(residual, np.cumsum([len(curve.x) for curve in problem.curves])[:-1])
    power = float(residual @ residual)
    correlation = _autocorrelation(parts, power)
    variance = power / (row_count - count) * (1.0 + correlation) / (1.0 - correlation)
    by_scatter = variance * scaled_inverse(normal[1:, 1:]) * np.outer(sizes, sizes)

    # The error of the scale moves all moduli alike, and no exponent.
    values = x * sizes
    is_exponent = [unit == "1" for _, unit in law.parameters]
    by_scale = scale * np.where(is_exponent, 0.0, values)
    covariance = by_scatter + np.outer(by_scale, by_scale)
    stds = np.sqrt(np.diag(covariance))
    budget = {"scatter": np.sqrt(np.diag(by_scatter))}
    if scale:
        budget["scale"] = np.abs(by_scale)
    is_loose = stds >= _MAX_RELATIVE_STD * np.abs(values)
    return TableFit(
        law,
        values,
        stds,
        covariance,
        budget,
        scatter=tuple(float(np.sqrt(np.mean(part**2))) for part in parts),
        chi2=0.0,  # no curve states uncertainties
        freedom=0,
        bic=row_count * math.log(max(power / row_count, _MIN_SQUARE)) + count * math.log(row_count),
        autocorrelation=correlation,
        undetermined=tuple(name for (name, _), loose in zip(law.parameters, is_loose, strict=True) if loose),
    )


def _autocorrelation(parts: Sequence[Floats], power: float) -> float:
    """Return the autocorrelation of neighbouring residuals of each curve, 0 at least, by their sum of squares."""
    product = float(sum(part[1:] @ part[:-1] for part in parts))
    return min(max(product / power, 0.0), MAX_CORRELATION) if power > 0 else 0.0
