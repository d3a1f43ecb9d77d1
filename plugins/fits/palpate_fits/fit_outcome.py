"""The outcome of a fit, before it is judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from palpate import Flag, LastDigit, Problem, Samples
from palpate_kit.budget.uncertainty_sources import UncertaintySource
from palpate_kit.numerics.tip_travel import TipTravel

from palpate_fits.approach import SurfaceByForce
from palpate_fits.fit_settings import FitSettings
from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.segments import RecordCourse, Rows
from palpate_fits.solvers import Solution
from palpate_fits.unknowns import Unknowns


@dataclass(frozen=True)
class FitOutcome:
    """A finished fit and all that its report needs."""

    settings: FitSettings
    problem: Problem
    samples: Samples
    rows: Rows  # (n,) fitted samples
    course: RecordCourse
    motion: TipTravel
    by_force: SurfaceByForce
    sources: tuple[UncertaintySource, ...]
    unknowns: Unknowns
    record: FitRecord
    residual: Residual
    solution: Solution
    solver: str
    loss: LossFunction
    notes: tuple[Flag, ...]  # flags met on the way
    begins_in_contact: Callable[[], bool]  # whether nothing shows that the record begins in air

    @cached_property
    def digit(self) -> LastDigit:
        """Of the force of the fitted samples."""
        return LastDigit.of(self.samples.force[self.rows])
