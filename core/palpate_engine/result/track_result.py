"""What one track found, as it stands in ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Protocol

from palpate.contact import ContactModel
from palpate.estimation import Estimates, Samples
from palpate.evidence.uncertain_value import DerivedValue, UncertainValue, finite, finite_tree
from palpate.fit_report import BudgetRow, FitReport
from palpate.flags import VERDICTS, Flag, Verdict, verdict
from palpate.registry import Registry

from palpate_engine.result.materiality import weigh


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
    verdict: Verdict = "good"  # worst severity of its flags and those of the record
    immaterial: tuple[Flag, ...] = ()  # that can move no value beyond its uncertainty

    @property
    def usable(self) -> bool:
        """Whether its numbers may be used at all."""
        return self.verdict != "invalid"

    def judged(self, registry: Registry, of_record: Sequence[Flag]) -> TrackResult:
        """The result with the flags that matter, and its verdicts; flags of the record (judged) concern every track."""
        free = self._free
        flags = [*self.flags, *self._without_value(registry)]
        weighed = weigh(flags, free, registry)
        every = verdict(of_record)
        common: Verdict = every if every in ("doubtful", "invalid") else "good"
        by_value = {name: max(common, own, key=VERDICTS.index) for name, own in weighed.by_value.items()}
        lost = bool(by_value) and all(own == "invalid" for own in by_value.values())
        worst = max(by_value.values(), default=common, key=VERDICTS.index)
        return replace(
            self,
            parameters={
                name: replace(value, verdict=by_value.get(name, common)) for name, value in self.parameters.items()
            },
            derived=tuple(replace(value, found=replace(value.found, verdict=worst)) for value in self.derived),
            flags=weighed.findings,
            immaterial=weighed.immaterial,
            verdict="invalid" if lost else verdict((*of_record, *weighed.findings)),
        )

    @property
    def _free(self) -> Mapping[str, UncertainValue]:
        """The parameters that were estimated, and not held fixed."""
        unknowns = self.report.unknowns if self.report else {}
        return {n: value for n, value in self.parameters.items() if n not in unknowns or unknowns[n].free}

    def _without_value(self, registry: Registry) -> Iterator[Flag]:
        """A track without any number, of which nothing else says why."""
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
            **({"immaterial": [flag.table() for flag in self.immaterial]} if self.immaterial else {}),
            "seconds_per_sample": self.seconds_per_sample,
            **({"fit": finite_tree(self.report.table())} if self.report else {}),
            **({"details": finite_tree(self.details)} if self.details else {}),
            **({"diagnoses": finite_tree(self.diagnoses)} if self.diagnoses else {}),
        }


class TrackSummary(Protocol):
    """What the function of a `palpate.Summary` answers for each track: it takes in blocks and has the last word."""

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block; the same comes of it however a record is cut into blocks."""
        ...

    def of(self, result: TrackResult, model: ContactModel, is_sweep: bool) -> TrackResult:
        """What the result becomes when the run has ended; `is_sweep`: the tip went along the surface."""
        ...
