"""The outcome of a record: the numbers of a track at its end, and the flags of every track."""

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
    """Numbers of a track by its latest estimates."""

    parameters: Mapping[str, UncertainValue]
    surface: UncertainValue
    force_rms: float
    nis: float


def _covariance(model: ContactModel, details: Mapping[str, Any]) -> Floats | None:
    """Return the covariance (k, k) of the parameters by the estimator's details, 0 of those that were held fixed.

    None where they have none.
    """
    table = details.get("covariance")
    if not isinstance(table, Mapping):
        return None
    free_covariance, free_names = np.array(table["matrix"], float), list(table["names"])
    free = [i for i, parameter in enumerate(model.parameters) if parameter.name in free_names]
    rows = [free_names.index(model.parameters[i].name) for i in free]
    covariance = np.zeros((len(model.parameters),) * 2)
    covariance[np.ix_(free, free)] = free_covariance[np.ix_(rows, rows)]
    return covariance if np.isfinite(covariance).all() else None


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
        model=name.model,
        estimator=name.estimator,
        samples=record.samples,
        parameters=numbers.parameters,
        surface=numbers.surface,
        force_rms=numbers.force_rms,
        nis=numbers.nis,
        flags=tuple(flags),
        seconds_per_sample=record.seconds / record.samples if record.samples else 0.0,
        derived=derived_values(model, numbers.parameters, _covariance(model, record.details))
        if record.failure is None
        else (),
        details=record.details,
        report=record.report,
        budget=tuple(_estimator_budget(numbers.parameters)),
    )


def _estimator_budget(parameters: Mapping[str, UncertainValue]) -> Iterator[BudgetRow]:
    """Yield the rows of the estimator's own uncertainty, and of what its values may still move."""
    yield BudgetRow("estimator", None, "", {name: value.effect(value.std) for name, value in parameters.items()})
    if any(value.settling for value in parameters.values()):
        effects = {name: value.effect(value.settling) for name, value in parameters.items()}
        yield BudgetRow("settling", None, "", effects)


def _no_numbers(model: ContactModel) -> _Numbers:
    """Return the numbers of a track without usable estimates: NaN."""
    parameters = {parameter.name: UncertainValue(math.nan, math.nan, parameter.unit) for parameter in model.parameters}
    return _Numbers(parameters, UncertainValue(math.nan, math.nan, "m"), math.nan, math.nan)


def _numbers(
    model: ContactModel, record: TrackRecord, tail: Tail, last: Tail, settings: AlignmentSettings, online: bool
) -> _Numbers:
    """Return the numbers of a track: means over its `last` seconds, and what the `tail` may still move."""
    values, std = last.mean(last.values).tolist(), last.std[-1].tolist()
    # A value moves on by anything between 0 and its estimated way to rest: a rectangular distribution, whose standard
    # deviation is its half width over sqrt(3) (GUM 4.3.7).
    tracked = record.tracked if online and not record.is_sweep else 0.0
    settling = (tail.unsettled(tail.values, tracked) / math.sqrt(3)).tolist()
    surface_settling = float(tail.unsettled(tail.surface[:, None], tracked)[0]) / math.sqrt(3)
    parameters: dict[str, UncertainValue] = {}
    for i, parameter in enumerate(model.parameters):
        parameters[parameter.name] = UncertainValue(values[i], std[i], parameter.unit, settling[i])
    surface = UncertainValue(float(last.mean(last.surface)), float(last.surface_std[-1]), "m", surface_settling)
    finite_nis = last.nis[np.isfinite(last.nis)]
    nis = float(finite_nis.mean()) if len(finite_nis) else math.nan
    return _Numbers(parameters, surface, last.force_rms(settings.tip_mass or 0.0), nis)


def stream_tables(report: AlignmentReport) -> dict[str, Any]:
    """Return the ``streams`` of ``result.json``."""
    names = ("samples", "invalid", "duplicates", "backwards", "gaps", "saturated")
    return {
        name: {"rate": health.rate, **{key: getattr(health, key) for key in names}}
        for name, health in report.streams.items()
    }


def record_flags(report: AlignmentReport, settings: AlignmentSettings, interrupted: str | None) -> tuple[Flag, ...]:
    """Return the flags that concern every track."""
    interruption = [Flag("interrupted", interrupted)] if interrupted else []
    return (*interruption, *alignment_flags(report, settings))
