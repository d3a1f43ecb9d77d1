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
_FAR = 1e4  # bound of C1 and C2, beyond which WLF is a straight line


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
    """Both laws, of those for which there are shifts enough, the better first.

    Uncertainties are those of the shifts, and widened by sqrt(chi^2/freedom) where a law misses them by more. Sources:
    Williams, Landel and Ferry 1955; Ferry 1980, chapter 11.
    """
    laws = [_wlf(curve), _arrhenius(curve)]
    return sorted((law for law in laws if law is not None), key=lambda law: law.chi2 / law.freedom)


def _free(curve: MasterCurve) -> tuple[Floats, Floats, Floats]:
    """Temperatures (n - 1,), ln a_T (n - 1,) and a matrix that whitens them, without the reference."""
    free = np.arange(len(curve.sweeps)) != curve.reference
    covariance = curve.covariance[: len(free), : len(free)][np.ix_(free, free)]
    floor = 1e-12 * float(np.trace(covariance)) + 1e-24
    whitening = np.linalg.inv(np.linalg.cholesky(covariance + floor * np.eye(len(covariance))))
    return curve.temperatures[free], curve.shifts[free, 0], np.asarray(whitening, np.float64)


def _arrhenius(curve: MasterCurve) -> ShiftLaw | None:
    temperature, shift, whitening = _free(curve)
    at = float(curve.temperatures[curve.reference])

    def slope(t: Floats) -> Floats:
        return (1.0 / (t + ZERO) - 1.0 / (at + ZERO)) / GAS

    freedom = len(shift) - 1
    if freedom < 1:
        return None
    design = whitening @ slope(temperature)
    energy = float(design @ (whitening @ shift) / (design @ design))

    def predicted(t: Floats) -> Floats:
        return energy * slope(t)

    chi2, deviation = _distance(predicted(temperature) - shift, whitening)
    std = _widened(1.0 / math.sqrt(float(design @ design)), chi2, freedom)
    values = {"activation_energy": (energy, std, "J/mol")}
    formula = "ln a_T = E_a/R (1/T - 1/T_0)"
    return ShiftLaw("Arrhenius", formula, values, chi2, freedom, deviation, predicted)


def _wlf(curve: MasterCurve) -> ShiftLaw | None:
    temperature, shift, whitening = _free(curve)
    at = float(curve.temperatures[curve.reference])
    freedom = len(shift) - 2
    if freedom < 1:
        return None
    least = max(at - float(curve.temperatures.min()), 0.0) + 1e-3

    def log_shift(t: Floats, x: Floats) -> Floats:
        return np.asarray(-math.log(10.0) * x[0] * (t - at) / (x[1] + (t - at)), np.float64)

    low, high = np.array([0.0, least]), np.array([_FAR, _FAR])
    normal = normal_by_differences(lambda x: whitening @ (log_shift(temperature, x) - shift), high)
    best = min((least_squares(normal, np.array([c1, least + more]), low, high, gain=1e-14)
                for c1 in (5.0, 15.0) for more in (20.0, 100.0)), key=lambda one: one.cost)  # fmt: skip
    covariance = scaled_inverse(normal(best.x)[1:, 1:])

    def predicted(t: Floats) -> Floats:
        return log_shift(t, best.x)

    chi2, deviation = _distance(predicted(temperature) - shift, whitening)
    stds = [_widened(math.sqrt(max(one, 0.0)), chi2, freedom) for one in np.diag(covariance)]
    values = {"C1": (float(best.x[0]), stds[0], "1"), "C2": (float(best.x[1]), stds[1], "K")}
    return ShiftLaw("WLF", "log10 a_T = -C1 (T - T_0)/(C2 + T - T_0)", values, chi2, freedom, deviation, predicted)


def _distance(miss: Floats, whitening: Floats) -> tuple[float, float]:
    return float(((whitening @ miss) ** 2).sum()), float(np.sqrt(np.mean(miss**2))) / math.log(10.0)


def _widened(std: float, chi2: float, freedom: int) -> float:
    return std * math.sqrt(max(chi2 / freedom, 1.0))
