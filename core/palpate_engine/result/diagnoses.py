"""Diagnoses of the tracks of a run, and the results with their findings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from palpate.contact import ContactModel
from palpate.errors import RAISED_BY_PARTS, PluginError, error_in
from palpate.estimation import Estimator
from palpate.evidence.condition import Condition, joined
from palpate.evidence.track_evidence import Diagnosed, TrackEnd, TrackEvidence
from palpate.evidence.uncertain_value import DerivedValue, UncertainValue
from palpate.fit_report import BudgetRow
from palpate.flags import Flag
from palpate.offers import Diagnosis, function_of
from palpate.parts import Settings
from palpate.vectors import read_only

from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.result.track_record import TrackRecord
from palpate_engine.result.track_result import TrackResult


@dataclass(frozen=True)
class Diagnosable:
    """A track with its record and its result."""

    model: ContactModel
    estimator: Estimator
    record: TrackRecord
    result: TrackResult


@dataclass(frozen=True)
class RunEvidence:
    """Evidence for diagnoses that concerns every track of a run."""

    settings: AlignmentSettings
    report: AlignmentReport
    average: float  # [s] at the end, over which results are means
    uncertainties: Mapping[str, Any] = field(default_factory=dict)  # that the pipeline declares
    tables: Mapping[str, Settings] = field(default_factory=dict)
    is_simulated: bool = False


def apply_diagnoses(
    tracks: Mapping[str, Diagnosable], diagnoses: Mapping[str, Diagnosis], of_run: RunEvidence
) -> dict[str, TrackResult]:
    """Return the results of all tracks with the findings of all diagnoses.

    Tracks without finite values are seen only by diagnoses that ask for them (`lost`).
    """
    evidence = {label: _evidence(label, track, of_run) for label, track in tracks.items() if track.result.samples}
    findings = dict[str, Mapping[str, Diagnosed]]()  # by diagnosis, then by track

    @cache  # diagnoses share those before them
    def diagnosed(label: str, names: tuple[str, ...]) -> TrackResult:
        """Return the result of a track with its findings by these diagnoses, all of which have some."""
        if not names:
            return tracks[label].result
        *earlier, name = names
        return with_findings(diagnosed(label, tuple(earlier)), tracks[label].model, name, findings[name][label])

    @cache
    def updated(label: str, names: tuple[str, ...]) -> TrackEvidence:
        """Return the evidence of a track with the uncertainties by these diagnoses, all of which have findings."""
        return _with_uncertainties(evidence[label], diagnosed(label, names))

    def with_findings_on(label: str, names: Iterable[str]) -> tuple[str, ...]:
        """Return the diagnoses that have findings on a track."""
        return tuple(name for name in names if label in findings[name])

    # Each diagnosis sees the tracks with the findings of those before it, and no others.
    has_values = {label: bool(np.isfinite(track.values).all()) for label, track in evidence.items()}
    for name, predecessors in _order(tuple(diagnoses.items())):
        diagnosis = diagnoses[name]
        labels = [label for label in evidence if diagnosis.lost or has_values[label]]
        tracks_before = [updated(label, with_findings_on(label, predecessors)) for label in labels]
        findings[name] = _findings(name, diagnosis, tracks_before) if labels else {}
    return {label: diagnosed(label, with_findings_on(label, findings)) for label in tracks}


@lru_cache(maxsize=4)  # the records of a folder share one
def _order(by_name: tuple[tuple[str, Diagnosis], ...]) -> list[tuple[str, list[str]]]:
    """Return the order of diagnoses."""
    return diagnosis_order(dict(by_name))


def diagnosis_order(diagnoses: Mapping[str, Diagnosis]) -> list[tuple[str, list[str]]]:
    """Return the names of diagnoses in the order in which they run, each with those whose findings it is given.

    Those are what it states, and what they state in turn. Raises PluginError where some wait for each other.
    """
    # The diagnoses that each states to be before it; some are after every other.
    last = {name for name, diagnosis in diagnoses.items() if Diagnosis.EVERY_OTHER in diagnosis.after}
    predecessors = {name: set(diagnosis.after) & set(diagnoses) for name, diagnosis in diagnoses.items()}
    for name in last:
        predecessors[name] |= set(diagnoses) - last
    sorter = TopologicalSorter(predecessors)
    try:
        sorter.prepare()
    except CycleError as error:
        raise PluginError(f"diagnoses wait for each other: {', '.join(map(repr, error.args[1]))}") from error
    order = list[str]()
    all_predecessors = dict[str, set[str]]()  # predecessors, and theirs in turn
    while sorter.is_active():
        ready = set(sorter.get_ready())
        for name in diagnoses:
            if name not in ready:
                continue
            all_predecessors[name] = predecessors[name].union(
                *(all_predecessors[other] for other in predecessors[name])
            )
            order.append(name)
        sorter.done(*ready)
    return [(name, [other for other in order if other in all_predecessors[name]]) for name in order]


def _findings(name: str, diagnosis: Diagnosis, evidence: list[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the findings of one diagnosis; the estimates stay, whatever a third-party function raises."""
    try:
        findings = dict(function_of(diagnosis)(evidence))
        for label, finding in findings.items():
            if not isinstance(finding, Diagnosed):
                raise TypeError(f"the finding on {label} is {finding!r}, not Diagnosed")
        return findings
    except RAISED_BY_PARTS as error:
        flag = Flag("diagnosis-failed", f"{name}: {error_in(error)}")
        return {track.name: Diagnosed((flag,)) for track in evidence}


