"""What a run found out: the contents of ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.alignment import AlignmentReport, AlignmentSettings
from palpate.contact import ContactModel
from palpate.estimation import Status
from palpate.result.budget import systematic_terms
from palpate.result.flags import alignment_flags, compliance_flags, flag, timing_flags, track_flags, validity_flags
from palpate.result.record import Tail, TrackRecord
from palpate.result.timing import delay_shifts, is_viscous, timing_uncertainty


@dataclass(frozen=True)
class Found:
    """A value with its uncertainty [SI]."""

    value: float
    std: float  # standard deviation, as the estimator believes it
    unit: str
    settling: float = 0.0  # standard uncertainty from an estimate that has not come to rest
    systematic: float | None = None  # standard uncertainty from timing, mass and tare; None where none is known
    budget: Mapping[str, float] = field(default_factory=dict)  # its terms by name
    per_shear: float | None = None  # [s] shift of timing that would explain the value: eta/G

    @property
    def combined(self) -> float:
        """Standard uncertainty of all parts together."""
        return math.hypot(self.std, self.settling, self.systematic or 0.0)

    def table(self) -> dict[str, Any]:
        """As in ``result.json``; what is not a finite number becomes null."""
        known: dict[str, Any] = {"value": self.value, "std": self.std, "unit": self.unit, "settling": self.settling}
        if self.systematic is not None:
            known["systematic"] = self.systematic
        known["combined"] = self.combined
        known |= {f"systematic_{term}": share for term, share in self.budget.items()}
        if self.per_shear is not None:
            known["equivalent_delay"] = self.per_shear
        return {key: finite(value) for key, value in known.items()}


@dataclass(frozen=True)
class Derived:
    """Elasticity or viscosity that follows from a model's parameters, which are something else [SI]."""

    name: str
    found: Found
    caveat: str  # what has to hold for it to be a property of the material

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return self.found.table() | {"caveat": self.caveat}


def derived_values(
    model: ContactModel, parameters: Mapping[str, Found], shifts: Sequence[float], timing: float | None
) -> tuple[Derived, ...]:
    """What the parameters found say of the material, with their uncertainties carried over as uncorrelated.

    Timing is one cause for all: its shares, `shifts` (k,) per second, are added with their signs. A value that is a
    parameter itself is not repeated.
    """
    found = [parameters[parameter.name] for parameter in model.parameters]
    derived = []
    for value in model.material([f.value for f in found]):
        if value.name in parameters:
            continue
        std, settling = value.std([f.std for f in found]), value.std([f.settling for f in found])
        shift = abs(sum(slope * by for slope, by in zip(value.gradient, shifts, strict=True)))
        budget = {"timing": shift * timing} if shift and timing is not None else {}
        for cause in {cause: None for f in found for cause in f.budget if cause != "timing"}:
            budget[cause] = value.std([f.budget.get(cause, 0.0) for f in found])
        systematic = math.hypot(*budget.values()) if budget else None
        per_shear = value.value / shift if shift and value.name == "viscosity" else None
        carried = Found(value.value, std, value.unit, settling, systematic, budget, per_shear)
        derived.append(Derived(value.name, carried, value.caveat))
    return tuple(derived)


