"""The uncertainty of a fit: by the scatter of its residuals, and by everything that is not exactly known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import BudgetRow, Effect, Floats, Term
from palpate_kit.budget.systematic_terms import source_terms
from palpate_kit.numerics.refusal import NotFitted

from palpate_fits.budget import PROBE, TIMING, FitSensitivity, open_row
from palpate_fits.fit_outcome import FitOutcome
from palpate_fits.identifiability import condition, identifiability
from palpate_fits.one_speed import OneSpeedInterval, one_speed_intervals
from palpate_fits.uncertainty import ResidualScatter, mean_uncertainty, scatter

_BOUND_DISTANCE = 1e-3  # [standard deviations], within which an unknown is at its bound (choice)


@dataclass(frozen=True)
class FitWithUncertainty:
    """A fit with its uncertainty."""

    fit: FitOutcome
    scatter: ResidualScatter
    random: Floats  # (p,) standard uncertainty of the free unknowns from the residuals
    systematic: Floats  # (p,) from everything declared, without timing
    at_bound: NDArray[np.bool_]  # (p,)
    budget: list[BudgetRow]
    identifiability: dict[str, Any]
    quantile: float
    one_speed: dict[int, OneSpeedInterval]  # by place among the free


def with_uncertainty(fit: FitOutcome) -> FitWithUncertainty:
    """Return a fit with random and systematic uncertainty, bounds, budget and identifiability of its free unknowns.

    Raises NotFitted where they cannot be distinguished within rounding.
    """
    from scipy.special import stdtrit

    # Random: from the residuals at the minimum; at the corrected values, where a material with memory has other slopes.
    residual_scatter = scatter(fit.residual, fit.record, fit.solution.least, fit.loss)
    if fit.problem.model.memory and fit.solution.moved is not None:
        covariance = scatter(fit.residual, fit.record, fit.solution.x, fit.loss).covariance
        residual_scatter = replace(residual_scatter, covariance=covariance)
    if not (residual_scatter.covariance.diagonal() >= 0).all():
        raise NotFitted("diverged", "the fit ended where the force hardly depends on its unknowns")
    one_speed = dict(one_speed_intervals(fit, residual_scatter))
    for interval in one_speed.values():
        residual_scatter = replace(residual_scatter, covariance=interval.covariance)
    random = np.sqrt(residual_scatter.covariance.diagonal())
    free = list(fit.residual.free)
    low, high = fit.unknowns.bounds(free)
    x = fit.solution.x[free]
    at_bound = (x - low < _BOUND_DISTANCE * random) | (high - x < _BOUND_DISTANCE * random)
    # Systematic: near 0 a viscosity at one speed has no slope of its own; its interval includes what it does to others.
    is_fixed = at_bound | np.isin(np.arange(len(free)), list(one_speed))
    sensitivity = FitSensitivity(fit.residual, fit.record, fit.solution.x, is_fixed)
    rows, systematic = _budget(fit, sensitivity, residual_scatter)
    freedom = max(residual_scatter.effective_samples - len(free), 1.0)
    # The quantile of Student's distribution, for an interval with as much probability beyond either end.
    quantile = float(stdtrit(freedom, 0.5 + fit.settings.confidence / 2))
    return FitWithUncertainty(
        fit=fit,
        scatter=residual_scatter,
        random=random,
        systematic=systematic,
        at_bound=at_bound,
        budget=rows,
        identifiability=_identifiability(fit, sensitivity),
        quantile=quantile,
        one_speed=one_speed,
    )


def _identifiability(fit: FitOutcome, sensitivity: FitSensitivity) -> dict[str, Any]:
    """Return condition and pairs of the free unknowns, each against a delay as well where that is not one of them."""
    free = list(fit.residual.free)
    names = [fit.unknowns.names[place] for place in free]
    jacobian = sensitivity.jacobian
    if "delay" not in names:
        jacobian = np.column_stack([jacobian, sensitivity.column(fit.unknowns.index("delay"), PROBE)])
        names.append("delay")
    return condition(jacobian[:, : len(free)]) | identifiability(jacobian.T @ jacobian, names, len(free))


def _budget(
    fit: FitOutcome, sensitivity: FitSensitivity, residual_scatter: ResidualScatter
) -> tuple[list[BudgetRow], Floats]:
    """Return the rows of the budget, and the standard uncertainty (p,) by all but the random and the timing row.

    `sensitivity` gives the shifts of the free unknowns by an error of the force.
    """
    free, names = list(fit.residual.free), fit.unknowns.names
    values = {names[place]: float(fit.solution.x[place]) for place in free}
    random = np.sqrt(residual_scatter.covariance.diagonal()).tolist()
    effects = {}
    for (name, value), std in zip(values.items(), random, strict=True):
        effects[name] = Effect.of(value, std)
    terms = _systematic_terms(fit, sensitivity, residual_scatter)
    rows = [BudgetRow("scatter of the residuals", None, "", effects), *(term.row(values) for term in terms)]
    delay = fit.unknowns.index("delay")
    if delay not in free:
        per_second = sensitivity.of_parameter(delay, PROBE) / PROBE  # by differences over a small delay
        rows.append(_timing_row(fit, values, per_second))
    systematic = np.sqrt(sum((term.shifts**2 for term in terms), np.zeros(len(free))))
    return rows, systematic


def _systematic_terms(fit: FitOutcome, sensitivity: FitSensitivity, residual_scatter: ResidualScatter) -> list[Term]:
    """Return the terms of the model's keys and of the readings, of fixed unknowns, of those that nobody names, and of
    the force's last digit."""
    names = fit.unknowns.names
    model_sources = [source for source in fit.sources if source.path or source.name not in names]
    unknown_sources = [source for source in fit.sources if source not in model_sources]
    terms = list(source_terms(sensitivity, model_sources))
    for source in unknown_sources:
        shifts = sensitivity.of_parameter(fit.unknowns.index(source.name), source.std)
        terms.append(Term(source.name, source.std, source.unit, shifts))
    for label, name, std, unit in implied_sources(fit):
        terms.append(Term(label, std, unit, sensitivity.of_parameter(fit.unknowns.index(name), std)))
    terms.extend(_digit_terms(fit, residual_scatter))
    return terms


