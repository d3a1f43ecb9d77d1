"""A master curve: sweeps at several temperatures, shifted onto one curve in logarithms of time and modulus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_reference.law_fit import MAX_CORRELATION
from palpate_reference.material_table import MaterialTable
from palpate_reference.superposition.common_curve import best_shifts
from palpate_reference.superposition.neighbour_shifts import MIN_OVERLAP, ReducedRows, first_shifts, reduced_rows
from palpate_reference.superposition.temperature_sweeps import TemperatureSweep, shift_signs

# Sweeps that do not superpose (0274): residuals over the scatter of the sweep by itself, and rms.
_MAX_RATIO, _MIN_RMS = 3.0, 0.01
_MIN_VARIANCE_SHARE = 1e-12  # of the largest eigenvalue of a covariance, a choice: a smaller one is rounding
_MIN_VARIANCE = 1e-300  # guards against a division by 0


@dataclass(frozen=True)
class MasterCurve:
    """Sweeps and their shifts: f a_T, t/a_T and the modulus times b_T are those at the reference temperature."""

    sweeps: tuple[TemperatureSweep, ...]
    reference: int  # index of the sweep that is not shifted
    shifts: Floats  # (n, 2) ln a_T and ln b_T
    covariance: Floats  # (2 n, 2 n) of ln a_T of all, then of ln b_T
    vertical: bool  # True if b_T was determined; else it is 1
    scatter: Floats  # (n,) rms of the residuals of the logarithms of each sweep
    own_scatter: Floats  # (n,) rms about a smooth curve of its own

    @property
    def temperatures(self) -> Floats:
        """Temperatures (n,) [°C] of the sweeps."""
        return np.array([sweep.temperature for sweep in self.sweeps])

    @property
    def stds(self) -> Floats:
        """Standard uncertainties (n, 2) of the shifts."""
        return np.sqrt(np.diag(self.covariance)).reshape(2, -1).T

    @property
    def strange(self) -> list[int]:
        """Indexes of the sweeps that do not superpose: they miss the curve by more than they scatter by themselves."""
        limit = np.maximum(_MAX_RATIO * self.own_scatter, _MIN_RMS)
        return [int(k) for k in np.flatnonzero(self.scatter > limit)]

    def table(self) -> MaterialTable:
        """Return all readings as at the reference temperature, along frequency or time."""
        parts = self._shifted_tables()
        x = np.concatenate([part.x for part in parts])
        order = self._order(x)
        stds = [part.std for part in parts if part.std is not None]
        temperatures = [part.temperature for part in parts if part.temperature is not None]
        sources = list(dict.fromkeys(part.source for part in parts))
        return replace(
            parts[0],
            source=sources[0] if len(sources) == 1 else f"{len(sources)} files",
            title=f"master curve at {self.temperatures[self.reference]:.1f} °C",
            notes=(),
            x=x[order],
            y=np.concatenate([part.y for part in parts])[order],
            std=np.concatenate(stds)[order] if len(stds) == len(parts) else None,
            temperature=np.concatenate(temperatures)[order],
            strain=None,
        )

    def shift_root(self) -> Floats:
        """Return R (2, rows, m): errors of ln x and ln y of `table` are R z with z independent, of variance 1.

        R is a root of the covariance of the shifts, by its eigenvalues, with the rows of each sweep alike.
        """
        variances, directions = np.linalg.eigh(self.covariance)
        is_kept = variances > _MIN_VARIANCE_SHARE * max(float(variances[-1]), _MIN_VARIANCE)
        sweep_root = (directions[:, is_kept] * np.sqrt(variances[is_kept])).reshape(2, len(self.sweeps), -1)
        signs = np.array(shift_signs(self.sweeps[0].tables[0]))
        tables = [(k, table) for k, sweep in enumerate(self.sweeps) for table in sweep.tables]
        sweep_index = np.concatenate([np.full(len(table.x), k) for k, table in tables])
        x = np.concatenate([table.x for table in self._shifted_tables()])
        return np.asarray((signs[:, None, None] * sweep_root[:, sweep_index])[:, self._order(x)], np.float64)

    def _shifted_tables(self) -> list[MaterialTable]:
        shifted = [_shifted(sweep, shift) for sweep, shift in zip(self.sweeps, self.shifts, strict=True)]
        return [table for tables in shifted for table in tables]

    @staticmethod
    def _order(x: Floats) -> NDArray[np.intp]:
        return np.argsort(x, kind="stable")


def _shifted(sweep: TemperatureSweep, shift: Floats) -> list[MaterialTable]:
    """Return the tables of a sweep as at the reference temperature, by its ln a_T and ln b_T (2,)."""
    x_sign, y_sign = shift_signs(sweep.tables[0])
    a, b = math.exp(x_sign * shift[0]), math.exp(y_sign * shift[1])
    return [
        replace(table, x=table.x * a, y=table.y * b, std=None if table.std is None else table.std * b)
        for table in sweep.tables
    ]


def master_curve(
    sweeps: Sequence[TemperatureSweep], reference: int, vertical: bool, storage: bool = False
) -> MasterCurve:
    """Return the shifts that bring all sweeps onto one smooth curve, by least squares of logarithms.

    The curve is a cubic spline of each modulus, determined with the shifts, so that no law is presumed; the covariance
    is that of the residuals, widened where they are correlated. With `storage` the loss modulus does not count. Raises
    ConfigurationError where neighbours do not meet, or for too few rows. Source: Ferry 1980, chapter 11.
    """
    columns = 1 if storage else sweeps[0].tables[0].y.shape[1]
    rows = reduced_rows(sweeps, columns)
    start = np.column_stack([first_shifts(rows, sweeps, reference), np.zeros(len(sweeps))])
    free = [k for k in range(len(sweeps)) if k != reference]
    shifts, linearisation = best_shifts(rows, start, free, vertical)

    # Covariance of the shifts that are free, from the residuals about the curve.
    residual, information = linearisation.residual, linearisation.information
    freedom = residual.size - information.shape[0]
    if freedom < MIN_OVERLAP:
        raise ConfigurationError(f"{len(rows.x)} rows at {len(sweeps)} temperatures are too few for a master curve")
    variance = float((residual**2).sum()) / freedom * _inflation(residual, rows)
    indexes = [*free, *(len(sweeps) + k for k in free)] if vertical else free
    covariance = np.zeros((2 * len(sweeps), 2 * len(sweeps)))
    inverse = scaled_inverse(information)[: len(indexes), : len(indexes)]
    covariance[np.ix_(indexes, indexes)] = variance * inverse

    scatter = np.array([np.sqrt(np.mean(residual[rows.sweep == k] ** 2)) for k in range(len(sweeps))])
    own_scatter = np.array([_own_scatter(sweep, columns) for sweep in sweeps])
    return MasterCurve(tuple(sweeps), reference, shifts, covariance, vertical, scatter, own_scatter)


def _inflation(residual: Floats, rows: ReducedRows) -> float:
    """Return the factor of the variance for residuals (r, c) that are correlated along a sweep: (1 + rho)/(1 - rho)."""
    power = float((residual**2).sum())
    is_same_sweep = rows.sweep[1:] == rows.sweep[:-1]
    product = float((residual[1:] * residual[:-1])[is_same_sweep].sum())
    correlation = min(max(product / power, 0.0), MAX_CORRELATION) if power > 0 else 0.0
    return (1.0 + correlation) / (1.0 - correlation)


def _own_scatter(sweep: TemperatureSweep, columns: int) -> float:
    """Return the rms of logarithms about cubics through two neighbours on either side: the noise of a smooth sweep.

    By Lagrange's weights w of the neighbours: a difference has the variance (1 + sum w^2) of a reading. NaN for sweeps
    of less than five rows. Source: Gasser, Sroka and Jennen-Steinmetz 1986, for cubics.
    """
    differences: list[Floats] = []
    for table in sweep.tables:
        x, first_rows = np.unique(np.log(table.x), return_index=True)
        y = np.log(table.y[first_rows, :columns])
        for i in range(2, len(x) - 2):
            neighbours = [i - 2, i - 1, i + 1, i + 2]
            weights = [_lagrange_weight(x, i, j, neighbours) for j in neighbours]
            difference = y[i] - np.array(weights) @ y[neighbours]
            differences.append(difference / math.sqrt(1.0 + math.hypot(*weights) ** 2))
    return float(np.sqrt(np.mean(np.square(differences)))) if differences else math.nan


def _lagrange_weight(x: Floats, i: int, j: int, neighbours: Sequence[int]) -> float:
    """Return the weight at x_i of the value at x_j, in the polynomial through the neighbours."""
    return math.prod(float((x[i] - x[k]) / (x[j] - x[k])) for k in neighbours if k != j)