def finite(value: Any) -> Any:
    """A number as JSON can hold it: null where it is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finite_tree(value: Any) -> Any:
    """Plain data with null for every number that is not finite."""
    if isinstance(value, Mapping):
        return {key: finite_tree(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite_tree(inner) for inner in value]
    return finite(value)


@dataclass(frozen=True)
class TrackResult:
    """What one track found."""

    model: str
    estimator: str
    samples: int
    parameters: Mapping[str, Found]
    surface: Found
    force_rms: float  # [N]
    nis: float  # mean over the averaging window at the end
    flags: tuple[str, ...]
    seconds_per_sample: float
    derived: tuple[Derived, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)  # what the estimator says beyond its numbers

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "model": self.model,
            "estimator": self.estimator,
            "samples": self.samples,
            "parameters": {name: found.table() for name, found in self.parameters.items()},
            "derived": {value.name: value.table() for value in self.derived},
            "surface": self.surface.table(),
            "force_rms": finite(self.force_rms),
            "nis": finite(self.nis),
            "flags": list(self.flags),
            "seconds_per_sample": self.seconds_per_sample,
            **({"details": finite_tree(self.details)} if self.details else {}),
        }


@dataclass(frozen=True)
class _Numbers:
    """What the latest estimates of a track come to."""

    parameters: Mapping[str, Found]
    surface: Found
    force_rms: float
    nis: float


def track_result(
    name: str,
    model: ContactModel,
    record: TrackRecord,
    report: AlignmentReport,
    settings: AlignmentSettings,
    average: float,
    online: bool = True,
) -> TrackResult:
    """The result of one track: means over the last `average` seconds of its estimates, and its flags.

    Estimates of an offline estimator are constant and hold for every sample that it used.
    """
    average = average if online else math.inf
    model_name, _, estimator_name = name.partition("/")
    flags = list(track_flags(record, model, report, average, online))
    tail, shifts = record.tail, np.zeros(len(model.parameters))
    # A fit that looks for the delay itself has the declared timing in its std already.
    timing = None if record.details.get("timing_included") else timing_uncertainty(settings)
    if tail is None or record.marks[Status.DIVERGED]:
        numbers = _no_numbers(model)
    else:
        last = tail.since(float(tail.time[-1]) - average)
        shifts = delay_shifts(model, tail, last, last.values.mean(axis=0))
        flags += timing_flags(model, last.values.mean(axis=0), shifts, timing_uncertainty(settings))
        flags += validity_flags(model, last)
        numbers = _numbers(model, record, tail, last, shifts, timing, report, settings, online)
        shares = {
            name: f.budget.get("compliance", 0.0) / abs(f.value or math.inf) for name, f in numbers.parameters.items()
        }
        flags += compliance_flags(shares, settings.series_stiffness)
    return TrackResult(
        model_name,
        estimator_name,
        record.samples,
        numbers.parameters,
        numbers.surface,
        numbers.force_rms,
        numbers.nis,
        tuple(flags),
        record.seconds / record.samples if record.samples else 0.0,
        derived_values(model, numbers.parameters, shifts.tolist(), timing),
        record.details,
    )


def _no_numbers(model: ContactModel) -> _Numbers:
    nothing = float("nan")
    parameters = {parameter.name: Found(nothing, nothing, parameter.unit) for parameter in model.parameters}
    return _Numbers(parameters, Found(nothing, nothing, "m"), nothing, nothing)


def _numbers(
    model: ContactModel,
    record: TrackRecord,
    tail: Tail,
    last: Tail,
    shifts: NDArray[np.float64],
    timing: float | None,
    report: AlignmentReport,
    settings: AlignmentSettings,
    online: bool,
) -> _Numbers:
    values, std = last.values.mean(axis=0), last.std[-1]
    # What is left of the way to rest lies between nothing and this: a rectangular distribution.
    tracked = record.tracked if online else 0.0
    settling = tail.unsettled(tail.values, tracked) / math.sqrt(3)
    way = float(tail.unsettled(tail.surface[:, None], tracked)[0]) / math.sqrt(3)
    terms = systematic_terms(model, last, shifts, timing, settings, report)
    parameters = {}
    for i, (parameter, shift) in enumerate(zip(model.parameters, shifts.tolist(), strict=True)):
        budget = terms[parameter.name]
        parameters[parameter.name] = Found(
            float(values[i]),
            float(std[i]),
            parameter.unit,
            float(settling[i]),
            math.hypot(*budget.values()) if budget else None,
            budget,
            float(values[i] / abs(shift)) if shift and is_viscous(parameter) else None,
        )
    surface = Found(float(last.surface.mean()), float(last.surface_std[-1]), "m", way)
    seen = last.nis[np.isfinite(last.nis)]
    nis = float(seen.mean()) if len(seen) else float("nan")
    return _Numbers(parameters, surface, last.force_rms(settings.tip_mass or 0.0), nis)


def stream_tables(report: AlignmentReport) -> dict[str, Any]:
    """The ``streams`` of ``result.json``."""
    names = ("samples", "invalid", "duplicates", "backwards", "gaps", "saturated")
    return {
        name: {"rate": health.rate, **{key: getattr(health, key) for key in names}}
        for name, health in report.streams.items()
    }


def record_flags(report: AlignmentReport, settings: AlignmentSettings, interrupted: str | None) -> tuple[str, ...]:
    """Flags that concern every track."""
    ended = [flag("interrupted", interrupted)] if interrupted else []
    return (*ended, *alignment_flags(report, settings))
