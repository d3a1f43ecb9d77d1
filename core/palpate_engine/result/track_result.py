"""The result of one track, as in ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Protocol

from palpate.contact import ContactModel
from palpate.estimation import Estimates, Samples
from palpate.evidence.condition import Condition
from palpate.evidence.uncertain_value import DerivedValue, UncertainValue, finite, finite_tree
from palpate.fit_report import BudgetRow, FitReport
from palpate.flags import VERDICTS, Flag, verdict, verdict_word
from palpate.registry import Registry

from palpate_engine.result.materiality import weigh
from palpate_engine.result.track_comparison import TrackComparison, distances


@dataclass(frozen=True)
class TrackResult:
    """The result of one track: its values with their uncertainties, flags and verdicts."""

    model: str
    estimator: str
    samples: int
    parameters: Mapping[str, UncertainValue]
    surface: UncertainValue
    force_rms: float  # [N]
    nis: float  # mean over the averaging window at the end
    flags: tuple[Flag, ...]
    seconds_per_sample: float
    derived: tuple[DerivedValue, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)  # of the estimator, beyond its numbers
    report: FitReport | None = None  # of an offline fit that was made
    budget: tuple[BudgetRow, ...] = ()  # every source with its effect on each parameter
    diagnoses: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # tables of diagnoses, by name
    verdict: str = "good"  # that of its elasticity; without one the worst of its values with a number
    immaterial: tuple[Flag, ...] = ()  # that can move no value beyond its uncertainty
    conditions: tuple[Condition, ...] = ()  # open facts; once judged, those that matter
    comparison: TrackComparison | None = None  # of a run with several tracks

    @property
    def usable(self) -> bool:
        """True if its numbers may be used at all."""
        return self.verdict != "invalid"

    def judged(self, registry: Registry, of_record: Sequence[Flag]) -> TrackResult:
        """Return the result with the flags that matter, and its verdicts.

        Flags of the record, judged already, concern every track.
        """
        # Each parameter by its flags, open facts and uncertainty, and by the record.
        free = self.free
        weighed = weigh([*self.flags, *self._no_estimate_flag(registry)], free, registry, self.conditions)
        record_word = verdict(of_record)
        record_verdict = record_word if record_word in ("doubtful", "invalid") else "good"
        by_parameter = {name: _worse(record_verdict, value_verdict) for name, value_verdict in weighed.by_value.items()}
        track_verdict = _track_verdict(by_parameter) or verdict_word(verdict((*of_record, *weighed.findings)))

        # Each value that follows from the parameters, no better than the track.
        derived_values = {value.name: value.found for value in self.derived}
        by_derived = weigh((), derived_values, registry, self.conditions).by_value
        by_derived = {
            name: _worse(_as_doubt(track_verdict), value_verdict) for name, value_verdict in by_derived.items()
        }

        parameters = {
            name: replace(value, verdict=by_parameter.get(name, record_verdict))
            for name, value in self.parameters.items()
        }
        derived = [replace(value, found=replace(value.found, verdict=by_derived[value.name])) for value in self.derived]
        every_value = {**free, **derived_values}
        if track_verdict != "invalid":
            track_verdict = _chief_verdict({**by_derived, **by_parameter}, track_verdict)
        return replace(
            self,
            parameters=parameters,
            derived=tuple(derived),
            flags=weighed.findings,
            immaterial=weighed.immaterial,
            conditions=tuple(condition for condition in self.conditions if condition.matters(every_value)),
            verdict=track_verdict,
        )

    @property
    def free(self) -> Mapping[str, UncertainValue]:
        """The parameters that were estimated, and not held fixed."""
        unknowns = self.report.unknowns if self.report else {}
        fixed = {name for name, unknown in unknowns.items() if not unknown.free}
        return {name: value for name, value in self.parameters.items() if name not in fixed}

    @property
    def _all_values(self) -> Mapping[str, UncertainValue]:
        """Parameters and values that follow from them."""
        return {**self.parameters, **{value.name: value.found for value in self.derived}}

    def against(self, truth: Mapping[str, float]) -> TrackResult:
        """Return the result with the distances of its values from a truth [SI], where it is compared."""
        if self.comparison is None or not self.usable:
            return self
        return replace(self, comparison=replace(self.comparison, distances=distances(self._all_values, truth)))

    def _no_estimate_flag(self, registry: Registry) -> Iterator[Flag]:
        """Yield a flag for a track without any number, unless another flag says why."""
        has_number = any(math.isfinite(value.value) for value in self.parameters.values())
        if self.parameters and not has_number and verdict(registry.judged(self.flags)) != "invalid":
            yield Flag("no-estimate", "the track never had a value")

    def table(self) -> dict[str, Any]:
        """Return the table of the track in ``result.json``."""
        return {
            "model": self.model,
            "estimator": self.estimator,
            "verdict": self.verdict,
            "samples": self.samples,
            "parameters": {name: value.table() for name, value in self.parameters.items()},
            "derived": {value.name: value.table() for value in self.derived},
            "surface": self.surface.table(),
            "force_rms": finite(self.force_rms),
            "nis": finite(self.nis),
            "budget": [finite_tree(asdict(row)) for row in self.budget],
            "flags": [flag.table() for flag in self.flags],
            "conditions": [condition.table(self._all_values) for condition in self.conditions],
            **({"immaterial": [flag.table() for flag in self.immaterial]} if self.immaterial else {}),
            "seconds_per_sample": self.seconds_per_sample,
            **({"comparison": self.comparison.table()} if self.comparison else {}),
            **({"fit": finite_tree(self.report.table())} if self.report else {}),
            **({"details": finite_tree(self.details)} if self.details else {}),
            **({"diagnoses": finite_tree(self.diagnoses)} if self.diagnoses else {}),
        }


def _chief_verdict(by_value: Mapping[str, str], worst: str) -> str:
    """Return the verdict of the elasticity, a doubt where that alone is void; without one the worst of all."""
    chief = by_value.get("elasticity", worst)
    return "doubtful" if chief == "invalid" else chief


def _track_verdict(by_value: Mapping[str, str]) -> str:
    """Return the verdict of a track: the worst of the values with a number.

    Where no value has a number, the word of the first; empty without values.
    """
    verdicts = [value_verdict for value_verdict in by_value.values() if value_verdict in VERDICTS]
    if not verdicts:
        return next(iter(by_value.values()), "")
    if all(value_verdict == "invalid" for value_verdict in by_value.values()):
        return "invalid"
    return max(map(_as_doubt, verdicts), key=_rank)


def _as_doubt(value_verdict: str) -> str:
    """Return the verdict that one value gives to others: a doubt where it is void, good where it has no number."""
    if value_verdict == "invalid":
        return "doubtful"
    return value_verdict if value_verdict in VERDICTS else "good"


def _rank(value_verdict: str) -> int:
    """Return the rank of a verdict, the higher the worse; a value without a number counts as a good one."""
    return VERDICTS.index(value_verdict) if value_verdict in VERDICTS else 0


def _worse(record_verdict: str, value_verdict: str) -> str:
    """Return the word of a value on a record with a verdict: the worse of both.

    A value without a number keeps its word, unless the record is invalid.
    """
    if record_verdict == "invalid" or value_verdict in VERDICTS:
        return max(record_verdict, value_verdict, key=_rank)
    return value_verdict


class TrackSummary(Protocol):
    """A summary of a track, made by the function of a `palpate.Summary`: it takes in blocks and has the last word."""

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block; the same comes of it however a record is cut into blocks."""
        ...

    def of(self, result: TrackResult, model: ContactModel, is_sweep: bool) -> TrackResult:
        """Return the result at the end of the run; `is_sweep`: the tip went along the surface."""
        ...