def _timing_row(fit: FitOutcome, values: dict[str, float], per_second: Floats) -> BudgetRow:
    """Return the row of the timing, by the shifts (p,) of the free unknowns per second of delay; open if not stated."""
    timing_uncertainty = fit.problem.timing_uncertainty
    if timing_uncertainty is None:
        return open_row(f"{TIMING} (not declared)", "s", dict(zip(values, per_second.tolist(), strict=True)))
    return Term(TIMING, timing_uncertainty, "s", per_second * timing_uncertainty).row(values)


def _digit_terms(fit: FitOutcome, residual_scatter: ResidualScatter) -> Iterator[Term]:
    """Yield the last digit of the force, where it exceeds the noise: one error q/sqrt(12) for each plateau of readings.

    Errors of plateaus hardly show in the residual of a hold, which has one of them.
    """
    if fit.digit.exceeds_noise(fit.samples.force[fit.rows]):
        shifts = fit.digit.noise * np.sqrt(np.maximum(residual_scatter.inverse_normal.diagonal(), 0.0))
        yield Term("last digit of the force", fit.digit.noise, "N", shifts)


def _zero_uncertainty(fit: FitOutcome, air: Floats) -> float:
    """Return the standard uncertainty [N] of the mean force in air (n,) [N]; a coarse last digit is one error."""
    scatter_of_mean = mean_uncertainty(air)
    return math.hypot(scatter_of_mean, fit.digit.noise) if fit.digit.exceeds_noise(air) else scatter_of_mean


def implied_sources(fit: FitOutcome) -> Iterator[tuple[str, str, float, str]]:
    """Yield label, unknown, standard uncertainty and unit of sources that the settings do not name.

    These are the zero of the force, and a contact point that is not fitted. The zero is as uncertain as is stated;
    where nobody states it, as the mean of the force in the air before the contact.
    """
    names = {fit.unknowns.names[place] for place in fit.residual.free}
    declared = {source.name for source in fit.sources}
    if not {"bias"} & (names | declared | set(fit.settings.fixed)):
        if stated := fit.problem.zero_uncertainty:
            yield "tare", "bias", stated, "N"
        elif (approach := fit.by_force.approach) is not None:
            yield "tare", "bias", _zero_uncertainty(fit, approach.force[: approach.air]), "N"
    if fit.settings.contact_point != "free":
        yield "contact point", "surface", fit.by_force.points[fit.settings.contact_point].std, "m"
