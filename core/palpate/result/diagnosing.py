"""What diagnoses say of the tracks of a run, and what becomes of the result by it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.contact import ContactModel
from palpate.diagnosis import Diagnosed, TrackEvidence
from palpate.estimation import Estimator
from palpate.extensions import Diagnosis, function_of
from palpate.fit_report import BudgetRow, Effect
from palpate.flags import Flag
from palpate.parts import Settings
from palpate.result.found import Derived
from palpate.result.outcome import TrackResult
from palpate.result.record import TrackRecord


@dataclass(frozen=True)
class Diagnosable:
    """A track with its record and what it found."""

    model: ContactModel
    estimator: Estimator
    record: TrackRecord
    result: TrackResult


def diagnosed(
    tracks: Mapping[str, Diagnosable],
    diagnoses: Mapping[str, Diagnosis],
    tip_mass: float | None,
    tables: Mapping[str, Settings],
) -> dict[str, TrackResult]:
    """The results of all tracks with the findings of all diagnoses; what was not estimated is not judged."""
    results = {name: track.result for name, track in tracks.items()}
    evidence = [_evidence(name, track, tip_mass, tables) for name, track in tracks.items() if _estimated(track.result)]
    if not evidence:
        return results
    for name, diagnosis in diagnoses.items():
        for label, finding in _findings(name, diagnosis, evidence).items():
            results[label] = with_findings(results[label], tracks[label].model, name, finding)
    return results


def _findings(name: str, diagnosis: Diagnosis, evidence: list[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """The findings of one diagnosis; what was estimated stays, whatever a stranger's function does."""
    try:
        return dict(function_of(diagnosis)(evidence))
    except Exception as error:
        flag = Flag("diagnosis-failed", f"{name}: {type(error).__name__}: {error}")
        return {track.name: Diagnosed((flag,)) for track in evidence}


def with_findings(result: TrackResult, model: ContactModel, name: str, finding: Diagnosed) -> TrackResult:
    """A result with the flags, uncertainties and numbers of a finding; derived values take them over."""
    cause = name.replace("-", "_")
    parameters = {
        key: found.diagnosed(cause, finding.terms.get(key, 0.0), key in finding.unknown, finding.biases.get(key))
        for key, found in result.parameters.items()
    }
    return replace(
        result,
        parameters=parameters,
        budget=(*result.budget, *_rows(result, name, finding)),
        derived=tuple(_derived(value, model, result, finding, cause) for value in result.derived),
        flags=(*result.flags, *finding.flags),
        diagnoses=dict(result.diagnoses) | ({name: finding.table} if finding.table else {}),
    )


def _rows(result: TrackResult, name: str, finding: Diagnosed) -> list[BudgetRow]:
    """The row of a finding in the budget."""
    terms = dict(finding.terms)
    for key, bias in finding.biases.items():
        terms[key] = math.hypot(terms.get(key, 0.0), bias.shift)
    shares = {key: share for key, share in terms.items() if share > 0 and key in result.parameters}
    if not shares:
        return []
    values = {key: result.parameters[key].value for key in shares}
    effects = {
        key: Effect(None, share, 100.0 * share / abs(values[key]) if values[key] else None)
        for key, share in shares.items()
    }
    return [BudgetRow(name, None, "", effects)]


def _derived(value: Derived, model: ContactModel, result: TrackResult, finding: Diagnosed, cause: str) -> Derived:
    names = [parameter.name for parameter in model.parameters]
    values = [result.parameters[name].value for name in names]
    material = next(m for m in model.material(values) if m.name == value.name)
    share = material.std([finding.terms.get(name, 0.0) for name in names])
    shifts = [finding.biases[name].shift if name in finding.biases else 0.0 for name in names]
    share = math.hypot(share, sum(slope * shift for slope, shift in zip(material.gradient, shifts, strict=True)))
    touched = any(slope and name in finding.unknown for name, slope in zip(names, material.gradient, strict=True))
    return replace(value, found=value.found.diagnosed(cause, share, touched))


def _estimated(result: TrackResult) -> bool:
    return bool(result.samples) and all(np.isfinite(found.value) for found in result.parameters.values())


def _evidence(name: str, track: Diagnosable, tip_mass: float | None, tables: Mapping[str, Settings]) -> TrackEvidence:
    found = [track.result.parameters[parameter.name] for parameter in track.model.parameters]
    time, force, position = track.record.keeper.air
    return TrackEvidence(
        name,
        track.model,
        track.estimator,
        tip_mass,
        track.record.keeper.kept,
        time,
        force,
        position,
        np.array([f.value for f in found]),
        np.array([f.std for f in found]),
        np.array([f.combined for f in found]),
        track.result.surface.value,
        track.record.report,
        tables,
    )
