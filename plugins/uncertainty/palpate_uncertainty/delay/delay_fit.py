"""The fit of a law of the material with an unknown delay of the force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import standard_errors

from palpate_uncertainty.delay.response_laws import unit_forces
from palpate_uncertainty.delay.timed_record import LATEST, SURFACE_STEP, ResponseLaw, TimedRecord

# They apply to a delay that nobody has stated, in a motion of several lines and over 1000 samples.
_MAX_SURFACE_SHIFT = 1e-3  # [m] by which a law may move the surface (choice)
# Choices: the units in which the unknowns of a fit are of one size, and its end.
_SURFACE_UNIT = 1e-4  # [m], unit of the surface among the unknowns (choice)
_DELAY_UNIT = 1e-3  # [s], unit of the delay among the unknowns (choice)
_RELATIVE_STEP = 1e-4  # of the differences that are slopes: far above rounding, far below the curvature
_MAX_EVALUATIONS = 30  # of the residuals, where the fit gives up (choice)
# The sum of autocovariances.
_WINDOW_TIMES = 5.0  # of the residuals' own autocorrelation time, at which it is cut off (Sokal 1997; decision 0052)
_MAX_LAGS = 50  # of that sum: a choice of time
_SAMPLES_PER_LAG = 4  # of an autocovariance, at least (choice)


@dataclass(frozen=True)
class DelayFit:
    """A law with a delay, fitted to a record."""

    law: str
    delay: float  # [s]
    std: float  # [s]
    values: Floats  # (k,) of the Kelvin-Voigt model that gives the law's force without the delay
    values_std: Floats  # (k,)
    surface: float  # [m]
    bic: float


def fit_delay(record: TimedRecord, law: ResponseLaw, inflation: float) -> DelayFit:
    """Return a law fitted to a record with an unknown delay, its residuals correlated by `inflation`."""
    return _fit_law(record, law, None, inflation)


def fit_with_delay(record: TimedRecord, law: ResponseLaw, delay: float, inflation: float) -> DelayFit:
    """Return a law fitted to a record whose force is late by `delay` [s]."""
    return _fit_law(record, law, delay, inflation)


def _fit_law(record: TimedRecord, law: ResponseLaw, fixed_delay: float | None, inflation: float) -> DelayFit:
    """Return a law fitted to a record by variable projection: its columns' weights follow from the other unknowns.

    These are the surface, the delay unless it is fixed [s], and the law's nonlinear parameters. `inflation` is the
    variance of a mean of the residuals over that of white ones.
    """
    from scipy.optimize import least_squares

    is_free = fixed_delay is None
    scale = _unknowns(_SURFACE_UNIT, _DELAY_UNIT, [1.0] * len(law.start), is_free)
    lower = _unknowns(-_MAX_SURFACE_SHIFT, -LATEST, law.lower, is_free) / scale
    upper = _unknowns(_MAX_SURFACE_SHIFT, LATEST, law.upper, is_free) / scale
    start = np.clip(_unknowns(0.0, 0.0, law.start, is_free) / scale, lower, upper)

    def split(x: Floats) -> tuple[float, float, Floats]:
        """Return surface [m], delay [s] and nonlinear parameters of scaled unknowns."""
        unknowns = x * scale
        delay = float(unknowns[1]) if fixed_delay is None else fixed_delay
        return record.surface + float(unknowns[0]), delay, unknowns[1 + is_free :]

    optimum = least_squares(
        lambda x: record.solved(law, *split(x))[1], start, bounds=(lower, upper),
        diff_step=_RELATIVE_STEP, max_nfev=_MAX_EVALUATIONS,
    )  # fmt: skip
    return _fit_at(record, law, split(optimum.x), is_free, inflation)


def _unknowns(shift: float, delay: float, nonlinear: Sequence[float], is_free: bool) -> Floats:
    """Return the shift of the surface [m], the delay [s] if it is free, and the nonlinear parameters as one array."""
    return np.array([shift, *([delay] if is_free else []), *nonlinear])


def _fit_at(
    record: TimedRecord, law: ResponseLaw, optimum: tuple[float, float, Floats], is_free: bool, inflation: float
) -> DelayFit:
    """Return uncertainties and BIC of a fit at its surface [m], delay [s] and nonlinear parameters.

    Residuals whose mean varies `inflation` times as much as that of white ones count as n/inflation independent ones.
    """
    weights, residual = record.solved(law, *optimum)
    surface, delay, nonlinear = optimum
    # The columns of the slopes: weights, surface, delay, nonlinear parameters.
    _, slopes = record.slopes(law, surface, delay, nonlinear, weights)
    delay_place = len(weights) + 1  # behind the weights and the surface
    if not is_free:
        slopes = np.delete(slopes, delay_place, axis=1)
    n, p = len(residual), slopes.shape[1]
    square = float(residual @ residual)
    std = standard_errors(slopes) * np.sqrt(square / (n - p) * inflation)
    # Schwarz 1978, with the number of independent residuals.
    independent = n / inflation
    bic = independent * float(np.log(residual @ residual / n)) + p * float(np.log(independent))
    values = _kelvin_voigt_values(record, law, surface, nonlinear, weights)
    return DelayFit(
        law=law.name,
        delay=delay,
        std=float(std[delay_place]) if is_free else 0.0,
        values=values,
        values_std=std[:2],  # of the first two weights: under Kelvin and Voigt's law these are its values
        surface=surface,
        bic=bic,
    )


def _kelvin_voigt_values(
    record: TimedRecord, law: ResponseLaw, surface: float, nonlinear: Floats, weights: Floats
) -> Floats:
    """Return the parameters (2,) by which Kelvin and Voigt's law gives the force of another law without a delay.

    `weights` (c,) are those of the law's columns. Two steps of Gauss and Newton: the parameters at the law's surface,
    then parameters and surface.
    """
    if law.name == "kelvin-voigt":
        return weights
    target = (law.columns(record.course, surface, nonlinear) @ weights)[record.rows]
    units = unit_forces(record.course, surface)[record.rows]
    up, down = (unit_forces(record.course, surface + side)[record.rows] for side in (SURFACE_STEP, -SURFACE_STEP))
    values = np.linalg.lstsq(units, target, rcond=None)[0]
    # The slopes by both parameters, and by the surface, which the values do not include.
    columns = np.column_stack([units, (up - down) @ values / (2 * SURFACE_STEP)])
    lengths = np.linalg.norm(columns, axis=0)
    return np.asarray((np.linalg.lstsq(columns / lengths, target, rcond=None)[0] / lengths)[:2])


def variance_inflation(residual: Floats) -> float:
    """Return the variance of a mean of residuals over that of white ones, by a window that grows with it.

    A sum over all lags would scatter by a fifth for white residuals (Sokal 1997).
    """
    power, total = float(residual @ residual), 1.0
    for lag in range(1, min(_MAX_LAGS, len(residual) // _SAMPLES_PER_LAG) if power else 1):
        total += 2.0 * float(residual[lag:] @ residual[:-lag]) / power
        if lag >= _WINDOW_TIMES * total:
            break
    return max(total, 1.0)
