"""What diagnoses say of the tracks of a run, and what becomes of the result by it."""

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
    """A track with its record and what it found."""

    model: ContactModel
    estimator: Estimator
    record: TrackRecord
    result: TrackResult


@dataclass(frozen=True)
class RunEvidence:
    """What concerns every track of a run, and diagnoses want to know."""

    settings: AlignmentSettings
    report: AlignmentReport
    average: float  # [s] that results are means over
    uncertainties: Mapping[str, Any] = field(default_factory=dict)  # that the pipeline declares
    tables: Mapping[str, Settings] = field(default_factory=dict)
    is_simulated: bool = False


def apply_diagnoses(
    tracks: Mapping[str, Diagnosable], diagnoses: Mapping[str, Diagnosis], of_run: RunEvidence
) -> dict[str, TrackResult]:
    """Return the results of all tracks with the findings of all diagnoses; those of what was not estimated only by
    some."""
    whole = {name: _evidence(name, track, of_run) for name, track in tracks.items() if track.result.samples}
    findings = dict[str, Mapping[str, Diagnosed]]()

    @cache  # a diagnosis is given what several before it were given
    def with_all(label: str, names: tuple[str, ...]) -> TrackResult:
        """Return the result of a track with its findings by these diagnoses."""
        if not names:
            return tracks[label].result
        *earlier, name = names
        return with_findings(with_all(label, tuple(earlier)), tracks[label].model, name, findings[name][label])

    def judged(label: str, names: Iterable[str]) -> TrackResult:
        """Return the result of a track with whatever these diagnoses have found of it."""
        return with_all(label, tuple(name for name in names if label in findings[name]))

    for name, before in _order(tuple(diagnoses.items())):
        diagnosis = diagnoses[name]
        known = [track for track in whole.values() if diagnosis.lost or np.isfinite(track.values).all()]
        evidence = [_with_uncertainties(track, judged(track.name, before)) for track in known]
        findings[name] = _findings(name, diagnosis, evidence) if evidence else {}
    return {label: judged(label, findings) for label in tracks}


@lru_cache(maxsize=4)  # each record of a folder asks
def _order(by_name: tuple[tuple[str, Diagnosis], ...]) -> list[tuple[str, list[str]]]:
    """Return the order of diagnoses."""
    return diagnosis_order(dict(by_name))


def diagnosis_order(diagnoses: Mapping[str, Diagnosis]) -> list[tuple[str, list[str]]]:
    """Return the names of diagnoses in the order in which they run, each with those whose findings it is given.

    Those are what it states, and what they state in turn. Raises PluginError where some wait for each other.
    """
    early = {name for name, diagnosis in diagnoses.items() if Diagnosis.EVERY_OTHER not in diagnosis.after}
    stated = {name: set(diagnosis.after) & set(diagnoses) for name, diagnosis in diagnoses.items()}
    for name in set(diagnoses) - early:
        stated[name] |= early
    sorter = TopologicalSorter(stated)
    try:
        sorter.prepare()
    except CycleError as error:
        raise PluginError(f"diagnoses wait for each other: {', '.join(map(repr, error.args[1]))}") from error
    order = list[str]()
    before = dict[str, set[str]]()
    while sorter.is_active():
        ready = set(sorter.get_ready())
        for name in (name for name in diagnoses if name in ready):
            before[name] = stated[name].union(*(before[other] for other in stated[name]))
            order.append(name)
        sorter.done(*ready)
    return [(name, [other for other in order if other in before[name]]) for name in order]


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
    return replace(
        result,
        surface=result.surface.diagnosed(cause, finding.surface),
        budget=(*result.budget, *_rows(result, names, name, finding)),
        flags=(
            *(replace(flag, effects={}) if flag.code in finding.settles else flag for flag in result.flags),
            *(replace(flag, causes=(cause,)) if flag.causes is None else flag for flag in finding.flags),
        ),
        conditions=_open_facts((*result.conditions, *_with_derived(finding.conditions, model, result)), finding.known),
        diagnoses=dict(result.diagnoses) | ({name: finding.table} if finding.table else {}),
    )


def _with_uncertain_values(result: TrackResult, model: ContactModel, cause: str, finding: Diagnosed) -> TrackResult:
    """Return a result with what a finding adds to the uncertainty of parameters and of what follows from them."""
    parameters, free = dict(result.parameters), result.free
    for i, parameter in enumerate(model.parameters):
        key = parameter.name
        if key not in free:
            continue
        by_sources = _caused(parameters[key], finding, key, [abs(float(term.shifts[i])) for term in finding.sources])
        parameters[key] = by_sources.diagnosed(
            cause,
            finding.terms.get(key, 0.0),
            key in finding.unknown,
            finding.biases.get(key),
            finding.left.get(key),
        )
    derived = tuple(_derived(value, model, result, finding, cause) for value in result.derived)
    return replace(result, parameters=parameters, derived=derived)


