"""Sensitivities of a fit to what is not exactly known, for an uncertainty budget after the GUM."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import BudgetRow, ConfigurationError, ContactModel, Effect, Floats
from palpate_kit.budget.force_sensitivity import number_step, with_change
from palpate_kit.budget.uncertainty_sources import UncertaintySource, declared_source
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual, reading

TIMING = "timing of force against motion"  # the row of a delay
PROBE = 1e-4  # [s], at which the sensitivity to a delay is taken
_SAMPLES = 20_000  # at which sensitivities are taken (choice)


def stated_sources(
    model: ContactModel, stated: Mapping[str, Any], fixed: Mapping[str, str]
) -> tuple[UncertaintySource, ...]:
    """Return the sources that `systematic` states of the model, the readings, and `fixed` unknowns by name and unit.

    `stated` has the standard uncertainties by name, as numbers [SI] or texts with a unit. Raises ConfigurationError
    where a name does not exist or has a wrong unit.
    """
    if {"delay", "timing"} & stated.keys():
        raise ConfigurationError(
            "estimator casadi-fit: systematic: the uncertainty of timing belongs to the signal: set "
            'uncertainty = "0.5 ms" next to its channel in [alignment]'
        )
    sources = []
    for name, value in stated.items():
        try:
            sources.append(declared_source(model, name, value, fixed))
        except ValueError as error:
            raise ConfigurationError(f"estimator casadi-fit: systematic: {error}") from error
    return tuple(sources)


class FitSensitivity:
    """The shift of the minimum by errors of the force, to first order: (J^T J)^-1 J^T of the change of the residual.

    Errors are those of the weighted residual.
    """

    def __init__(self, residual: Residual, record: FitRecord, x: Floats, held: NDArray[np.bool_]) -> None:
        self._residual = residual
        self._record = record if residual.model.memory else record.thinned(_SAMPLES)
        self._x = x
        self.jacobian = residual.whole(self._record, x)[1]
        self._held = held
        self._columns: dict[tuple[int, float], Floats] = {}

    @cached_property
    def _inverse(self) -> Floats:
        loose = np.where(self._held, 0.0, 1.0)
        return scaled_inverse((self.jacobian.T @ self.jacobian) * np.outer(loose, loose)) * loose[:, None]

    def shifts(self, error: Floats) -> Floats:
        """Return the shift (p,) of the free unknowns by an error (n,)."""
        return np.asarray(self._inverse @ (self.jacobian.T @ error))

    @property
    def force(self) -> Floats:
        """Return the readings of the force (n,)."""
        return np.asarray(self._record.weight * self._record.force)

    def of_parameter(self, place: int, std: float) -> Floats:
        """Return the shift for one standard uncertainty of a parameter that is not free."""
        if not std > 0.0:
            return np.zeros(len(self._inverse))
        return self.shifts(-self.column(place, std) * std)

    def column(self, place: int, step: float) -> Floats:
        """Return the derivative (n,) of the residual by a parameter that is not free."""
        if (place, step) not in self._columns:
            up, down = self._x.copy(), self._x.copy()
            up[place] += step
            down[place] -= step
            high, low = (self._residual.errors(self._record, x) for x in (up, down))
            self._columns[place, step] = (high - low) / (2 * step)
        return self._columns[place, step]

    def by_number(self, path: tuple[str, ...], value: float, wide: float = 0.0) -> Floats:
        """Return the derivative (n,) by a number among the model's keys; over a `wide` step upwards, if given."""
        model, step = self._residual.model, wide or number_step(value)
        up = self._errors(with_change(model, path, step))
        down = self._errors(model if wide else with_change(model, path, -step))
        return np.asarray((up - down) / (step if wide else 2 * step))

    @property
    def stretched(self) -> Floats:
        """Change (n,) of the weighted residual per unit of the scale of position, rate and acceleration.

        The scale stretches the heights from the highest one, which stays.
        """
        record, history = self._record, self._record.history
        fixed, share = float(record.height.max()), number_step(1.0)
        if history is not None:
            # Columns: the interval, this height, height and rate of the sample before.
            history = history * np.array([1.0, 1 + share, 1 + share, 1 + share])
            history[:, 1:3] -= fixed * share
        stretched = replace(
            record,
            height=fixed + (record.height - fixed) * (1 + share),
            rate=record.rate * (1 + share),
            acceleration=record.acceleration * (1 + share),
            history=history,
        )
        change = self._residual.errors(stretched, self._x) - self._residual.errors(record, self._x)
        return np.asarray(change / share)

    def _errors(self, model: ContactModel) -> Floats:
        """Return the residual of another model, which is not worth compiling."""
        record = self._record
        if model.memory:
            return Residual(model, ()).errors(record, self._x)
        expected = reading(model, self._x.tolist(), list(record.parts), record.transition)
        return np.asarray(record.weight * (expected - record.force))


def open_row(source: str, unit: str, sensitivities: Mapping[str, float]) -> BudgetRow:
    """Return the row of a source whose uncertainty nobody has stated."""
    return BudgetRow(source, None, unit, {name: Effect(slope, None, None) for name, slope in sensitivities.items()})
