"""What a run found out: the contents of ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate.alignment import AlignmentReport, AlignmentSettings
from palpate.contact import ContactModel
from palpate.estimation import Status
from palpate.result.budget import systematic_terms
from palpate.result.flags import alignment_flags, flag, timing_flags, track_flags, validity_flags
from palpate.result.record import TrackRecord


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


def derived_values(model: ContactModel, parameters: Mapping[str, Found]) -> tuple[Derived, ...]:
    """What the parameters found say of the material, with their uncertainties carried over as uncorrelated.

    A value that is a parameter itself is not repeated.
    """
    found = [parameters[parameter.name] for parameter in model.parameters]
    derived = []
    for value in model.material([f.value for f in found]):
        if value.name in parameters:
            continue
        std, settling = value.std([f.std for f in found]), value.std([f.settling for f in found])
        known = any(f.systematic is not None for f in found)
        systematic = value.std([f.systematic or 0.0 for f in found]) if known else 0.0
        carried = Found(value.value, std, value.unit, settling, systematic or None)
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
    tail = record.tail
    nothing = float("nan")
    usable = tail is not None and not record.marks[Status.DIVERGED]
    if tail is None or not usable:
        empty = {p.name: Found(nothing, nothing, p.unit) for p in model.parameters}
        surface, rms, nis = Found(nothing, nothing, "m"), nothing, nothing
        parameters = empty
    else:
        last = tail.since(float(tail.time[-1]) - average)
        values, std = last.values.mean(axis=0), last.std[-1]
        # What is left of the way lies between nothing and this: a rectangular distribution.
        tracked = record.tracked if online else 0.0
        rest = tail.unsettled(tail.values, tracked)
        timing = timing_uncertainty(settings)
        # A fit that looks for the delay itself has the declared timing in its std already.
        added = None if record.details.get("timing_included") else timing
        flags += timing_flags(model, values, timing)
        shifts = model.delay_shift(list(values))
        terms = systematic_terms(model, last, added, settings, report)
        parameters = {
            p.name: Found(
                float(value),
                float(deviation),
                p.unit,
                float(settling),
                math.hypot(*terms[p.name].values()) if terms[p.name] else None,
                terms[p.name],
                float(value / abs(shift)) if shift else None,
            )
            for p, value, deviation, settling, shift in zip(
                model.parameters, values, std, rest / math.sqrt(3), shifts, strict=True
            )
        }
        way = float(tail.unsettled(tail.surface[:, None], tracked)[0]) / math.sqrt(3)
        surface = Found(float(last.surface.mean()), float(last.surface_std[-1]), "m", way)
        flags += validity_flags(model, last)
        rms = last.force_rms(settings.tip_mass or 0.0)
        seen = last.nis[last.nis == last.nis]
        nis = float(seen.mean()) if len(seen) else nothing
    per_sample = record.seconds / record.samples if record.samples else 0.0
    derived = derived_values(model, parameters)
    return TrackResult(
        model_name,
        estimator_name,
        record.samples,
        parameters,
        surface,
        rms,
        nis,
        tuple(flags),
        per_sample,
        derived,
        record.details,
    )


def timing_uncertainty(settings: AlignmentSettings) -> float | None:
    """Standard uncertainty [s] of the time between force and motion; None where it is not declared for both sides."""
    motion = settings.velocity or settings.position
    if settings.force.uncertainty is None and motion.uncertainty is None:
        return None
    return math.hypot(settings.force.uncertainty or 0.0, motion.uncertainty or 0.0)


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
