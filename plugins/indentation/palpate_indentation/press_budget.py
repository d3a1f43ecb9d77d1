"""Everything that is assumed exact about a press, and its effect on the modulus: rows of a budget after the GUM."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import BudgetRow, ConfigurationError, Effect
from palpate_engine import AlignmentSettings
from palpate_kit.budget.force_sensitivity import Along, at_samples
from palpate_kit.budget.systematic_terms import source_terms, systematic_terms
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_indentation.approach_fit import CurveFit
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch


@dataclass(frozen=True)
class Declared:
    """The statements of a pipeline on the uncertainty of its readings, its tip and its model."""

    alignment: AlignmentSettings | None = None
    uncertainties: Mapping[str, Any] | None = None


def modulus_row(
    source: str, std: float | None, unit: str, contribution: float, law: ElasticLaw, fit: CurveFit
) -> BudgetRow:
    """Return a source that contributes a standard uncertainty [unit of the modulus] to the modulus."""
    effect = Effect.of(fit.modulus, contribution, contribution / std if std else None)
    return BudgetRow(source, std, unit, {law.name: effect})


def declared_rows(law: ElasticLaw, branch: Branch, fit: CurveFit, declared: Declared) -> Iterator[BudgetRow]:
    """Yield a row for everything that is declared, or has a default.

    Yields nothing where no reading of the fit is in contact. Raises ConfigurationError for an invalid uncertainty.
    """
    try:
        sources = sources_of(law.model, declared.uncertainties or {})
    except ValueError as error:
        raise ConfigurationError(f"[run] uncertainties: {error}") from error
    sensitivity = _sensitivity(law, branch, fit)
    if sensitivity is None:
        return
    # A force that is late by tau reads too little by tau dF/dt: shifts of the unknowns for 1 s.
    delay_shifts = sensitivity.shifts(-sensitivity.change)
    settings = declared.alignment
    if settings is not None and delay_shifts is not None:
        timing = settings.timing_uncertainty
        terms = systematic_terms(sensitivity, delay_shifts, timing, settings, report=None, sources=sources)
    else:
        terms = list(source_terms(sensitivity, sources))
    for term in terms:
        # The first shift is that of the modulus.
        yield replace(term, shifts=term.shifts[:1]).row({law.name: fit.modulus})


def bound_of_viscosity(law: ElasticLaw, viscous: ElasticLaw, branch: Branch, fit: CurveFit) -> tuple[float, float]:
    """Return the viscosity [SI] that a law without one leaves open, and how far it moves the modulus.

    `viscous` is a law whose damping c (n,), force per viscosity, stands for it. One step of least squares: with r the
    residual of the fit and p the part of c that the other unknowns do not explain, the viscosity is p.r/p.p, and its
    standard uncertainty rms sqrt(t/p.p) with the correlation time t; both are added in squares. Infinite where the
    unknowns are indistinct.
    """
    sensitivity = _sensitivity(law, branch, fit)
    damping = viscous.damping(fit.surface - branch.height, branch.rate)
    shifts = sensitivity.answer(damping) if sensitivity is not None else None
    if sensitivity is None or shifts is None:
        return math.inf, math.inf
    distinct_damping = damping - sensitivity.jacobian @ shifts
    power = float(distinct_damping @ distinct_damping)
    viscosity = float(distinct_damping @ fit.residual) / power
    std = fit.rms * math.sqrt(fit.correlation_time / power)
    bound = math.hypot(viscosity, std)
    return bound, bound * abs(float(shifts[0]))


def _sensitivity(law: ElasticLaw, branch: Branch, fit: CurveFit) -> Along | None:
    """Return the answer of all unknowns of a fit to small errors of the force; None where nothing is in contact.

    Its columns are those of modulus, offset, tilt where it is fitted, work where the law is adhesive, and surface.
    """
    theta = np.array(law.held)
    theta[law.modulus_index] = fit.modulus
    if law.adhesion:
        theta[1] = fit.work
    depth = fit.surface - branch.height
    sensitivity = at_samples(law.model, (branch.time, depth, branch.rate, -branch.acceleration), theta, air=True)
    if sensitivity is None:
        return None
    columns = [sensitivity.jacobian[:, law.modulus_index], np.ones(len(branch))]
    if fit.tilt_std > 0:
        columns.append(branch.height - fit.surface)
    if law.adhesion:
        columns.append(sensitivity.jacobian[:, 1])
    columns.append(sensitivity.jacobian[:, -1])
    return replace(sensitivity, jacobian=np.column_stack(columns))