def with_findings(result: TrackResult, model: ContactModel, name: str, finding: Diagnosed) -> TrackResult:
    """Return a result with the flags, uncertainties and numbers of a finding; derived values take them over.

    A parameter that was held fixed keeps what was stated of it.
    """
    cause = name.replace("-", "_")
    names = [parameter.name for parameter in model.parameters]
    if finding.changes_values:
        result = _with_uncertain_values(result, model, cause, finding)
    # Flags that the finding settles have no effect any more; its own are of this cause, if they state no other.
    flags = [replace(flag, effects={}) if flag.code in finding.settles else flag for flag in result.flags]
    flags += [replace(flag, causes=(cause,)) if flag.causes is None else flag for flag in finding.flags]
    conditions = (*result.conditions, *_with_derived_shifts(finding.conditions, model, result))
    return replace(
        result,
        surface=result.surface.diagnosed(cause, finding.surface),
        budget=(*result.budget, *_budget_rows(result, names, name, finding)),
        flags=tuple(flags),
        conditions=_open_facts(conditions, finding.known),
        diagnoses=dict(result.diagnoses) | ({name: finding.table} if finding.table else {}),
    )


def _with_uncertain_values(result: TrackResult, model: ContactModel, cause: str, finding: Diagnosed) -> TrackResult:
    """Return a result with the uncertainties of a finding, of parameters and of values that follow from them."""
    parameters, free = dict(result.parameters), result.free
    for i, parameter in enumerate(model.parameters):
        name = parameter.name
        if name not in free:
            continue
        shares = [abs(float(term.shifts[i])) for term in finding.sources]
        by_sources = _with_sources(parameters[name], finding, name, shares)
        term, is_unknown = finding.terms.get(name, 0.0), name in finding.unknown
        bias, remainder = finding.biases.get(name), finding.left.get(name)
        parameters[name] = by_sources.diagnosed(cause, term, is_unknown, bias, remainder)
    derived = tuple(_with_uncertain_derived(value, model, result, finding, cause) for value in result.derived)
    return replace(result, parameters=parameters, derived=derived)


def _open_facts(conditions: Sequence[Condition], measured_facts: frozenset[str]) -> tuple[Condition, ...]:
    """Return the conditions without facts that a record measures, one of each fact."""
    return joined([condition for condition in conditions if condition.fact not in measured_facts])


def _with_derived_shifts(
    conditions: Sequence[Condition], model: ContactModel, result: TrackResult
) -> Iterator[Condition]:
    """Yield conditions with the shifts of values that follow from the parameters, to first order."""
    names = [parameter.name for parameter in model.parameters]
    values = [result.parameters[name].value for name in names]
    derived = {value.name for value in result.derived}
    gradients: dict[str, Sequence[float]] = {}
    if derived and conditions:
        gradients = {value.name: value.gradient for value in model.material(values) if value.name in derived}
    for condition in conditions:
        shift = np.array([condition.shifts.get(name, 0.0) for name in names])
        derived_shifts = {name: float(np.array(gradient) @ shift) for name, gradient in gradients.items()}
        nonzero = {name: shift for name, shift in derived_shifts.items() if shift}
        yield replace(condition, shifts={**condition.shifts, **nonzero})


