"""First guesses of a contact model's parameters, from forces at a reference depth or from the user."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Floats, Quantity, to_si

_REFERENCE_DEPTH = 1e-3  # [m], where the paper's kappa and lambda are numerically force and damping


def first_guess(
    model: ContactModel,
    forces: Mapping[str, tuple[float, float]],
    given: Mapping[str, Any],
    given_std: Mapping[str, Any],
    others: Mapping[str, Sequence[str]],
) -> tuple[Floats, Floats]:
    """First values (k,) and standard deviations (k,) of a model's parameters.

    `forces` holds, for "elastic" [N] and "viscous" [N s/m], the first guess of the force that such a parameter makes at
    a depth of 1 mm, and its standard deviation. A parameter of neither role starts at its own first guess, or in the
    middle of its bounds. A guess applies to the models that have the parameter; `others` are those of the other models.
    Raises ConfigurationError where that is impossible and nothing is given, or where what is given is not right.
    """
    _refuse_unknown({*given, *given_std}, model, others)
    guess, spread = np.zeros(len(model.parameters)), np.zeros(len(model.parameters))
    # Those of no role first: the force that the others make depends on them.
    for i, parameter in sorted(enumerate(model.parameters), key=lambda pair: pair[1].role is not None):
        value = deviation = None
        # A pull is not a measure of a modulus: a model that sticks says where to start, if it can.
        if parameter.role is not None and not (model.adhesive and parameter.start is not None):
            per_unit = _force_per_unit(model, i, guess)
            if math.isfinite(per_unit) and per_unit > 0:
                value, deviation = (number / per_unit for number in forces[parameter.role])
        elif parameter.start is not None:
            value, deviation = parameter.start, parameter.start_std
        elif math.isfinite(parameter.lower) and math.isfinite(parameter.upper):
            value, deviation = (parameter.lower + parameter.upper) / 2, (parameter.upper - parameter.lower) / 4
        guess[i] = _given(given, parameter.name, parameter.unit, value)
        spread[i] = _given(given_std, parameter.name, parameter.unit, deviation)
    if min(spread, default=1.0) <= 0:
        raise ConfigurationError("every first_guess_std must be above 0")
    return guess, spread


def _force_per_unit(model: ContactModel, which: int, guess: Floats) -> float:
    """What one unit of a parameter of a role adds to the force at the reference depth, at rest or at 1 m/s."""
    unit = [
        float(j == which) if parameter.role is not None else float(guess[j])
        for j, parameter in enumerate(model.parameters)
    ]
    rate = 0.0 if model.parameters[which].role == "elastic" else 1.0
    return float(model.force(_REFERENCE_DEPTH, rate, unit, (0.0,) * len(model.memory)))


def _given(table: Mapping[str, Any], name: str, unit: str, default: float | None) -> float:
    if name in table:
        given = table[name]
        number = isinstance(given, int | float) and not isinstance(given, bool)
        if number and (doubt := Quantity(unit).doubt(given)):
            raise ConfigurationError(f"first guess of {name}: {doubt}")
        try:
            return to_si(table[name], unit)
        except ValueError as error:
            raise ConfigurationError(f"first guess of {name}: {error}") from error
    if default is None:
        raise ConfigurationError(f"{name} needs a first_guess and a first_guess_std")
    return default


def _refuse_unknown(given: set[str], model: ContactModel, others: Mapping[str, Sequence[str]]) -> None:
    names = [parameter.name for parameter in model.parameters]
    unknown = sorted(given.difference(names, *others.values()))
    if unknown:
        beside = "".join(f"; {other} has {', '.join(others[other])}" for other in others)
        raise ConfigurationError(f"first guess of {unknown[0]}: the model has {', '.join(names)}{beside}")
