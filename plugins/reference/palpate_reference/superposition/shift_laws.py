"""Laws of the shift over temperature, by generalised least squares: Williams, Landel and Ferry, and Arrhenius."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from palpate import Floats
from palpate_kit.numerics.least_squares import least_squares, normal_by_differences
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_reference.superposition.master_curve import MasterCurve
from palpate_reference.superposition.temperature_sweeps import ZERO

GAS = 8.314462618  # [J/(mol K)], CODATA 2018
_MAX_CONSTANT = 1e4  # bound of C1 and C2 [K], a choice: beyond, WLF is a straight line
_MIN_MARGIN = 1e-3  # [K] by which the pole of WLF stays below the coldest sweep
_START_C1, _START_C2 = (5.0, 15.0), (20.0, 100.0)  # about the usual 17.4 and 51.6 K (Williams, Landel and Ferry 1955)
_GAIN = 1e-14  # relative gain of a step, a choice near the rounding of a double
_RIDGE, _MIN_RIDGE = 1e-12, 1e-24  # of the trace, and at least: keeps a covariance without noise invertible


@dataclass(frozen=True)
class ShiftLaw:
    """A law of ln a_T at the values that describe the shifts best."""

    name: str
    formula: str
    values: dict[str, tuple[float, float, str]]  # value, standard uncertainty and unit
    chi2: float
    freedom: int
    deviation: float  # rms of log10 a_T
    predicted: Callable[[Floats], Floats]  # ln a_T (n,) at temperatures (n,) [°C]

    @property
    def p(self) -> float:
        """Probability of so large a chi^2 if the law holds."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, self.freedom))


def shift_laws(curve: MasterCurve) -> list[ShiftLaw]:
    """Return both laws, of those for which there are shifts enough, the better first.

    Uncertainties are those of the shifts, and widened by sqrt(chi^2/freedom) where a law misses them by more. Sources:
    Williams, Landel and Ferry 1955; Ferry 1980, chapter 11.
    """
    laws = [_wlf(curve), _arrhenius(curve)]
    return sorted((law for law in laws if law is not None), key=lambda law: law.chi2 / law.freedom)


def _free_shifts(curve: MasterCurve) -> tuple[Floats, Floats, Floats]:
    """Return temperatures (m,) [°C], ln a_T (m,) and a matrix (m, m) that whitens them, without the reference."""
    is_free = np.arange(len(curve.sweeps)) != curve.reference
    covariance = curve.covariance[: len(is_free), : len(is_free)][np.ix_(is_free, is_free)]
    ridge = _RIDGE * float(np.trace(covariance)) + _MIN_RIDGE
    whitening = np.linalg.inv(np.linalg.cholesky(covariance + ridge * np.eye(len(covariance))))
    return curve.temperatures[is_free], curve.shifts[is_free, 0], np.asarray(whitening, np.float64)


def _arrhenius(curve: MasterCurve) -> ShiftLaw | None:
    """Return the law of an activation energy E_a, which is linear; None for less than two shifts."""
    temperature, shift, whitening = _free_shifts(curve)
    reference = float(curve.temperatures[curve.reference])
    freedom = len(shift) - 1
    if freedom < 1:
        return None

    def per_energy(t: Floats) -> Floats:
        """Return ln a_T/E_a (n,) [mol/J] at temperatures (n,) [°C]."""
        return (1.0 / (t + ZERO) - 1.0 / (reference + ZERO)) / GAS

    design = whitening @ per_energy(temperature)
    energy = float(design @ (whitening @ shift) / (design @ design))

    def predicted(t: Floats) -> Floats:
        return energy * per_energy(t)

    chi2, deviation = _distance(predicted(temperature) - shift, whitening)
    std = _widened(1.0 / math.sqrt(float(design @ design)), chi2, freedom)
    values = {"activation_energy": (energy, std, "J/mol")}
    formula = "ln a_T = E_a/R (1/T - 1/T_0)"
    return ShiftLaw("Arrhenius", formula, values, chi2, freedom, deviation, predicted)


def _wlf(curve: MasterCurve) -> ShiftLaw | None:
    """Return the law of Williams, Landel and Ferry, its pole below all sweeps; None for less than three shifts."""
    temperature, shift, whitening = _free_shifts(curve)
    reference = float(curve.temperatures[curve.reference])
    freedom = len(shift) - 2
    if freedom < 1:
        return None
    min_c2 = max(reference - float(curve.temperatures.min()), 0.0) + _MIN_MARGIN

    low, high = np.array([0.0, min_c2]), np.array([_MAX_CONSTANT, _MAX_CONSTANT])
    normal = normal_by_differences(lambda x: whitening @ (_wlf_shift(temperature - reference, x) - shift), high)
    starts = [np.array([c1, min_c2 + c2]) for c1 in _START_C1 for c2 in _START_C2]
    minima = [least_squares(normal, start, low, high, gain=_GAIN) for start in starts]
    best = min(minima, key=lambda minimum: minimum.cost)
    covariance = scaled_inverse(normal(best.x)[1:, 1:])

    def predicted(t: Floats) -> Floats:
        return _wlf_shift(t - reference, best.x)

    chi2, deviation = _distance(predicted(temperature) - shift, whitening)
    c1_std, c2_std = (_widened(math.sqrt(max(variance, 0.0)), chi2, freedom) for variance in np.diag(covariance))
    values = {"C1": (float(best.x[0]), c1_std, "1"), "C2": (float(best.x[1]), c2_std, "K")}
    return ShiftLaw("WLF", "log10 a_T = -C1 (T - T_0)/(C2 + T - T_0)", values, chi2, freedom, deviation, predicted)


def _wlf_shift(difference: Floats, constants: Floats) -> Floats:
    """Return ln a_T (n,) at temperatures less that of the reference (n,) [K], by C1 and C2 [K]."""
    c1, c2 = constants
    return np.asarray(-math.log(10.0) * c1 * difference / (c2 + difference), np.float64)


def _distance(error: Floats, whitening: Floats) -> tuple[float, float]:
    """Return chi^2 of errors of ln a_T (m,), and the rms of log10 a_T."""
    return float(((whitening @ error) ** 2).sum()), float(np.sqrt(np.mean(error**2))) / math.log(10.0)


def _widened(std: float, chi2: float, freedom: int) -> float:
    """Return a standard uncertainty, widened by sqrt(chi^2/freedom) where the law misses the shifts by more."""
    return std * math.sqrt(max(chi2 / freedom, 1.0))
