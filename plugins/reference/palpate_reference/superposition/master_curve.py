"""A master curve: sweeps at several temperatures, shifted onto one curve in logarithms of time and modulus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_reference.material_table import MaterialTable
from palpate_reference.superposition.temperature_sweeps import TemperatureSweep

_DECADE = math.log(10.0)
_REACH, _STEP = 10.0 * _DECADE, 0.05 * _DECADE  # how far a neighbour is looked for, and how closely
_OVERLAP = 3  # rows that neighbours must share at least
_ASIDE = 0.25  # rms of logarithms, above which neighbours do not meet
_FLOOR = 0.01  # rms that is as good as none
_KNOTS, _ROWS = 4.0, 4  # of the curve: knots of a decade at most, and rows between two at least
_DEGREE = 3
_ROUNDS, _STILL = 60, 1e-9
_WORST = 0.9  # autocorrelation of residuals, above which it says no more
_WORSE, _LEAST = 3.0, 0.01  # times the scatter of a sweep by itself, and rms, above which sweeps do not superpose


@dataclass(frozen=True)
class MasterCurve:
    """Sweeps and their shifts: f a_T, t/a_T and the modulus times b_T are those at the reference temperature."""

    sweeps: tuple[TemperatureSweep, ...]
    reference: int  # of the sweeps
    shifts: Floats  # (n, 2) ln a_T and ln b_T
    covariance: Floats  # (2 n, 2 n) of ln a_T of all, then of ln b_T
    vertical: bool  # whether b_T was determined; else 1
    scatter: Floats  # (n,) rms of what is left of the logarithms of each sweep
    own_scatter: Floats  # (n,) rms about a smooth curve of its own

    @property
    def temperatures(self) -> Floats:
        """(n,) [°C]."""
        return np.array([sweep.temperature for sweep in self.sweeps])

    @property
    def stds(self) -> Floats:
        """Standard uncertainties (n, 2) of the shifts."""
        return np.sqrt(np.diag(self.covariance)).reshape(2, -1).T

    @property
    def strange(self) -> list[int]:
        """Sweeps that leave more than they scatter by themselves: they do not superpose."""
        limit = np.maximum(_WORSE * self.own_scatter, _LEAST)
        return [int(k) for k in np.flatnonzero(self.scatter > limit)]

    def table(self) -> MaterialTable:
        """Return all readings as at the reference temperature, along frequency or time."""
        parts = [one for sweep, shift in zip(self.sweeps, self.shifts, strict=True) for one in _shifted(sweep, shift)]
        x = np.concatenate([part.x for part in parts])
        order = self._order(x)
        title = f"master curve at {self.temperatures[self.reference]:.1f} °C"
        sources = list(dict.fromkeys(part.source for part in parts))
        return replace(
            parts[0], source=sources[0] if len(sources) == 1 else f"{len(sources)} files", title=title, notes=(),
            x=x[order], y=np.concatenate([part.y for part in parts])[order],
            std=None if any(part.std is None for part in parts) else np.concatenate(
                [part.std for part in parts if part.std is not None])[order],
            temperature=np.concatenate([part.temperature for part in parts if part.temperature is not None])[order],
            strain=None,
        )  # fmt: skip

    def shift_root(self) -> Floats:
        """R (2, rows, m): errors of ln x and ln y of `table` are R z with z independent, of variance 1."""
        sizes, directions = np.linalg.eigh(self.covariance)
        real = sizes > 1e-12 * max(float(sizes[-1]), 1e-300)
        root = (directions[:, real] * np.sqrt(sizes[real])).reshape(2, len(self.sweeps), -1)
        along, up = _signs(self.sweeps[0].tables[0])
        of = np.concatenate([np.full(len(one.x), k) for k, sweep in enumerate(self.sweeps) for one in sweep.tables])
        x = np.concatenate([one.x for sweep, shift in zip(self.sweeps, self.shifts, strict=True)
                            for one in _shifted(sweep, shift)])  # fmt: skip
        return np.asarray((np.array([along, up])[:, None, None] * root[:, of])[:, self._order(x)], np.float64)

    @staticmethod
    def _order(x: Floats) -> NDArray[np.intp]:
        return np.argsort(x, kind="stable")


def _shifted(sweep: TemperatureSweep, shift: Floats) -> list[MaterialTable]:
    """Return the tables of a sweep as at the reference temperature."""
    along, up = _signs(sweep.tables[0])
    a, b = math.exp(along * shift[0]), math.exp(up * shift[1])
    return [
        replace(one, x=one.x * a, y=one.y * b, std=None if one.std is None else one.std * b) for one in sweep.tables
    ]


def _signs(table: MaterialTable) -> tuple[float, float]:
    """How ln a_T moves an axis and ln b_T a value: frequencies up, times down; compliances against moduli."""
    return (1.0 if table.kind == "oscillation" else -1.0), (-1.0 if table.kind == "creep" else 1.0)


@dataclass(frozen=True)
class _Rows:
    """All readings in logarithms, the axis such that ln a_T is added."""

    x: Floats  # (r,)
    y: Floats  # (r, c), such that ln b_T is added
    sweep: NDArray[np.intp]  # (r,) whose each is


def _rows_of(sweeps: Sequence[TemperatureSweep], columns: int) -> _Rows:
    parts = []
    for k, sweep in enumerate(sweeps):
        for table in sweep.tables:
            along, up = _signs(table)
            order = np.argsort(table.x)
            parts.append(
                (along * np.log(table.x[order]), up * np.log(table.y[order, :columns]), np.full(len(order), k))
            )
    return _Rows(*(np.concatenate(one) for one in zip(*parts, strict=True)))


def master_curve(
    sweeps: Sequence[TemperatureSweep], reference: int, vertical: bool, storage: bool = False
) -> MasterCurve:
    """Shifts (n, 2) that bring all sweeps onto one smooth curve, by least squares of logarithms.

    The curve is a cubic spline of each modulus, determined with the shifts, so that no law is presumed; the covariance
    is that of what is left, widened where it is correlated. With `storage` the loss modulus does not count. Raises
    ConfigurationError where neighbours do not meet. Source: Ferry 1980, chapter 11.
    """
    columns = 1 if storage else sweeps[0].tables[0].y.shape[1]
    rows = _rows_of(sweeps, columns)
    start = _first_shifts(rows, sweeps, reference)
    shifts = np.column_stack([start, np.zeros(len(sweeps))])
    free = [k for k in range(len(sweeps)) if k != reference]
    knots = _knots(rows.x + shifts[rows.sweep, 0])
    for turn in range(_ROUNDS):
        step, *_ = _step(rows, shifts, knots, free, vertical)
        shifts[free, : step.shape[1]] += step
        if float(np.abs(step).max()) < _STILL:
            break
        if turn < _ROUNDS // 2:  # later the knots stay, so that the sum has one minimum
            knots = _knots(rows.x + shifts[rows.sweep, 0])
    _, residual, information = _step(rows, shifts, knots, free, vertical)
    count = (2 if vertical else 1) * len(free)
    freedom = residual.size - information.shape[0]
    if freedom < _OVERLAP:
        raise ConfigurationError(f"{len(rows.x)} rows at {len(sweeps)} temperatures are too few for a master curve")
    scale = float((residual**2).sum()) / freedom * _inflation(residual, rows)
    inverse = scale * scaled_inverse(information)[:count, :count]
    covariance = np.zeros((2 * len(sweeps),) * 2)
    at = [*free, *((len(sweeps) + k for k in free) if vertical else ())]
    covariance[np.ix_(at, at)] = inverse
    scatter = np.array([np.sqrt(np.mean(residual[rows.sweep == k] ** 2)) for k in range(len(sweeps))])
    own = np.array([_own_scatter(sweep, columns) for sweep in sweeps])
    return MasterCurve(tuple(sweeps), reference, shifts, covariance, vertical, scatter, own)


def _first_shifts(rows: _Rows, sweeps: Sequence[TemperatureSweep], reference: int) -> Floats:
    """ln a_T (n,) by shifting each sweep onto its neighbour; raises ConfigurationError where they do not meet."""
    steps = [0.0]
    for k, (cold, warm) in enumerate(pairwise(sweeps)):
        one, other = ((rows.x[rows.sweep == i], rows.y[rows.sweep == i]) for i in (k, k + 1))
        shift, rms = _beside(*_ordered(*one), *_ordered(*other))
        if rms > _ASIDE:
            hint = " (or --by storage, if the loss is that of the instrument)" if rows.y.shape[1] > 1 else ""
            raise ConfigurationError(
                f"the sweeps at {cold.temperature:.4g} °C and {warm.temperature:.4g} °C do not meet, wherever one is "
                f"shifted along the other ({100 * rms:.2g} % apart at best): measure a temperature in between{hint}"
            )
        steps.append(shift)
    shifts = np.cumsum(steps)
    return np.asarray(shifts - shifts[reference], np.float64)


def _ordered(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    order = np.argsort(x, kind="stable")
    return x[order], y[order]


def _beside(x: Floats, y: Floats, x_next: Floats, y_next: Floats) -> tuple[float, float]:
    """Return the shift of the next sweep at which both agree best where they overlap, rather over many rows, and
    their rms."""
    best = (math.inf, 0.0, math.inf)
    for shift in np.arange(-_REACH, _REACH + _STEP, _STEP):
        there = x_next + shift
        inside = (there >= x[0]) & (there <= x[-1])
        count = int(inside.sum())
        if count < _OVERLAP:
            continue
        square = np.mean([np.mean((np.interp(there[inside], x, y[:, c]) - y_next[inside, c]) ** 2)
                          for c in range(y.shape[1])])  # fmt: skip
        best = min(best, ((square + _FLOOR**2) / count, float(shift), math.sqrt(square)))
    return best[1], best[2]


def _knots(z: Floats) -> Floats:
    """Knots of the curve over reduced logarithms (r,): where the rows are, a few of them between two."""
    count = max(min(int(_KNOTS * np.ptp(z) / _DECADE), len(z) // _ROWS), 1)
    inner = np.quantile(z, np.linspace(0.0, 1.0, count + 1))
    inner[0], inner[-1] = z.min() - _DECADE, z.max() + _DECADE
    return np.concatenate([[inner[0]] * _DEGREE, inner, [inner[-1]] * _DEGREE])


def _step(
    rows: _Rows, shifts: Floats, knots: Floats, free: Sequence[int], vertical: bool
) -> tuple[Floats, Floats, Floats]:
    """Changes (n - 1, 1 or 2) of the shifts, residuals (r, c), and the information of shifts and curves."""
    from scipy.interpolate import BSpline

    z = np.clip(rows.x + shifts[rows.sweep, 0], knots[0], knots[-1])
    values = rows.y + shifts[rows.sweep, 1][:, None]
    basis = BSpline.design_matrix(z, knots, _DEGREE).toarray()
    curves, *_ = np.linalg.lstsq(basis, values, rcond=1e-10)
    residual = values - basis @ curves
    slopes = BSpline(knots, curves, _DEGREE)(z, 1)
    of = np.column_stack([rows.sweep == k for k in free]).astype(np.float64)
    columns = range(values.shape[1])
    moved = np.vstack([np.hstack([-slopes[:, c : c + 1] * of, *([of] if vertical else [])]) for c in columns])
    design = np.hstack([moved, np.kron(np.eye(len(columns)), -basis)])
    change, *_ = np.linalg.lstsq(design, -residual.ravel(order="F"), rcond=1e-12)
    count = (2 if vertical else 1) * len(free)
    step = np.clip(change[:count], -_DECADE, _DECADE).reshape(2 if vertical else 1, -1).T
    return step, residual, design.T @ design


def _inflation(residual: Floats, rows: _Rows) -> float:
    """By how much the variance is larger for residuals that are correlated along a sweep."""
    power = float((residual**2).sum())
    same = rows.sweep[1:] == rows.sweep[:-1]
    product = float((residual[1:] * residual[:-1])[same].sum())
    correlation = min(max(product / power, 0.0), _WORST) if power > 0 else 0.0
    return (1.0 + correlation) / (1.0 - correlation)


def _own_scatter(sweep: TemperatureSweep, columns: int) -> float:
    """Return the rms of logarithms about cubics through two neighbours on either side: the noise of a smooth sweep.

    Source: Gasser, Sroka and Jennen-Steinmetz 1986, for cubics.
    """
    misses: list[Floats] = []
    for table in sweep.tables:
        x, first = np.unique(np.log(table.x), return_index=True)
        y = np.log(table.y[first, :columns])
        for i in range(2, len(x) - 2):
            beside = [i - 2, i - 1, i + 1, i + 2]
            weight = [math.prod((x[i] - x[k]) / (x[j] - x[k]) for k in beside if k != j) for j in beside]
            misses.append((y[i] - np.array(weight) @ y[beside]) / math.sqrt(1.0 + math.hypot(*weight) ** 2))
    return float(np.sqrt(np.mean(np.square(misses)))) if misses else math.nan
