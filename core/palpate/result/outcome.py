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
from palpate.result.flags import alignment_flags, flag, timing_flags, track_flags
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


def finite(value: Any) -> Any:
    """A number as JSON can hold it: null where it is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


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

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "model": self.model,
            "estimator": self.estimator,
            "samples": self.samples,
            "parameters": {name: found.table() for name, found in self.parameters.items()},
            "surface": self.surface.table(),
            "force_rms": finite(self.force_rms),
            "nis": finite(self.nis),
            "flags": list(self.flags),
            "seconds_per_sample": self.seconds_per_sample,
        }


def track_result(
    name: str,
    model: ContactModel,
    record: TrackRecord,
    report: AlignmentReport,
    settings: AlignmentSettings,
    average: float,
) -> TrackResult:
    """The result of one track: means over the last `average` seconds of its estimates, and its flags."""
    model_name, _, estimator_name = name.partition("/")
    flags = list(track_flags(record, model, report, average))
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
        rest = tail.unsettled(tail.values, record.tracked)
        timing = timing_uncertainty(settings)
        flags += timing_flags(model, values, timing)
        shifts = model.delay_shift(list(values))
        terms = systematic_terms(model, last, timing, settings, report)
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
        way = float(tail.unsettled(tail.surface[:, None], record.tracked)[0]) / math.sqrt(3)
        surface = Found(float(last.surface.mean()), float(last.surface_std[-1]), "m", way)
        rms = last.force_rms(settings.tip_mass or 0.0)
        seen = last.nis[last.nis == last.nis]
        nis = float(seen.mean()) if len(seen) else nothing
    per_sample = record.seconds / record.samples if record.samples else 0.0
    return TrackResult(
        model_name, estimator_name, record.samples, parameters, surface, rms, nis, tuple(flags), per_sample
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
