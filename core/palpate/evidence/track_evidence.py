"""Evidence of every track when a run has ended, and the findings of diagnoses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.alignment_report import AlignmentReport
from palpate.alignment_settings import AlignmentSettings
from palpate.contact import ContactModel
from palpate.estimation import Estimator
from palpate.evidence.condition import Condition
from palpate.evidence.sample_store import SampleStore
from palpate.evidence.track_tail import Tail
from palpate.evidence.uncertain_value import Bias, UncertainValue
from palpate.fit_report import BudgetRow, Effect, FitReport
from palpate.flags import Flag
from palpate.parts import Settings
from palpate.vectors import Floats


@dataclass(frozen=True)
class TrackEnd:
    """The end of a track, of which its result is a mean, with declarations and findings of the record."""

    tail: Tail
    last: Tail  # of the tail, what the result is a mean of
    settings: AlignmentSettings
    report: AlignmentReport
    uncertainties: Mapping[str, Any]  # standard uncertainties that the pipeline declares, by key of the model
    held: frozenset[str]  # parameters that were held fixed
    included: frozenset[str]  # causes of uncertainty that the estimator's own standard deviation holds already
    average: float  # [s] that a result is a mean over, where it is one of the end
    tracked: float  # [s] in all
    samples: int  # tracked in all
    is_sweep: bool  # the tip went along the surface
    is_simulated: bool = False  # the force is that of a model, and not of a real contact


@dataclass(frozen=True)
class TrackEvidence:
    """The evidence for a diagnosis: the record of a track, and its estimates."""

    name: str  # "model/estimator"
    model: ContactModel
    estimator: Estimator
    tip_mass: float | None  # [kg]
    kept: SampleStore
    air_time: Floats  # (a,) [s] of samples before the first contact, at most 4096
    air_force: Floats  # (a,) [N]
    air_position: Floats  # (a,) [m]
    values: Floats  # (k,) the result's parameters [SI]
    std: Floats  # (k,) standard deviation of each, by the estimator
    combined: Floats  # (k,) combined standard uncertainty of each, with the findings of the diagnoses before
    surface: float  # [m]
    report: FitReport | None  # of an offline fit
    tables: Mapping[str, Settings] = field(default_factory=dict)  # of analyses, as the pipeline has them, by name
    ending: TrackEnd | None = None  # None where a track is judged without a run
    # By parameter, with the findings of the diagnoses before.
    found: Mapping[str, UncertainValue] = field(default_factory=dict)
    # (3, a) time [s], force [N], position [m] after the last contact, at most 4096 samples.
    air_after: Floats = field(default_factory=lambda: np.zeros((3, 0)))
    surface_uncertainty: float = 0.0  # [m] combined, with the findings of the diagnoses before


@dataclass(frozen=True)
class Term:
    """One source of uncertainty, with the shifts by one standard uncertainty; all its effects have one cause."""

    cause: str
    std: float
    unit: str
    shifts: Floats  # (k,) [SI] of each parameter, with signs
    declared: bool = True  # else a default

    def row(self, values: Mapping[str, float]) -> BudgetRow:
        """Return its row in the budget of these values (k,), by name."""
        effects = dict[str, Effect]()
        for (name, value), shift in zip(values.items(), self.shifts.tolist(), strict=True):
            effects[name] = Effect.of(value, abs(shift), shift / self.std if self.std else None)
        return BudgetRow(self.cause if self.declared else f"{self.cause} (not declared)", self.std, self.unit, effects)


@dataclass(frozen=True)
class Diagnosed:
    """The findings of a diagnosis on one track."""

    flags: tuple[Flag, ...] = ()
    terms: Mapping[str, float] = field(default_factory=dict)  # standard uncertainty [SI] that it adds, by parameter
    unknown: frozenset[str] = frozenset()  # parameters whose uncertainty cannot be determined
    table: Mapping[str, Any] = field(default_factory=dict)  # plain data for result.json
    # Known, by parameter: the value stays, its uncertainty holds all of the shift, a corrected value is added.
    biases: Mapping[str, Bias] = field(default_factory=dict)
    sources: tuple[Term, ...] = ()  # rows of the budget, each a cause of its own for all values
    delays: Mapping[str, float] = field(default_factory=dict)  # [s] that would explain a parameter or derived value
    settles: frozenset[str] = frozenset()  # codes of flags raised before whose effect this diagnosis accounts for
    left: Mapping[str, float] = field(default_factory=dict)  # in place of `terms` for a corrected value
    conditions: tuple[Condition, ...] = ()  # facts that the record cannot show and nobody has stated
    surface: float = 0.0  # [m] standard uncertainty that it adds to the surface
    known: frozenset[str] = frozenset()  # facts that the record itself measures, so that they are not conditions

    @property
    def changes_values(self) -> bool:
        """True where it says something of the uncertainty of a parameter, or of what follows from one."""
        return any((self.terms, self.unknown, self.biases, self.sources, self.delays, self.left))


# Tracks of one run -> findings by the name of the track; tracks without findings may be left out.
Judge = Callable[[Sequence[TrackEvidence]], Mapping[str, Diagnosed]]
