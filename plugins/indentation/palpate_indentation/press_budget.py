"""What is taken for known about a press, and what it does to the modulus: rows of a budget after the GUM."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_engine import AlignmentSettings
from palpate_kit.runs.uncertainty_sources import UncertaintySource, sources_of

from palpate_indentation.approach_fit import CurveFit
from palpate_indentation.elastic_law import ElasticLaw
from palpate_indentation.press import Branch

_MASS = 0.05  # of itself, where no uncertainty of a tip's mass is declared
_STEP = 1e-4  # of the deepest depth, and of a number of the model


@dataclass(frozen=True)
class Declared:
    """What a pipeline says of its readings, its tip and its model."""

    alignment: AlignmentSettings | None = None
    uncertainties: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class PressBudgetRow:
    """One source of uncertainty."""

    source: str
    std: float | None  # None: a part without a number of its own
    unit: str
    contribution: float  # standard uncertainty [unit of the modulus]

    @property
    def shown(self) -> str:
        """Its name without what is said in brackets."""
        return self.source.partition(" (")[0]


class PressBudget:
    """How the modulus of a fit answers to small errors f (n,) of the force: its row of (J^T J)^-1 J^T f.

    J has the derivatives by all that the fit has found: modulus, offset, tilt and surface.
    """

    def __init__(self, law: ElasticLaw, branch: Branch, fit: CurveFit) -> None:
        self._law, self._branch, self._fit = law, branch, fit
        step = _STEP * float((fit.surface - branch.height).max())
        by_surface = (self._force(law, step) - self._force(law, -step)) / (2 * step)
        columns = [law.geometry(fit.surface - branch.height), np.ones(len(branch)), by_surface]
        if fit.tilt_std > 0:
            columns.append(branch.height - fit.surface)
        matrix = np.column_stack(columns)
        scale = np.linalg.norm(matrix, axis=0)
        self._answer = np.asarray(np.linalg.pinv(matrix / scale)[0] / scale[0])

    def shift(self, error: Floats) -> float:
        """Shift of the modulus by an error (n,) of the force [N]."""
        return float(self._answer @ error)

    def rows(self, declared: Declared) -> Iterator[PressBudgetRow]:
        """Everything that is declared, or has a default; raises ConfigurationError for an uncertainty that is none."""
        if declared.alignment is not None:
            yield from self._of_readings(declared.alignment)
        try:
            sources = sources_of(self._law.model, declared.uncertainties or {})
        except ValueError as error:
            raise ConfigurationError(f"[run] uncertainties: {error}") from error
        for source in sources:
            yield self._row(source.name, source.std, source.unit, self._error(source), source.declared)

    @property
    def _depth(self) -> Floats:
        return self._fit.surface - self._branch.height

    def _force(self, law: ElasticLaw, lower: float = 0.0, stretch: float = 1.0) -> Floats:
        """Force (n,) [N] of the material, with the surface lower, and all of the motion larger."""
        depth = stretch * self._depth + lower
        return self._fit.modulus * law.geometry(depth) + law.rest(depth, stretch * self._branch.rate)

    def _of_readings(self, alignment: AlignmentSettings) -> Iterator[PressBudgetRow]:
        force, time = self._force(self._law), self._branch.time
        growth = np.gradient(force, time)
        if alignment.timing_uncertainty is not None:
            yield self._row("timing", alignment.timing_uncertainty, "s", -alignment.timing_uncertainty * growth)
        if alignment.tip_mass:
            given = alignment.tip_mass_uncertainty
            std = given if given is not None else _MASS * alignment.tip_mass
            yield self._row("mass", std, "kg", std * self._branch.acceleration, given is not None)
        if alignment.series_stiffness is not None:
            given_way, step = 1.0 / alignment.series_stiffness, _STEP * float(self._depth.max())
            slope = (self._force(self._law, step) - self._force(self._law, -step)) / (2 * step)
            late = self._held_viscosity * self._law.damping(self._depth, growth) if self._held_viscosity else 0.0
            yield self._row("compliance", given_way, "m/N", -given_way * (slope * force + late))

    @property
    def _held_viscosity(self) -> float:
        return self._law.held[self._law.viscous] if self._law.viscous is not None else 0.0

    def _error(self, source: UncertaintySource) -> Floats:
        """Error (n,) of the force [N] by one standard uncertainty of a source."""
        if source.path:
            step = _STEP * abs(source.value) or _STEP
            up, down = (
                self._force(self._law.with_model(_changed(self._law.model, source.path, side * step)))
                for side in (1.0, -1.0)
            )
            return -source.std * (up - down) / (2 * step)
        if source.name == "force_scale":
            return source.std * self._force(self._law)
        return -source.std * (self._force(self._law, stretch=1 + _STEP) - self._force(self._law)) / _STEP

    def _row(self, source: str, std: float, unit: str, error: Floats, declared: bool = True) -> PressBudgetRow:
        name = source if declared else f"{source} (not declared)"
        return PressBudgetRow(name, std, unit, abs(self.shift(error)))


def _changed(part: Any, path: Sequence[str], change: float) -> Any:
    """A part with a number among its keys changed."""
    name, *rest = path
    inner = getattr(part, name)
    return part.model_copy(update={name: _changed(inner, rest, change) if rest else inner + change})
