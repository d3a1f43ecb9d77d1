"""What is assumed exact about a press, and what it does to the modulus: rows of a budget after the GUM."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import BudgetRow, ConfigurationError, Effect, Term
from palpate_engine import AlignmentSettings
from palpate_kit.budget.force_sensitivity import Along, at_samples
from palpate_kit.budget.systematic_terms import source_terms, systematic_terms
from palpate_kit.budget.uncertainty_sources import sources_of

from palpate_indentation.approach_fit import CurveFit
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch


@dataclass(frozen=True)
class Declared:
    """What a pipeline says of its readings, its tip and its model."""

    alignment: AlignmentSettings | None = None
    uncertainties: Mapping[str, Any] | None = None


def modulus_row(
    source: str, std: float | None, unit: str, contribution: float, law: ElasticLaw, fit: CurveFit
) -> BudgetRow:
    """Return a source that contributes a standard uncertainty [unit of the modulus] to the modulus."""
    effect = Effect.of(fit.modulus, contribution, contribution / std if std else None)
    return BudgetRow(source, std, unit, {law.name: effect})


def declared_rows(law: ElasticLaw, branch: Branch, fit: CurveFit, declared: Declared) -> Iterator[BudgetRow]:
    """Everything that is declared, or has a default; raises ConfigurationError for an invalid uncertainty."""
    try:
        sources = sources_of(law.model, declared.uncertainties or {})
    except ValueError as error:
        raise ConfigurationError(f"[run] uncertainties: {error}") from error
    found = _sensitivity(law, branch, fit)
    if found is None:
        return
    late, settings = found.shifts(-found.change), declared.alignment
    terms: list[Term] = [*source_terms(found, sources)]
    if settings is not None and late is not None:
        terms = systematic_terms(found, late, settings.timing_uncertainty, settings, None, sources)
    for term in terms:
        yield replace(term, shifts=term.shifts[:1]).row({law.name: fit.modulus})


def bound_of_viscosity(law: ElasticLaw, viscous: ElasticLaw, branch: Branch, fit: CurveFit) -> tuple[float, float]:
    """The viscosity that a law without one leaves open, by another law's damping, and how far it moves the modulus.

    By one step of least squares: what it would choose, and its standard uncertainty; infinite where indistinct.
    """
    found, damping = _sensitivity(law, branch, fit), viscous.damping(fit.surface - branch.height, branch.rate)
    shifts = found.answer(damping) if found is not None else None
    if found is None or shifts is None:
        return math.inf, math.inf
    left = damping - found.jacobian @ shifts
    power = float(left @ left)
    chosen, std = float(left @ fit.residual) / power, fit.rms * math.sqrt(fit.correlation_time / power)
    bound = math.hypot(chosen, std)
    return bound, bound * abs(float(shifts[0]))


def _sensitivity(law: ElasticLaw, branch: Branch, fit: CurveFit) -> Along | None:
    """How all that the fit has found answers to small errors of the force: modulus, offset, tilt and surface."""
    values = np.array(law.held)
    values[law.place] = fit.modulus
    if law.adhesion:
        values[1] = fit.work
    motion = branch.time, fit.surface - branch.height, branch.rate, -branch.acceleration
    found = at_samples(law.model, motion, values, air=True)
    if found is None:
        return None
    tilt = [branch.height - fit.surface] if fit.tilt_std > 0 else []
    sticks = [found.jacobian[:, 1]] if law.adhesion else []
    columns = [found.jacobian[:, law.place], np.ones(len(branch)), *tilt, *sticks, found.jacobian[:, -1]]
    return replace(found, jacobian=np.column_stack(columns))
