"""What one track found, as it stands in ``result.json``."""

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
    """What one track found."""

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
    details: Mapping[str, Any] = field(default_factory=dict)  # what the estimator says beyond its numbers
    report: FitReport | None = None  # of an offline fit that was made
    budget: tuple[BudgetRow, ...] = ()  # every source with its effect on each parameter
    diagnoses: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # what diagnoses say, by name
    verdict: str = "good"  # that of its elasticity; without one the worst of its values with a number
    immaterial: tuple[Flag, ...] = ()  # that can move no value beyond its uncertainty
    conditions: tuple[Condition, ...] = ()  # open facts; once judged, those that matter
    comparison: TrackComparison | None = None  # of a run with several tracks

    @property
    def usable(self) -> bool:
        """True if its numbers may be used at all."""
        return self.verdict != "invalid"

    def judged(self, registry: Registry, of_record: Sequence[Flag]) -> TrackResult:
        """Return the result with the flags that matter, and its verdicts; flags of the record (judged) concern every
        track."""
        free = self.free
        flags = [*self.flags, *self._without_value(registry)]
        weighed = weigh(flags, free, registry, self.conditions)
        every = verdict(of_record)
        common = every if every in ("doubtful", "invalid") else "good"
        by_value = {name: _worse(common, own) for name, own in weighed.by_value.items()}
        row = _of_row(by_value) or verdict_word(verdict((*of_record, *weighed.findings)))
        of_all = {**free, **{value.name: value.found for value in self.derived}}
        derived = weigh((), {value.name: value.found for value in self.derived}, registry, self.conditions).by_value
        follows = {name: _worse(_doubt(row), own) for name, own in derived.items()}
        return replace(
            self,
            parameters={
                name: replace(value, verdict=by_value.get(name, common)) for name, value in self.parameters.items()
            },
            derived=tuple(
                replace(value, found=replace(value.found, verdict=follows[value.name])) for value in self.derived
            ),
            flags=weighed.findings,
            immaterial=weighed.immaterial,
            conditions=tuple(one for one in self.conditions if one.matters(of_all)),
            verdict=row if row == "invalid" else _chief({**follows, **by_value}, row),
        )

    @property
    def free(self) -> Mapping[str, UncertainValue]:
        """The parameters that were estimated, and not held fixed."""
        unknowns = self.report.unknowns if self.report else {}
        return {n: value for n, value in self.parameters.items() if n not in unknowns or unknowns[n].free}

    @property
    def _every(self) -> Mapping[str, UncertainValue]:
        """All values, those that follow from the parameters too."""
        return {**self.parameters, **{value.name: value.found for value in self.derived}}

    def against(self, truth: Mapping[str, float]) -> TrackResult:
        """Return the result with the distances of its values from a truth [SI], where it is compared."""
        if self.comparison is None or not self.usable:
            return self
        return replace(self, comparison=replace(self.comparison, distances=distances(self._every, truth)))

    def _without_value(self, registry: Registry) -> Iterator[Flag]:
        """Yield a track without any number, of which nothing else says why."""
        lost = self.parameters and not any(math.isfinite(value.value) for value in self.parameters.values())
        if lost and verdict(registry.judged(self.flags)) != "invalid":
            yield Flag("no-estimate", "the track never had a value")

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "model": self.model,
            "estimator": self.estimator,
            "verdict": self.verdict,
            "samples": self.samples,
            "parameters": {name: found.table() for name, found in self.parameters.items()},
            "derived": {value.name: value.table() for value in self.derived},
            "surface": self.surface.table(),
            "force_rms": finite(self.force_rms),
            "nis": finite(self.nis),
            "budget": [finite_tree(asdict(row)) for row in self.budget],
            "flags": [flag.table() for flag in self.flags],
            "conditions": [one.table(self._every) for one in self.conditions],
            **({"immaterial": [flag.table() for flag in self.immaterial]} if self.immaterial else {}),
            "seconds_per_sample": self.seconds_per_sample,
            **({"comparison": self.comparison.table()} if self.comparison else {}),
            **({"fit": finite_tree(self.report.table())} if self.report else {}),
            **({"details": finite_tree(self.details)} if self.details else {}),
            **({"diagnoses": finite_tree(self.diagnoses)} if self.diagnoses else {}),
        }


def _chief(by_value: Mapping[str, str], worst: str) -> str:
    """Return the verdict of the elasticity, a doubt where that alone is void; without one the worst of all."""
    word = by_value.get("elasticity", worst)
    return "doubtful" if word == "invalid" else word


def _of_row(by_value: Mapping[str, str]) -> str:
    """Of a track: the worst of the values that have a number; where none has, why not; empty without values."""
    settled = [own for own in by_value.values() if own in VERDICTS]
    if not settled:
        return next(iter(by_value.values()), "")
    if all(own == "invalid" for own in by_value.values()):
        return "invalid"
    return max(map(_doubt, settled), key=_rank)


def _doubt(word: str) -> str:
    """What a verdict of one value is worth for others: a doubt where that value is void."""
    return "doubtful" if word == "invalid" else word if word in VERDICTS else "good"


def _rank(word: str) -> int:
    """Return the higher the worse; a value without a number counts as a good one."""
    return VERDICTS.index(word) if word in VERDICTS else 0


def _worse(common: str, own: str) -> str:
    """Return the verdict of a value of its own, on a record of another."""
    if common == "invalid" or own in VERDICTS:
        return max(common, own, key=_rank)
    return own


class TrackSummary(Protocol):
    """What the function of a `palpate.Summary` answers for each track: it takes in blocks and has the last word."""

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block; the same comes of it however a record is cut into blocks."""
        ...

    def of(self, result: TrackResult, model: ContactModel, is_sweep: bool) -> TrackResult:
        """What the result becomes when the run has ended; `is_sweep`: the tip went along the surface."""
        ...