def _with_sources(value: UncertainValue, finding: Diagnosed, name: str, shares: Iterable[float]) -> UncertainValue:
    """Return a value with a share of each source of a finding, and with the delay that would look like it."""
    for term, share in zip(finding.sources, shares, strict=True):
        value = value.diagnosed(term.cause, share)
    return replace(value, per_shear=finding.delays[name]) if name in finding.delays else value


def _budget_rows(result: TrackResult, names: Sequence[str], name: str, finding: Diagnosed) -> Iterator[BudgetRow]:
    """Yield the rows of a finding in the budget."""
    for term in finding.sources:
        yield term.row({key: result.parameters[key].value for key in names})
    terms = dict(finding.terms)
    for key, bias in finding.biases.items():
        terms[key] = math.hypot(terms.get(key, 0.0), bias.shift)
    shares = {key: share for key, share in terms.items() if share > 0 and key in result.free}
    if shares:
        yield BudgetRow(name, None, "", {key: result.parameters[key].effect(share) for key, share in shares.items()})


def _with_uncertain_derived(
    value: DerivedValue, model: ContactModel, result: TrackResult, finding: Diagnosed, cause: str
) -> DerivedValue:
    """Return a value that follows from the parameters with the uncertainties of a finding, to first order.

    With the gradient g of the value, its share is the root sum of squares of that of the terms, sqrt(sum (g_i u_i)^2),
    and of the known shifts b, sum g_i b_i, which have one cause.
    """
    names = [parameter.name for parameter in model.parameters]
    values = [result.parameters[name].value for name in names]
    material = next(candidate for candidate in model.material(values) if candidate.name == value.name)
    # Terms and shifts of the parameters, with signs where these are known.
    share = material.std([finding.terms.get(name, 0.0) for name in names])
    shifts = [finding.biases[name].shift if name in finding.biases else 0.0 for name in names]
    share = math.hypot(share, sum(slope * shift for slope, shift in zip(material.gradient, shifts, strict=True)))
    # A parameter counts as unknown only where the value depends on it.
    is_unknown = any(slope and name in finding.unknown for name, slope in zip(names, material.gradient, strict=True))
    # Rows of the budget keep their own cause.
    gradient = np.array(material.gradient)
    shares = [abs(float(gradient @ term.shifts)) for term in finding.sources]
    by_sources = _with_sources(value.found, finding, value.name, shares)
    return replace(value, found=by_sources.diagnosed(cause, share, is_unknown))


def _evidence(name: str, track: Diagnosable, of_run: RunEvidence) -> TrackEvidence:
    """Return the evidence of a track: its samples, its values with their uncertainties, its end."""
    values = [track.result.parameters[parameter.name] for parameter in track.model.parameters]
    record, settings = track.record, of_run.settings
    time, force, position = record.keeper.air
    evidence = TrackEvidence(
        name=name,
        model=track.model,
        estimator=track.estimator,
        tip_mass=settings.tip_mass,
        kept=read_only(record.keeper.kept),
        air_time=time,
        air_force=force,
        air_position=position,
        values=np.array([value.value for value in values]),
        std=np.array([value.std for value in values]),
        combined=np.array([value.combined for value in values]),
        surface=track.result.surface.value,
        report=record.report,
        tables=of_run.tables,
        ending=_track_end(track, of_run),
        found=track.result.parameters,
        air_after=record.keeper.air_after,
    )
    return read_only(evidence)


def _with_uncertainties(evidence: TrackEvidence, result: TrackResult) -> TrackEvidence:
    """Return the evidence with the uncertainties of a result, those by the diagnoses before."""
    combined = np.array([result.parameters[parameter.name].combined for parameter in evidence.model.parameters])
    return read_only(
        replace(evidence, combined=combined, found=result.parameters, surface_uncertainty=result.surface.combined)
    )


def _track_end(track: Diagnosable, of_run: RunEvidence) -> TrackEnd | None:
    """Return the evidence of the end of a track; None where nothing was tracked."""
    tail = track.record.tail
    if tail is None:
        return None
    average = of_run.average if track.estimator.online else math.inf
    included = {*track.record.details.get("included", ()), *(["timing"] if track.record.timing_included else [])}
    record, run = track.record, of_run
    return TrackEnd(
        tail=read_only(tail),
        last=read_only(tail.last(average)),
        settings=run.settings,
        report=run.report,
        uncertainties=run.uncertainties,
        held=record.held,
        included=frozenset(included),
        average=run.average,
        tracked=record.tracked,
        samples=record.samples,
        is_sweep=record.is_sweep,
        is_simulated=run.is_simulated,
    )
