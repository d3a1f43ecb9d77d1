"""A delay and a law of the material together: several frequencies distinguish them, one cannot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.numerics.material_laws import LAWS as ALL_LAWS, LinearLaw

from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.joint_covariance import Attempt, RecordingScatter, fit_jointly, stack, stack_moduli

LAWS = tuple(law for law in ALL_LAWS if law.name in ("kelvin-voigt", "power-law", "standard-linear-solid"))
_SEARCHED = 2  # covariances under which every start is tried
_PROBE, _STEP = 1e-6, 1e-4  # for derivatives by the delay [s], and by a parameter as a share of its first guess
_APART = 1.05  # ratio of frequencies
_MOST = 0.2  # [s] of delay, and less than half a period of the highest line


@dataclass(frozen=True)
class LawFit:
    """A law and a delay that describe lines best."""

    law: LinearLaw
    delay: float  # [s] of the force, beyond what is declared
    delay_std: float  # [s]; NaN where it is the declared one
    values: Floats
    stds: Floats
    chi2: float
    freedom: int
    bic: float  # with the determinant of the covariance, which differs from law to law
    scatter: RecordingScatter

    @property
    def p(self) -> float:
        """Probability of so large a chi^2 if the law is valid."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, self.freedom)) if self.freedom > 0 else math.nan


def several_frequencies(lines: Sequence[ModulusLine]) -> bool:
    """Return True if the largest frequency of the lines is so many times the smallest that delay and loss are
    distinct."""
    return max(line.frequency for line in lines) > _APART * min(line.frequency for line in lines)


def law_fits(lines: Sequence[ModulusLine]) -> list[LawFit]:
    """Return every law by generalised least squares; those that have fewer numbers than the lines have.

    At several frequencies with a free delay: the covariance is that of noise, of all that is not exactly known but the
    timing, which is what is looked for, and of the scatter between recordings (`fit_jointly`). At one frequency the
    delay is the declared one, and its uncertainty counts; a law has two numbers there at most.
    """
    free = several_frequencies(lines)
    counts = [len(law.parameters) + 1 if free else len(law.parameters) for law in LAWS]
    most = 2 * len(lines) - 1 if free else min(2 * len(lines) - 1, 2)
    found = [fit_law(law, lines) for law, count in zip(LAWS, counts, strict=True) if count <= most]
    return [one for one in found if one is not None]


def fit_law(law: LinearLaw, lines: Sequence[ModulusLine]) -> LawFit | None:
    """One law, and a delay where there are several frequencies; None where it is not finite anywhere."""
    omega, moduli = 2 * np.pi * np.array([line.frequency for line in lines]), np.array([line.shear for line in lines])
    nu, count, free = lines[0].poisson, len(law.parameters), several_frequencies(lines)
    longest = min(_MOST, math.pi / float(omega.max())) if free else 0.0
    level = 2.0 * (1.0 + nu) * float(np.median(np.abs(moduli)))
    starts = [np.array([*np.log(start), *([0.0] if free else [])]) for start in law.starts(level, 1.0 / omega)]

    def error(x: Floats) -> Floats:
        return stack_moduli(lines, float(x[-1]) * longest) - stack(law.shear_modulus(omega, np.exp(x[:count]), nu))

    best: Any = None

    def attempt(half: Floats, rounds: int) -> Attempt:
        nonlocal best
        white = np.linalg.inv(half)
        tried = [*([] if best is None else [best.x]), *(starts if rounds < _SEARCHED else [])]
        best = min((_least(law, lambda x: white @ error(x), x) for x in tried), key=lambda one: float(one.cost))
        return Attempt(error(best.x), -half @ best.jac, law.shear_modulus(omega, np.exp(best.x[:count]), nu))

    try:
        joint = fit_jointly(lines, attempt, without=["timing"] if free else [])
    except (ValueError, np.linalg.LinAlgError):  # the law is not finite anywhere
        return None
    values, late = np.exp(best.x[:count]), float(best.x[-1]) * longest
    scale = np.max([np.exp(start[:count]) for start in starts], axis=0)  # for a value may be next to nothing
    stds = joint.uncertainty(_slopes(law, lines, values, scale, late if free else None))
    numbers = count + int(free) + joint.scatter.parts
    return LawFit(
        law, late, float(stds[count]) if free else math.nan, values, stds[:count], joint.chi2,
        2 * len(lines) - numbers, joint.chi2 + joint.log_determinant + numbers * math.log(2 * len(lines)),
        joint.scatter,
    )  # fmt: skip


def _slopes(law: LinearLaw, lines: Sequence[ModulusLine], values: Floats, scale: Floats, delay: float | None) -> Floats:
    """Derivatives (2 n, p) of the moduli by the parameters, and by the delay unless that is not free."""
    omega, nu = 2 * np.pi * np.array([line.frequency for line in lines]), lines[0].poisson
    here = stack(law.shear_modulus(omega, values, nu))
    found = [
        (stack(law.shear_modulus(omega, values + step, nu)) - here) / step.sum() for step in np.diag(_STEP * scale)
    ]
    if delay is not None:
        found.append((stack_moduli(lines, delay - _PROBE) - stack_moduli(lines, delay + _PROBE)) / (2 * _PROBE))
    return np.column_stack(found)


def _least(law: LinearLaw, left: Callable[[Floats], Floats], start: Floats) -> Any:
    """Least squares over logarithms of the parameters and, if it is free, the delay as a share of the longest."""
    from scipy.optimize import least_squares

    free = len(start) - len(law.parameters)
    bounds = (
        [-80.0] * len(law.parameters) + [-1.0] * free,
        [min(math.log(u), 80.0) for u in law.uppers] + [1.0] * free,
    )
    return least_squares(left, start, bounds=bounds, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12)


def supported_laws(fits: Sequence[LawFit], level: float = 1e-3) -> list[LawFit]:
    """Laws that the data do not refute, and whose BIC is within 6 of the best; the best first (Kass and Raftery)."""
    standing = sorted((fit for fit in fits if not fit.p < level), key=lambda fit: fit.bic)
    return [fit for fit in standing if fit.bic - standing[0].bic < 6.0]
