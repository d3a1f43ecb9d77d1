"""A delay and a law of the material together: several frequencies distinguish them, one cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.numerics.material_laws import LAWS as ALL_LAWS, LinearLaw

from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.joint_covariance import RecordingScatter, WeightedFit, fit_jointly, stack_moduli, stack_parts
from palpate_spectra.spectral_lines import Phasors

LAWS = tuple(law for law in ALL_LAWS if law.name in ("kelvin-voigt", "power-law", "standard-linear-solid"))
# Choices.
_SEARCH_ITERATIONS = 2  # of the covariance, in which every start is tried; later ones begin at the best fit
_DELAY_STEP = 1e-6  # [s] for derivatives by the delay
_RELATIVE_STEP = 1e-4  # of a parameter's first guess, for derivatives by differences
_MIN_FREQUENCY_RATIO = 1.05  # of the largest to the smallest frequency, from which on delay and loss are distinct
_MAX_DELAY = 0.2  # [s] and less than half a period of the highest line, beyond which a phase is ambiguous
_MAX_LOG_PARAMETER = 80.0  # exp(80) = 6e34 [SI] is beyond any material, and finite
_TOLERANCE = 1e-12  # of least squares: cost, step and gradient, relative
_REJECTION_LEVEL = 1e-3  # of a law's p
_MAX_BIC_DIFFERENCE = 6.0  # to the best law; more is strong evidence against a law (Kass and Raftery 1995)


@dataclass(frozen=True)
class LawFit:
    """The fit of a law and a delay to lines."""

    law: LinearLaw
    delay: float  # [s] of the force, beyond what is declared
    delay_std: float  # [s]; NaN where it is the declared one
    values: Floats  # (p,) [SI] of the law's parameters
    stds: Floats  # (p,)
    chi2: float
    freedom: int  # degrees of freedom of chi2
    bic: float  # with the determinant of the covariance, which differs from law to law
    scatter: RecordingScatter

    @property
    def p(self) -> float:
        """Probability of so large a chi^2 if the law is valid; NaN without degrees of freedom."""
        from scipy.stats import chi2

        return float(chi2.sf(self.chi2, self.freedom)) if self.freedom > 0 else math.nan


def several_frequencies(lines: Sequence[ModulusLine]) -> bool:
    """Return True if the frequencies of the lines differ enough that a delay and a loss are distinct."""
    frequencies = [line.frequency for line in lines]
    return max(frequencies) > _MIN_FREQUENCY_RATIO * min(frequencies)


def law_fits(lines: Sequence[ModulusLine]) -> list[LawFit]:
    """Return the fits of all laws by generalised least squares that have fewer parameters than the lines have numbers.

    At several frequencies with a free delay: the covariance is that of noise, of all errors that lines have in common
    but the timing, which is fitted, and of the scatter between recordings (`fit_jointly`). At one frequency the
    delay is the declared one, with its uncertainty; the two numbers G' and G'' determine two parameters at most.
    """
    has_free_delay = several_frequencies(lines)
    max_parameters = 2 * len(lines) - 1
    if not has_free_delay:
        max_parameters = min(max_parameters, 2)
    laws = [law for law in LAWS if len(law.parameters) + int(has_free_delay) <= max_parameters]
    fits = [fit_law(law, lines) for law in laws]
    return [fit for fit in fits if fit is not None]


def fit_law(law: LinearLaw, lines: Sequence[ModulusLine]) -> LawFit | None:
    """Return the fit of a law, and of a delay at several frequencies; None where the law is not finite anywhere."""
    problem = _LawProblem(law, lines, has_free_delay=several_frequencies(lines))
    starts = problem.starts()
    best: Any = None  # the result of least squares under the last covariance

    def fit_under(cholesky_factor: Floats, iteration: int) -> WeightedFit:
        """Return the best fit under a covariance, from the best before and, at first, from every start."""
        nonlocal best
        candidates = [] if best is None else [best.x]
        if iteration < _SEARCH_ITERATIONS:
            candidates += starts
        whitening = np.asarray(np.linalg.inv(cholesky_factor), np.float64)
        results = [problem.minimise(whitening, start) for start in candidates]
        best = min(results, key=lambda result: float(result.cost))
        # `best.jac` has the derivatives of the whitened residual, whose sign is opposite to the model's.
        return WeightedFit(problem.residual(best.x), -cholesky_factor @ best.jac, problem.moduli(best.x))

    try:
        joint = fit_jointly(lines, fit_under, without=["timing"] if problem.has_free_delay else [])
    except (ValueError, np.linalg.LinAlgError):  # the law is not finite anywhere
        return None

    count = len(law.parameters)
    values, delay = problem.parameters(best.x), problem.delay(best.x)
    # Steps are shares of the largest first guesses, for a value may be next to nothing.
    scale = np.max([np.exp(start[:count]) for start in starts], axis=0)
    stds = joint.uncertainty(problem.derivatives(values, delay, _RELATIVE_STEP * scale))
    parameter_count = count + int(problem.has_free_delay) + joint.scatter.parameter_count
    penalty = parameter_count * math.log(2 * len(lines))
    return LawFit(
        law=law,
        delay=delay,
        delay_std=float(stds[count]) if problem.has_free_delay else math.nan,
        values=values,
        stds=stds[:count],
        chi2=joint.chi2,
        freedom=2 * len(lines) - parameter_count,
        bic=joint.chi2 + joint.log_determinant + penalty,
        scatter=joint.scatter,
    )


@dataclass(frozen=True)
class _LawProblem:
    """Least squares of a law and, if it is free, a delay of the force.

    The unknowns x are the logarithms of the law's parameters, then the delay as a share of the longest one.
    """

    law: LinearLaw
    lines: Sequence[ModulusLine]
    has_free_delay: bool

    @cached_property
    def omega(self) -> Floats:
        """(n,) [rad/s]."""
        return np.asarray(2 * np.pi * np.array([line.frequency for line in self.lines]))

    @cached_property
    def longest_delay(self) -> float:
        """[s] 0 where the delay is not free."""
        return min(_MAX_DELAY, math.pi / float(self.omega.max())) if self.has_free_delay else 0.0

    def parameters(self, x: Floats) -> Floats:
        """Return the law's parameters (p,)."""
        return np.asarray(np.exp(x[: len(self.law.parameters)]))

    def delay(self, x: Floats) -> float:
        """Return the delay [s] of the force beyond the declared one."""
        return float(x[-1]) * self.longest_delay

    def moduli(self, x: Floats) -> Phasors:
        """Return the law's G* (n,) [Pa]."""
        return self.law.shear_modulus(self.omega, self.parameters(x), self.lines[0].poisson)

    def residual(self, x: Floats) -> Floats:
        """Return G' and G'' (2 n,) [Pa] without the delay, less those of the law."""
        return stack_moduli(self.lines, self.delay(x)) - stack_parts(self.moduli(x))

    def starts(self) -> list[Floats]:
        """Return the first guesses: those of the law for the median of |E*|, without a delay."""
        shear = np.array([line.shear for line in self.lines])
        young = 2.0 * (1.0 + self.lines[0].poisson) * float(np.median(np.abs(shear)))
        no_delay = [0.0] if self.has_free_delay else []
        return [np.array([*np.log(guess), *no_delay], np.float64) for guess in self.law.starts(young, 1.0 / self.omega)]

    def minimise(self, whitening: Floats, start: Floats) -> Any:
        """Return scipy's least squares from a start, of residuals that a matrix (2 n, 2 n) whitens."""
        from scipy.optimize import least_squares

        delay_bounds = ([-1.0], [1.0]) if self.has_free_delay else ([], [])
        lower = [-_MAX_LOG_PARAMETER] * len(self.law.parameters) + delay_bounds[0]
        upper = [min(math.log(bound), _MAX_LOG_PARAMETER) for bound in self.law.uppers] + delay_bounds[1]
        return least_squares(
            lambda x: whitening @ self.residual(x), start, bounds=(lower, upper), x_scale="jac",
            xtol=_TOLERANCE, ftol=_TOLERANCE, gtol=_TOLERANCE,
        )  # fmt: skip

    def derivatives(self, values: Floats, delay: float, steps: Floats) -> Floats:
        """Return the derivatives (2 n, p) of the moduli by the law's parameters (steps (p,)), and by a free delay."""
        poisson = self.lines[0].poisson
        moduli = stack_parts(self.law.shear_modulus(self.omega, values, poisson))
        columns = []
        for step in np.diag(steps):
            changed_moduli = stack_parts(self.law.shear_modulus(self.omega, values + step, poisson))
            columns.append((changed_moduli - moduli) / step.sum())
        if self.has_free_delay:
            # A delay of the model is one of the data with the opposite sign.
            early, late = stack_moduli(self.lines, delay - _DELAY_STEP), stack_moduli(self.lines, delay + _DELAY_STEP)
            columns.append((early - late) / (2 * _DELAY_STEP))
        return np.column_stack(columns)


def supported_laws(fits: Sequence[LawFit], level: float = _REJECTION_LEVEL) -> list[LawFit]:
    """Return the laws that the data do not refute at a level, and whose BIC is within 6 of the best; the best first."""
    candidates = sorted((fit for fit in fits if not fit.p < level), key=lambda fit: fit.bic)
    return [fit for fit in candidates if fit.bic - candidates[0].bic < _MAX_BIC_DIFFERENCE]
