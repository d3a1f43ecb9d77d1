"""The budget of an estimate after the GUM: every source, its standard uncertainty, and what that does to each value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate.alignment import GRAVITY, AlignmentReport, AlignmentSettings
from palpate.contact import ContactModel
from palpate.contact.sources import Source
from palpate.fit_report import BudgetRow, Effect
from palpate.result.along import Along
from palpate.result.response import answer
from palpate.vectors import Floats

_MASS = 0.05  # of itself, where no uncertainty of a tip's mass is declared


@dataclass(frozen=True)
class Term:
    """One source, with what one standard uncertainty of it does; its effects on several values have one cause."""

    cause: str
    std: float
    unit: str
    shifts: Floats  # (k,) [SI] of each parameter, with signs
    declared: bool = True  # else a default


def systematic_terms(
    found: Along | None,
    shifts: Floats,
    timing: float | None,
    settings: AlignmentSettings,
    report: AlignmentReport,
    sources: Sequence[Source] = (),
    included: Sequence[str] = (),
) -> list[Term]:
    """The terms of everything that is declared, or has a default; what an estimator has `included` is left out.

    Timing: dtheta/dtau u(tau), by `shifts` (k,) of `delay_shifts`. All others: a small error f(t) of the force shifts
    the least-squares estimate with unknown surface by (J^T J)^-1 J^T f, J the model's derivatives along the last
    samples. Mass: f = -u(m) z'' (and the weight, where it was removed); tare: f = u; force_scale: f = u F; a number of
    the model: f = -dF/dp u; position_scale: f = -(dF/dd d + dF/dd' d') u. Compliance: a robot of stiffness k gives way
    by F/k, so that the depth is F/k less than it seems, f = -(dF/dd F + dF/dd' F')/k; it is not corrected, and all of
    the shift counts.
    """
    terms = []
    if timing is not None and shifts.any() and "timing" not in included:
        terms.append(Term("timing", timing, "s", shifts * timing))
    if found is None:
        return terms
    terms += [term for term in _of_readings(found, settings, report) if term.cause not in included]
    for source in sources:
        change = _change(found, source)
        if source.name not in included and change is not None:
            terms += _term(found, source.name, source.std, source.unit, change * source.std, source.declared)
    return terms


def _of_readings(found: Along, settings: AlignmentSettings, report: AlignmentReport) -> list[Term]:
    terms: list[Term] = []
    if settings.tip_mass is not None:
        mass, declared = settings.tip_mass_uncertainty, settings.tip_mass_uncertainty is not None
        std = mass if mass is not None else _MASS * settings.tip_mass
        weight = GRAVITY if settings.weight == "removed" else 0.0
        terms += _term(found, "mass", std, "kg", std * (weight - found.acceleration), declared)
    tare = report.tare.offset_std if report.tare else None
    if tare is not None:
        terms += _term(found, "tare", float(tare), "N", np.full(len(found.force), tare))
    if settings.series_stiffness is not None and found.given_way is not None:
        stiffness = settings.series_stiffness
        terms += _term(found, "compliance", 1.0 / stiffness, "m/N", -found.given_way / stiffness)
    return terms


def _change(found: Along, source: Source) -> Floats | None:
    """Error (n,) of the force per unit of a source; None where it cannot be told."""
    if source.path:
        return -found.by_number(source.path, source.value)
    if source.name == "force_scale":
        return found.force
    return None if found.stretched is None else -found.stretched


def _term(found: Along, cause: str, std: float, unit: str, error: Floats, declared: bool = True) -> list[Term]:
    """The term of an error (n,) of the force [N]; nothing where parameters and surface are indistinct."""
    shifts = answer(found.jacobian, error)
    return [] if shifts is None else [Term(cause, std, unit, shifts[:-1], declared)]


def per_newton(found: Along | None) -> Floats | None:
    """Shift (k,) of each parameter per newton of a constant force [unit/N]; None where it cannot be told."""
    shifts = answer(found.jacobian, np.ones(len(found.force))) if found is not None else None
    return None if shifts is None else shifts[:-1]


class _Value(Protocol):
    @property
    def value(self) -> float: ...
    @property
    def std(self) -> float: ...
    @property
    def settling(self) -> float: ...


def budget_table(model: ContactModel, values: Mapping[str, _Value], terms: Sequence[Term]) -> Iterator[BudgetRow]:
    """One row for each source: the estimator's own, what is left of the way to rest, then all that is systematic."""
    names = [parameter.name for parameter in model.parameters]
    yield BudgetRow("estimator", None, "", {name: _effect(None, values[name].std, values[name]) for name in names})
    if any(values[name].settling for name in names):
        rest = {name: _effect(None, values[name].settling, values[name]) for name in names}
        yield BudgetRow("settling", None, "", rest)
    for term in terms:
        shifts = zip(names, term.shifts.tolist(), strict=True)
        effects = {
            name: _effect(shift / term.std if term.std else None, abs(shift), values[name]) for name, shift in shifts
        }
        label = term.cause if term.declared else f"{term.cause} (not declared)"
        yield BudgetRow(label, term.std, term.unit, effects)


def _effect(sensitivity: float | None, contribution: float, of: _Value) -> Effect:
    return Effect(sensitivity, contribution, 100.0 * contribution / abs(of.value) if of.value else None)
