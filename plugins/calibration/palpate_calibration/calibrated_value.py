"""A calibrated value: repeats, fits and declared terms become one standard uncertainty and a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.runs.calibration_file import CalibratedValue

_MAX_FREEDOM = 1e6  # degrees of freedom that count as infinitely many: Student's factor is then within 3e-6 of normal
_MIN_RELATIVE_STD, _MIN_STD = 1e-9, 1e-30  # of a value, and [SI]: a fit without noise divides by no zero
_ROOT_TOLERANCE = 1e-12  # of the largest possible variance
_QUANTILE = 0.975  # of the upper end of a 95 % interval


@dataclass(frozen=True)
class RepeatValue:
    """The value of one repeat, with the standard uncertainty by its own fit."""

    value: float
    std: float
    freedom: float = _MAX_FREEDOM  # degrees of freedom of the uncertainty


@dataclass(frozen=True)
class MeasuredValue:
    """A value with its uncertainty, by the sources of that [SI].

    The repeats are averaged with weights 1/(u^2 + t^2), u of each one's fit and t the scatter beyond the fits, by which
    the weighted squares add up to what is expected of them (Mandel and Paule 1970): where repeats scatter, one whose
    fit is the best is not the mean. fit = (sum 1/u^2)^(-1/2); type A is the scatter of the repeats over the square root
    of their number; combined^2 = 1/sum 1/(u^2 + t^2) + B^2 (JCGM 100:2008). The 95 % interval takes Student's factor
    for the degrees of freedom of Welch and Satterthwaite.
    """

    value: float
    unit: str
    repeats: tuple[float, ...]  # the value of each repeat
    fit: float  # standard uncertainty from the fits
    type_a: float | None  # standard uncertainty from the scatter of the repeats; None for a single one
    type_b: float  # declared standard uncertainty
    combined: float  # standard uncertainty of all of them
    factor: float  # half of the 95 % interval is so many times the combined standard uncertainty

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        half = self.factor * self.combined
        return self.value - half, self.value + half

    @classmethod
    def of(cls, repeats: Sequence[RepeatValue], unit: str, type_b: float = 0.0) -> MeasuredValue:
        """Return one value from repeats, at least one, each with its standard deviation and degrees of freedom.

        `type_b` is a standard uncertainty that all repeats share. The excess variance is what their scatter has beyond
        their own standard deviations.
        """
        values = np.array([repeat.value for repeat in repeats])
        # A record without noise has a fit without uncertainty; it must not divide by zero.
        std = np.maximum([repeat.std for repeat in repeats], _MIN_RELATIVE_STD * np.abs(values) + _MIN_STD)

        # Weighted mean (Mandel and Paule 1970).
        excess_variance = _excess_variance(values, std)
        weights = 1.0 / (std**2 + excess_variance)
        mean = float((weights * values).sum() / weights.sum())

        # Uncertainty of the fits, of the scatter of the repeats, and of what the scatter adds to the fits.
        fit = float((std**-2).sum() ** -0.5)
        freedom = sum(repeat.freedom for repeat in repeats)
        type_a = float(values.std(ddof=1) / math.sqrt(len(values))) if len(values) > 1 else None
        excess = max(0.0, float(1.0 / weights.sum()) - fit**2) if excess_variance else 0.0
        combined = math.sqrt(fit**2 + excess + type_b**2)

        # Student's factor for the degrees of freedom of Welch and Satterthwaite.
        spread = fit**4 / freedom + (excess**2 / (len(values) - 1) if excess else 0.0)
        factor = _student(combined**4 / spread)
        return cls(
            value=mean,
            unit=unit,
            repeats=tuple(values.tolist()),
            fit=fit,
            type_a=type_a,
            type_b=type_b,
            combined=combined,
            factor=factor,
        )


def _excess_variance(values: Floats, std: Floats) -> float:
    """Return the variance by which values (n,) scatter beyond their standard uncertainties; 0 where they do not."""
    from scipy.optimize import brentq

    def surplus(variance: float) -> float:
        weights = 1.0 / (std**2 + variance)
        mean = (weights * values).sum() / weights.sum()
        return float((weights * (values - mean) ** 2).sum()) - (len(values) - 1)

    if len(values) < 2 or surplus(0.0) <= 0:
        return 0.0
    max_variance = float(np.ptp(values) ** 2) * len(values)
    root: Any = brentq(surplus, 0.0, max_variance, xtol=_ROOT_TOLERANCE * max_variance)
    return float(root)


def calibrated_value(measured: MeasuredValue) -> CalibratedValue:
    """Return a measured value in a calibration file."""
    return CalibratedValue(
        value=measured.value,
        unit=measured.unit,
        std=measured.combined,
        interval=measured.interval,
        fit=measured.fit,
        type_a=measured.type_a,
        type_b=measured.type_b,
        repeats=measured.repeats,
    )


def scale_value(measured: MeasuredValue, factor: float, unit: str) -> MeasuredValue:
    """Return a value times an exact factor, in another unit."""
    type_a = measured.type_a * factor if measured.type_a is not None else None
    return MeasuredValue(
        measured.value * factor,
        unit,
        tuple(value * factor for value in measured.repeats),
        measured.fit * factor,
        type_a,
        measured.type_b * factor,
        measured.combined * factor,
        measured.factor,
    )


def add_values(first: MeasuredValue, second: MeasuredValue) -> MeasuredValue:
    """Return the sum of two independent measured values, whose uncertainties add as squares."""

    def root_sum(a: float, b: float) -> float:
        return float((a**2 + b**2) ** 0.5)

    repeats = tuple(a + b for a, b in zip(first.repeats, second.repeats, strict=False))
    return MeasuredValue(
        value=first.value + second.value,
        unit=first.unit,
        repeats=repeats,
        fit=root_sum(first.fit, second.fit),
        type_a=root_sum(first.type_a or 0.0, second.type_a or 0.0),
        type_b=root_sum(first.type_b, second.type_b),
        combined=root_sum(first.combined, second.combined),
        factor=max(first.factor, second.factor),  # of Student: the wider interval
    )


def _student(freedom: float) -> float:
    """Return Student's factor of a 95 % interval."""
    from scipy.stats import t

    return float(t.ppf(_QUANTILE, min(max(freedom, 1.0), _MAX_FREEDOM)))
