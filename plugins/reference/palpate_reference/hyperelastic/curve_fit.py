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
from palpate_reference.law_fit import TableFit
from palpate_reference.material_table import MaterialTable

Loading = Literal["tension", "compression", "shear"]
_LEAST_ALPHA = 1e-2  # Ogden's exponent is not nought
_FAR = 1e3  # bound of scaled parameters
_WORST = 0.9  # autocorrelation of residuals, above which it says no more
_UNDETERMINED = 1.0  # relative standard uncertainty


@dataclass(frozen=True)
class StressCurve:
    """One curve as the laws predict it."""

    name: str
    loading: Loading
    x: Floats  # (n,) stretch, of shear its amount
    stress: Floats  # (n,) nominal [Pa]

    def predicted(self, law: HyperelasticLaw, values: Sequence[float]) -> Floats:
        """What it would read (n,) [Pa] if a law held."""
        return (law.shear if self.loading == "shear" else law.uniaxial)(self.x, values)


def stress_curves(tables: Sequence[MaterialTable], loading: Loading | None) -> list[StressCurve]:
    """Curves in the signs of mechanics; raises ConfigurationError where it is not said how a specimen was loaded.

    Strain and stress are nominal: over the first length and area. Tables of a compression may have either sign.
    """
    curves = []
    for table in tables:
        kind: Loading | None = "shear" if table.shear else loading
        if kind is None and float(np.nanmin(table.x)) < 0.0 < -float(np.nanmin(table.y)):
            kind = "compression"
        if kind is None:
            raise ConfigurationError(f"{table.name}: tension or compression? State --loading tension or compression")
        if kind == "shear":
            curves.append(StressCurve(table.name, kind, table.x, table.y[:, 0]))
            continue
        sign = -1.0 if kind == "compression" else 1.0
        stretch = 1.0 + sign * np.abs(table.x) if kind == "compression" else 1.0 + table.x
        stress = sign * np.abs(table.y[:, 0]) if kind == "compression" else table.y[:, 0]
        if float(stretch.min()) <= 0.0:
            raise ConfigurationError(
                f"{table.name}: a compression by {100 * (1 - float(stretch.min())):.4g} % is impossible"
            )
        curves.append(StressCurve(table.name, kind, stretch, stress))
    for curve in curves:
        strained = curve.x if curve.loading == "shear" else curve.x - 1.0
        if not float(strained @ curve.stress) > 0.0:
            raise ConfigurationError(
                f"{curve.name}: the stress does not rise with the strain, in {curve.loading}: check signs and --loading"
            )
    return curves


def fit_curves(law: HyperelasticLaw, curves: Sequence[StressCurve], scale: float) -> TableFit[HyperelasticLaw] | None:
    """Return a law by least squares of the stress, over the largest of each curve; None where the rows are too few.

    The scatter is found with the law, and counts more where residuals are correlated; a relative error of all stresses
    together, `scale` (area, load cell), moves moduli alone. All laws are linear in them.
    """
    count, rows = len(law.parameters), sum(len(curve.x) for curve in curves)
    if rows <= count + 1 or (law.name == "mooney-rivlin" and all(curve.loading == "shear" for curve in curves)):
        return None  # simple shear knows the sum of C10 and C01 alone
    tops = [float(np.abs(curve.stress).max()) for curve in curves]
    level = float(np.median(np.concatenate([_secant(curve) for curve in curves])))
    units = np.array([1.0 if unit == "1" else level for _, unit in law.parameters])

    def residual(x: Floats) -> Floats:
        parts = [curve.predicted(law, (x * units).tolist()) - curve.stress for curve in curves]
        scaled = np.concatenate([part / top for part, top in zip(parts, tops, strict=True)])
        return np.asarray(np.nan_to_num(scaled, posinf=1e9), np.float64)

    high = np.full(count, _FAR)
    normal = normal_by_differences(residual, high)
    minima = []
    for start in law.starts(level):
        x = np.array(start) / units
        low = np.full(count, -_FAR)
        if law.name == "ogden":
            low[1], high[1] = (_LEAST_ALPHA, _FAR) if x[1] > 0 else (-_FAR, -_LEAST_ALPHA)
        minima.append(least_squares(normal, x, low, high.copy(), gain=1e-14))
    best = min((one for one in minima if math.isfinite(one.cost)), key=lambda one: one.cost, default=None)
    if best is None:
        return None
    return _outcome(law, curves, best.x, units, normal(best.x), residual(best.x), tops, scale)


def _secant(curve: StressCurve) -> Floats:
    """Shear moduli (n,) [Pa] of the rows by a neo-Hookean solid."""
    drive = curve.x if curve.loading == "shear" else curve.x - curve.x**-2
    strained = np.abs(drive) > 0.1 * float(np.abs(drive).max())
    return np.asarray(curve.stress[strained] / drive[strained], np.float64)


def _outcome(
    law: HyperelasticLaw, curves: Sequence[StressCurve], x: Floats, units: Floats, square: Floats, residual: Floats,
    tops: Sequence[float], scale: float,
) -> TableFit[HyperelasticLaw]:  # fmt: skip
    count, rows = len(x), len(residual)
    parts = np.split(residual, np.cumsum([len(curve.x) for curve in curves])[:-1])
    power = float(residual @ residual)
    product = float(sum(part[1:] @ part[:-1] for part in parts))
    correlation = min(max(product / power, 0.0), _WORST) if power > 0 else 0.0
    variance = power / (rows - count) * (1.0 + correlation) / (1.0 - correlation)
    scattered = variance * scaled_inverse(square[1:, 1:]) * np.outer(units, units)
    values = x * units
    moved = scale * np.where([unit == "1" for _, unit in law.parameters], 0.0, values)
    covariance = scattered + np.outer(moved, moved)
    stds = np.sqrt(np.diag(covariance))
    budget = {"scatter": np.sqrt(np.diag(scattered))}
    if scale:
        budget["scale"] = np.abs(moved)
    loose = stds >= _UNDETERMINED * np.abs(values)
    return TableFit(
        law, values, stds, covariance, budget, tuple(float(np.sqrt(np.mean(part**2))) for part in parts), 0.0, 0,
        rows * math.log(max(power / rows, 1e-18)) + count * math.log(rows), correlation,
        tuple(name for (name, _), one in zip(law.parameters, loose, strict=True) if one),
    )  # fmt: skip
