"""The `ting-fit` estimator: one loading and one unloading by Ting's (1966) contact that shrinks in unloading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from palpate import (
    ConfigurationError,
    Estimator,
    Parameter,
    Problem,
    Time,
    Tracker,
    loading_cycle_force,
    suggest,
    to_si,
)
from pydantic import Field

_TRIAL_DEPTH = 1e-3  # [m] of a press that tests a model (choice)
_TRIAL_INSTANTS = 9  # of that press (choice)


class TingFit(Estimator):
    """A least-squares fit of a linear material to one loading and one unloading, with the surface unknown.

    Minimises the sum of (F_Ting(t) + m d'' - u)^2 over the model's parameters and the surface, with Ting's force: the
    hereditary integral up to t1(t) only, where the contact was as large on the way in. For every model with a
    relaxation modulus; more than one maximum of the depth is refused by name. The standard deviation counts the
    residuals' autocorrelation, and is that of the wider side of an interval that is even over the logarithm. Assumes
    constant nu, no adhesion, and a motion that stays on one place.
    Source: Ting 1966; Lee and Radok 1960.
    """

    online: ClassVar[bool] = False
    motion: ClassVar[Literal["position", "velocity", "both"]] = "position"
    unloading: ClassVar[str] = "ting"

    fixed: dict[str, float | str] = Field(default={}, description="known values, by name of the parameter")
    first_guess: dict[str, float | str] = Field(default={}, description="start values, by name of the parameter")
    smoothing: Time = Field(default=0.02, gt=0, description="window of the local cubic for depth and acceleration")

    def start(self, problem: Problem) -> Tracker:
        """Return a tracker of a whole record; raises ConfigurationError for a model without a relaxation modulus."""
        from palpate_fits.ting_tracker import TingTracker

        parameters = problem.model.parameters
        fixed = _values_in_si("fixed", self.fixed, parameters)
        first_guess = _values_in_si("first_guess", self.first_guess, parameters)
        start = [fixed.get(p.name, first_guess.get(p.name, p.start or 1.0)) for p in parameters]
        # A press of 1 mm and back in 1 s, which the force of a model without a relaxation modulus refuses.
        time = np.linspace(0.0, 1.0, _TRIAL_INSTANTS)
        try:
            loading_cycle_force(problem.model, time, _TRIAL_DEPTH * (1 - np.abs(2 * time - 1)), start)
        except ValueError as error:
            raise ConfigurationError(f"estimator ting-fit: {error}") from error
        free = np.array([parameter.name not in fixed for parameter in parameters])
        return TingTracker(self.smoothing, problem, np.array(start), free)


def _values_in_si(key: str, table: Mapping[str, float | str], parameters: Sequence[Parameter]) -> dict[str, float]:
    """Return the values of a table of settings, by parameter; raises ConfigurationError for a wrong name or unit."""
    units = {parameter.name: parameter.unit for parameter in parameters}
    values = {}
    for name, value in table.items():
        if name not in units:
            raise ConfigurationError(f"estimator ting-fit: {key}: no parameter {name!r}{suggest(name, units)}")
        try:
            values[name] = to_si(value, units[name])
        except ValueError as error:
            raise ConfigurationError(f"estimator ting-fit: {key}: {name}: {error}") from error
    return values
