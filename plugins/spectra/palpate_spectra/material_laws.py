"""A delay and a law of the material together: several frequencies distinguish them, one cannot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.consistency import covariance_of, stack_moduli
from palpate_spectra.spectral_lines import Phasors

_REFERENCE = 2 * math.pi  # [rad/s] at which a power law's modulus is given: 1 Hz
_MOST = 0.2  # [s] of delay, and less than half a period of the highest line


@dataclass(frozen=True)
class MaterialLaw:
    """How a material's shear modulus goes with frequency, in words of Young's modulus."""

    name: str
    formula: str
    parameters: tuple[tuple[str, str], ...]  # name and SI unit
    shear: Callable[[Floats, Floats, float], Phasors]  # of w (n,) [rad/s], parameters, Poisson's ratio
    starts: Callable[[Floats, Phasors, float], list[list[float]]]  # from w and G*
    upper: tuple[float, ...]


@dataclass(frozen=True)
class LawFit:
    """A law and a delay, fitted."""

    law: MaterialLaw
    delay: float  # [s] of the force
    delay_std: float  # [s]
    values: Floats
    stds: Floats
    chi2: float
    freedom: int
    bic: float

    @property
    def p(self) -> float:
        """Probability of so large a chi^2 if the law is valid."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, self.freedom)) if self.freedom > 0 else math.nan


def _per(nu: float) -> float:
    return 1.0 / (2.0 * (1.0 + nu))


def _solid(omega: Floats, p: Floats, nu: float) -> Phasors:
    return np.asarray(_per(nu) * p[0] + 1j * omega * p[1])


def _power(omega: Floats, p: Floats, nu: float) -> Phasors:
    return np.asarray(_per(nu) * p[0] * (1j * omega / _REFERENCE) ** p[1])


def _branch(omega: Floats, p: Floats, nu: float) -> Phasors:
    turned = 1j * omega * p[2]
    return np.asarray(_per(nu) * (p[0] + p[1] * turned / (1 + turned)))


def _level(g: Phasors, nu: float) -> float:
    return float(np.median(np.abs(g))) / _per(nu)


LAWS = (
    MaterialLaw(
        "Kelvin-Voigt", "G* = G + i w eta", (("elasticity", "Pa"), ("viscosity", "Pa*s")), _solid,
        lambda w, g, nu: [[_level(g, nu), max(float(np.median(g.imag / w)), 1e-3 * _level(g, nu) / float(w.max()))]],
        (math.inf, math.inf),
    ),
    MaterialLaw(
        "power law", "E* = E_1 (i f/1 Hz)^alpha", (("elasticity_1Hz", "Pa"), ("alpha", "1")), _power,
        lambda w, g, nu: [[_level(g, nu), alpha] for alpha in (0.02, 0.1, 0.3)],
        (math.inf, 1.0),
    ),
    MaterialLaw(
        "one branch", "E* = E + E_1 i w tau/(1 + i w tau)",
        (("elasticity", "Pa"), ("relaxing_elasticity", "Pa"), ("relaxation_time", "s")), _branch,
        lambda w, g, nu: [
            [_level(g, nu), 0.3 * _level(g, nu), 1 / at]
            for at in (float(w.min()), float(np.sqrt(w.min() * w.max())), float(w.max()))
        ],
        (math.inf, math.inf, math.inf),
    ),
)  # fmt: skip


def law_fits(lines: Sequence[ModulusLine]) -> list[LawFit]:
    """Every law with a free delay, by generalised least squares; those that have fewer numbers than the lines have.

    The covariance is that of noise and of all that is not exactly known but the timing, which is what is looked for.
    """
    half = np.asarray(np.linalg.cholesky(covariance_of(lines, without=["timing"])), np.float64)
    found = [_fit(law, lines, half) for law in LAWS if 2 * len(lines) > len(law.parameters) + 1]
    return [one for one in found if one is not None]


def _fit(law: MaterialLaw, lines: Sequence[ModulusLine], half: Floats) -> LawFit | None:
    from scipy.optimize import least_squares

    omega = 2 * np.pi * np.array([line.frequency for line in lines])
    nu, g = lines[0].poisson, np.array([line.shear for line in lines])
    count, longest = len(law.parameters), min(_MOST, math.pi / float(omega.max()))

    def left(x: Floats) -> Floats:
        shear = law.shear(omega, np.exp(x[:count]), nu)
        model = np.concatenate([shear.real, shear.imag])
        return np.asarray(np.linalg.solve(half, stack_moduli(lines, float(x[count]) * longest) - model), np.float64)

    best = None
    for start in law.starts(omega, g, nu):
        bounds = ([-80.0] * count + [-1.0], [min(math.log(u), 80.0) for u in law.upper] + [1.0])
        x = np.array([*np.log(start), 0.0])
        tried = least_squares(left, x, bounds=bounds, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12)
        if best is None or tried.cost < best.cost:
            best = tried
    if best is None or not np.isfinite(best.cost):
        return None
    spread = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)))
    values = np.exp(best.x[:count])
    chi2, freedom = 2.0 * float(best.cost), 2 * len(lines) - count - 1
    return LawFit(
        law, float(best.x[count]) * longest, float(spread[count]) * longest, values, values * spread[:count], chi2,
        freedom, chi2 + (count + 1) * math.log(2 * len(lines)),
    )  # fmt: skip


def supported_laws(fits: Sequence[LawFit], level: float = 1e-3) -> list[LawFit]:
    """Laws that the data do not refute, and whose BIC is within 6 of the best; the best first (Kass and Raftery)."""
    standing = sorted((fit for fit in fits if not fit.p < level), key=lambda fit: fit.bic)
    return [fit for fit in standing if fit.bic - standing[0].bic < 6.0]
