"""What a record comes to: the numbers of a track at its end, and what concerns every track."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate.contact import ContactModel
from palpate.evidence.track_tail import Tail
from palpate.evidence.uncertain_value import UncertainValue, derived_values
from palpate.fit_report import BudgetRow
from palpate.flags import Flag
from palpate.vectors import Floats

from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.result.record_flags import alignment_flags, track_flags
from palpate_engine.result.track_record import TrackRecord
from palpate_engine.result.track_result import TrackResult
from palpate_engine.track_name import TrackName


@dataclass(frozen=True)
class _Numbers:
    """What the latest estimates of a track come to."""

    parameters: Mapping[str, UncertainValue]
    surface: UncertainValue
    force_rms: float
    nis: float


def _covariance(model: ContactModel, details: Mapping[str, Any]) -> Floats | None:
    """Covariance (k, k) of the parameters as the estimator reports it in its details; None where it does not."""
    table = details.get("covariance")
    if not isinstance(table, Mapping):
        return None
    matrix, names = np.array(table["matrix"], float), list(table["names"])
    whole = np.zeros((len(model.parameters),) * 2)
    places = [(i, names.index(p.name)) for i, p in enumerate(model.parameters) if p.name in names]
    for i, a in places:
        for j, b in places:
            whole[i, j] = matrix[a, b]
    return whole if np.isfinite(whole).all() else None


def track_result(
    name: TrackName,
    model: ContactModel,
    record: TrackRecord,
    report: AlignmentReport,
    settings: AlignmentSettings,
    average: float,
    online: bool = True,
) -> TrackResult:
    """Return the result of one track: means over the last `average` seconds of its estimates, and its flags.

    Estimates of an offline estimator are constant and hold for every sample that it used. Uncertainty is the
    estimator's own and that of settling; diagnoses add what else there is.
    """
    flags = track_flags(record, report)
    numbers, ends = _no_numbers(model), record.ends(average if online else math.inf)
    if ends is not None:
        numbers = _numbers(model, record, *ends, settings, online)
    return TrackResult(
        name.model,
        name.estimator,
        record.samples,
        numbers.parameters,
        numbers.surface,
        numbers.force_rms,
        numbers.nis,
        tuple(flags),
        record.seconds / record.samples if record.samples else 0.0,
        derived_values(model, numbers.parameters, _covariance(model, record.details)) if record.failure is None else (),
        record.details,
        record.report,
        budget=tuple(_own_budget(numbers.parameters)),
    )


def _own_budget(parameters: Mapping[str, UncertainValue]) -> Iterator[BudgetRow]:
    """What the estimator says itself, and what is left of the way to rest."""
    yield BudgetRow("estimator", None, "", {name: found.effect(found.std) for name, found in parameters.items()})
    if any(found.settling for found in parameters.values()):
        rest = {name: found.effect(found.settling) for name, found in parameters.items()}
        yield BudgetRow("settling", None, "", rest)


def _no_numbers(model: ContactModel) -> _Numbers:
    nothing = float("nan")
    parameters = {parameter.name: UncertainValue(nothing, nothing, parameter.unit) for parameter in model.parameters}
    return _Numbers(parameters, UncertainValue(nothing, nothing, "m"), nothing, nothing)


def _numbers(
    model: ContactModel, record: TrackRecord, tail: Tail, last: Tail, settings: AlignmentSettings, online: bool
) -> _Numbers:
    values, std = last.mean(last.values).tolist(), last.std[-1].tolist()
    # What is left of the way to rest lies between nothing and this: a rectangular distribution.
    tracked = record.tracked if online and not record.is_sweep else 0.0
    settling = (tail.unsettled(tail.values, tracked) / math.sqrt(3)).tolist()
    way = float(tail.unsettled(tail.surface[:, None], tracked)[0]) / math.sqrt(3)
    parameters = {
        p.name: UncertainValue(values[i], std[i], p.unit, settling[i]) for i, p in enumerate(model.parameters)
    }
    surface = UncertainValue(float(last.mean(last.surface)), float(last.surface_std[-1]), "m", way)
    seen = last.nis[np.isfinite(last.nis)]
    nis = float(seen.mean()) if len(seen) else float("nan")
    return _Numbers(parameters, surface, last.force_rms(settings.tip_mass or 0.0), nis)


def stream_tables(report: AlignmentReport) -> dict[str, Any]:
    """Return the ``streams`` of ``result.json``."""
    names = ("samples", "invalid", "duplicates", "backwards", "gaps", "saturated")
    return {
        name: {"rate": health.rate, **{key: getattr(health, key) for key in names}}
        for name, health in report.streams.items()
    }


def record_flags(report: AlignmentReport, settings: AlignmentSettings, interrupted: str | None) -> tuple[Flag, ...]:
    """Flags that concern every track."""
    ended = [Flag("interrupted", interrupted)] if interrupted else []
    return (*ended, *alignment_flags(report, settings))