def _open_facts(conditions: Sequence[Condition], known: frozenset[str]) -> tuple[Condition, ...]:
    """Return the conditions without facts that a record measures, one of each fact."""
    return joined([one for one in conditions if one.fact not in known])


def _with_derived(conditions: Sequence[Condition], model: ContactModel, result: TrackResult) -> Iterator[Condition]:
    """Conditions with the shifts of what follows from the parameters."""
    names = [parameter.name for parameter in model.parameters]
    values = [result.parameters[name].value for name in names]
    derived = {value.name for value in result.derived}
    gradients = (
        {m.name: m.gradient for m in model.material(values) if m.name in derived} if derived and conditions else {}
    )
    for one in conditions:
        moved = [one.shifts.get(name, 0.0) for name in names]
        more = {name: float(np.array(gradient) @ np.array(moved)) for name, gradient in gradients.items()}
        yield replace(one, shifts={**one.shifts, **{name: shift for name, shift in more.items() if shift}})


def _caused(found: UncertainValue, finding: Diagnosed, name: str, shares: Iterable[float]) -> UncertainValue:
    """With a share of each source of a finding, and with the delay that the value looks like."""
    for term, share in zip(finding.sources, shares, strict=True):
        found = found.diagnosed(term.cause, share)
    return replace(found, per_shear=finding.delays[name]) if name in finding.delays else found


def _rows(result: TrackResult, names: Sequence[str], name: str, finding: Diagnosed) -> Iterator[BudgetRow]:
    """Yield the rows of a finding in the budget."""
    for term in finding.sources:
        yield term.row({key: result.parameters[key].value for key in names})
    terms = dict(finding.terms)
    for key, bias in finding.biases.items():
        terms[key] = math.hypot(terms.get(key, 0.0), bias.shift)
    shares = {key: share for key, share in terms.items() if share > 0 and key in result.free}
    if shares:
        yield BudgetRow(name, None, "", {key: result.parameters[key].effect(share) for key, share in shares.items()})


def _derived(
    value: DerivedValue, model: ContactModel, result: TrackResult, finding: Diagnosed, cause: str
) -> DerivedValue:
    names = [parameter.name for parameter in model.parameters]
    values = [result.parameters[name].value for name in names]
    material = next(m for m in model.material(values) if m.name == value.name)
    gradient = np.array(material.gradient)
    share = material.std([finding.terms.get(name, 0.0) for name in names])
    shifts = [finding.biases[name].shift if name in finding.biases else 0.0 for name in names]
    share = math.hypot(share, sum(slope * shift for slope, shift in zip(material.gradient, shifts, strict=True)))
    touched = any(slope and name in finding.unknown for name, slope in zip(names, material.gradient, strict=True))
    shares = [abs(float(gradient @ term.shifts)) for term in finding.sources]
    return replace(value, found=_caused(value.found, finding, value.name, shares).diagnosed(cause, share, touched))


def _evidence(name: str, track: Diagnosable, of_run: RunEvidence) -> TrackEvidence:
    found = [track.result.parameters[parameter.name] for parameter in track.model.parameters]
    record, settings = track.record, of_run.settings
    time, force, position = record.keeper.air
    evidence = TrackEvidence(
        name,
        track.model,
        track.estimator,
        settings.tip_mass,
        read_only(record.keeper.kept),
        time,
        force,
        position,
        np.array([f.value for f in found]),
        np.array([f.std for f in found]),
        np.array([f.combined for f in found]),
        track.result.surface.value,
        record.report,
        of_run.tables,
        _ending(track, of_run),
        track.result.parameters,
        record.keeper.air_after,
    )
    return read_only(evidence)


def _with_uncertainties(evidence: TrackEvidence, result: TrackResult) -> TrackEvidence:
    """Return the evidence with what the diagnoses before have made of the uncertainty of each parameter."""
    combined = np.array([result.parameters[parameter.name].combined for parameter in evidence.model.parameters])
    return read_only(
        replace(evidence, combined=combined, found=result.parameters, surface_uncertainty=result.surface.combined)
    )


def _ending(track: Diagnosable, of_run: RunEvidence) -> TrackEnd | None:
    tail = track.record.tail
    if tail is None:
        return None
    average = of_run.average if track.estimator.online else math.inf
    included = {*track.record.details.get("included", ()), *(["timing"] if track.record.timing_included else [])}
    record, run = track.record, of_run
    return TrackEnd(
        read_only(tail), read_only(tail.last(average)), run.settings, run.report, run.uncertainties, record.held,
        frozenset(included), run.average, record.tracked, record.samples, record.is_sweep, run.is_simulated,
    )  # fmt: skip
