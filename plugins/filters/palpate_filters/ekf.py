"""The paper's extended Kalman filter: force drives the tip, velocity corrects it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import (
    ConfigurationError,
    ContactModel,
    Damping,
    Estimator,
    Force,
    InertialProcess,
    Length,
    Problem,
    Speed,
    Tracker,
    to_si,
)
from pydantic import Field

from palpate_filters.ekf_step import ekf_step
from palpate_filters.tracking import InertialTracker

_REFERENCE_DEPTH = 1e-3  # [m], where the paper's kappa and lambda are numerically force and damping


class ExtendedKalmanFilter(Estimator):
    """The paper's filter: state depth, rate and the model's parameters; input force, measurement velocity.

    Process: `palpate.InertialProcess` (paper, eq. state_space_NL_FT) with Q = B sigma_u^2 B^T; measurement: the tip's
    velocity. Each step updates with the velocity, then predicts with the force. Defaults are the paper's:
    x0 = [1 mm, v0, 0.1 N/mm^1.5, 0.01 N s/mm^1.5], P0 = diag(5, 1, 1, 1), read as the force and the damping of the
    material at a depth of 1 mm so that they hold for every tip and model.
    Known faults of this form (simulated): E some 2 % and eta some 4 to 8 % high after 10 s, because the noisy force
    drives the state; a standard deviation far too small. The Jacobian is derived, not written by hand.
    """

    force_std: Force = Field(default=0.05, gt=0, description="standard deviation sigma_u of the force")
    velocity_std: Speed = Field(default=0.67e-3, gt=0, description="standard deviation sigma_vel of the velocity")
    start_depth: Length = Field(default=1e-3, gt=0, description="first guess of the depth")
    start_depth_std: Length = Field(default=math.sqrt(5) * 1e-3, gt=0, description="its standard deviation")
    start_rate_std: Speed = Field(
        default=1e-3, gt=0, description="standard deviation of the first rate, which is measured"
    )
    start_force: Force = Field(default=0.1, gt=0, description="first guess of the elastic force at a depth of 1 mm")
    start_force_std: Force = Field(default=1.0, gt=0, description="its standard deviation")
    start_damping: Damping = Field(
        default=10.0, gt=0, description="first guess of the force per speed at a depth of 1 mm"
    )
    start_damping_std: Damping = Field(default=1000.0, gt=0, description="its standard deviation")
    first_guess: dict[str, float | str] = Field(
        default={}, description='first guesses by parameter name, such as { elasticity = "50 kPa" }'
    )
    first_guess_std: dict[str, float | str] = Field(
        default={}, description="their standard deviations, by parameter name"
    )

    def start(self, problem: Problem) -> Tracker:
        """A tracker; raises ConfigurationError where no tip mass is declared or a first guess cannot be made."""
        if problem.tip_mass is None:
            raise ConfigurationError(
                'the tip\'s mass is not declared; this filter needs it: set [alignment] tip_mass, such as "140 g"'
            )
        guess, spread = self._first_guess(problem.model)
        start = np.array([self.start_depth, 0.0, *guess])
        std = np.array([self.start_depth_std, self.start_rate_std, *spread])
        process = InertialProcess(problem.model, problem.tip_mass)
        settings = np.array([self.force_std, self.velocity_std, *start, *std])
        return InertialTracker(ekf_step(process, len(start)), settings, start, std)

    def _first_guess(self, model: ContactModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        guess, spread = [], []
        for i, parameter in enumerate(model.parameters):
            unit = [float(j == i) for j in range(len(model.parameters))]
            at_rest = {"elastic": 0.0, "viscous": 1.0}.get(parameter.role or "")
            value = deviation = None
            if at_rest is not None:
                # The force is proportional to this parameter: its value follows from the force it is to give.
                per_unit = float(model.force(_REFERENCE_DEPTH, at_rest, unit))
                elastic = parameter.role == "elastic"
                value = (self.start_force if elastic else self.start_damping) / per_unit
                deviation = (self.start_force_std if elastic else self.start_damping_std) / per_unit
            value = _given(self.first_guess, parameter.name, parameter.unit, value)
            deviation = _given(self.first_guess_std, parameter.name, parameter.unit, deviation)
            guess.append(value)
            spread.append(deviation)
        _refuse_unknown({*self.first_guess, *self.first_guess_std}, model)
        return np.array(guess), np.array(spread)


def _given(table: dict[str, Any], name: str, unit: str, default: float | None) -> float:
    if name in table:
        try:
            return to_si(table[name], unit)
        except ValueError as error:
            raise ConfigurationError(f"first guess of {name}: {error}") from error
    if default is None:
        raise ConfigurationError(f"{name} needs a first_guess and a first_guess_std")
    return default


def _refuse_unknown(given: set[str], model: ContactModel) -> None:
    names = [parameter.name for parameter in model.parameters]
    unknown = sorted(given - set(names))
    if unknown:
        raise ConfigurationError(f"first guess of {unknown[0]}: the model has {', '.join(names)}")
