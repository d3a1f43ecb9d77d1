"""First guesses of a contact model's parameters, from forces at a reference depth or from the user."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, ContactModel, to_si

Floats = NDArray[np.float64]

_REFERENCE_DEPTH = 1e-3  # [m], where the paper's kappa and lambda are numerically force and damping


def first_guess(
    estimator: str,
    model: ContactModel,
    forces: Mapping[str, tuple[float, float]],
    given: Mapping[str, Any],
    given_std: Mapping[str, Any],
) -> tuple[Floats, Floats]:
    """First values (k,) and standard deviations (k,) of a model's parameters.

    `forces` holds, for "elastic" [N] and "viscous" [N s/m], the first guess of the force that such a parameter makes at
    a depth of 1 mm, and its standard deviation. A parameter of neither role starts amid its bounds.
    Raises ConfigurationError where that is impossible and nothing is given, or where what is given is not right.
    """
    _refuse_unknown(estimator, {*given, *given_std}, model)
    guess, spread = [], []
    for i, parameter in enumerate(model.parameters):
        value = deviation = None
        if parameter.role is not None:
            # The force is proportional to this parameter: its value follows from the force it is to give.
            unit = [float(j == i) for j in range(len(model.parameters))]
            resting = (0.0,) * len(model.memory)
            rate = 0.0 if parameter.role == "elastic" else 1.0
            per_unit = float(model.force(_REFERENCE_DEPTH, rate, unit, resting))
            if math.isfinite(per_unit) and per_unit > 0:
                value, deviation = (number / per_unit for number in forces[parameter.role])
        elif math.isfinite(parameter.lower) and math.isfinite(parameter.upper):
            value, deviation = (parameter.lower + parameter.upper) / 2, (parameter.upper - parameter.lower) / 4
        guess.append(_given(estimator, given, parameter.name, parameter.unit, value))
        spread.append(_given(estimator, given_std, parameter.name, parameter.unit, deviation))
    if min(spread, default=1.0) <= 0:
        raise ConfigurationError(f"estimator {estimator}: every first_guess_std must be above 0")
    return np.array(guess), np.array(spread)


def _given(estimator: str, table: Mapping[str, Any], name: str, unit: str, default: float | None) -> float:
    if name in table:
        try:
            return to_si(table[name], unit)
        except ValueError as error:
            raise ConfigurationError(f"estimator {estimator}: first guess of {name}: {error}") from error
    if default is None:
        raise ConfigurationError(f"estimator {estimator}: {name} needs a first_guess and a first_guess_std")
    return default


def _refuse_unknown(estimator: str, given: set[str], model: ContactModel) -> None:
    names = [parameter.name for parameter in model.parameters]
    unknown = sorted(given - set(names))
    if unknown:
        raise ConfigurationError(
            f"estimator {estimator}: first guess of {unknown[0]}: the model has {', '.join(names)}"
        )
