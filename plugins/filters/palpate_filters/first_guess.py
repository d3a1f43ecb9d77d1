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
    guesses: Mapping[str, Any],
    guess_stds: Mapping[str, Any],
    others: Mapping[str, Sequence[str]],
) -> tuple[Floats, Floats]:
    """Return first values (k,) and standard deviations (k,) of a model's parameters.

    `forces` holds, for "elastic" [N] and "viscous" [N s/m], the first guess of the force that such a parameter makes at
    a depth of 1 mm, and its standard deviation. A parameter of neither role starts at its own first guess, or in the
    middle of its bounds. `guesses` of the user apply to the models that have the parameter; `others` are the parameters
    of the other models, by their names. Raises ConfigurationError where a parameter has neither, or where a guess is
    not right.
    """
    _refuse_unknown({*guesses, *guess_stds}, model, others)
    theta, std = np.zeros(len(model.parameters)), np.zeros(len(model.parameters))
    # Those of no role first: the force that the others make depends on them.
    for i, parameter in sorted(enumerate(model.parameters), key=lambda pair: pair[1].role is not None):
        value, value_std = _default_guess(model, i, theta, forces)
        theta[i] = _stated_or(guesses, parameter.name, parameter.unit, value)
        std[i] = _stated_or(guess_stds, parameter.name, parameter.unit, value_std)
    if min(std, default=1.0) <= 0:
        raise ConfigurationError("every first_guess_std must be above 0")
    return theta, std


def _default_guess(
    model: ContactModel, index: int, theta: Floats, forces: Mapping[str, tuple[float, float]]
) -> tuple[float | None, float | None]:
    """Return a parameter's first value and standard deviation without a guess of the user; None where unknown.

    A parameter with a role starts at the value that makes the force of `forces` at the reference depth. `theta` has the
    values of the parameters without a role.
    """
    parameter = model.parameters[index]
    # A pull is not a measure of a modulus: an adhesive model states its start, if it can.
    if parameter.role is not None and not (model.adhesive and parameter.start is not None):
        per_unit = _force_per_unit(model, index, theta)
        if not (math.isfinite(per_unit) and per_unit > 0):
            return None, None
        force, force_std = forces[parameter.role]
        return force / per_unit, force_std / per_unit
    if parameter.start is not None:
        return parameter.start, parameter.start_std
    # The middle of the bounds; two standard deviations reach to either of them.
    if math.isfinite(parameter.lower) and math.isfinite(parameter.upper):
        half_width = (parameter.upper - parameter.lower) / 2
        return (parameter.lower + parameter.upper) / 2, half_width / 2
    return None, None


def _force_per_unit(model: ContactModel, index: int, theta: Floats) -> float:
    """Return the force of one unit of a parameter of a role at the reference depth, at rest or at 1 m/s."""
    unit_theta = []
    for j, parameter in enumerate(model.parameters):
        unit_theta.append(float(j == index) if parameter.role is not None else float(theta[j]))
    rate = 0.0 if model.parameters[index].role == "elastic" else 1.0
    return float(model.force(_REFERENCE_DEPTH, rate, unit_theta, (0.0,) * len(model.memory)))


def _stated_or(table: Mapping[str, Any], name: str, unit: str, default: float | None) -> float:
    """Return the user's number of a parameter in SI, else the default; raises ConfigurationError without either."""
    if name in table:
        stated = table[name]
        is_number = isinstance(stated, int | float) and not isinstance(stated, bool)
        if is_number and (doubt := Quantity(unit).doubt(stated)):
            raise ConfigurationError(f"first guess of {name}: {doubt}")
        try:
            return to_si(stated, unit)
        except ValueError as error:
            raise ConfigurationError(f"first guess of {name}: {error}") from error
    if default is None:
        raise ConfigurationError(f"{name} needs a first_guess and a first_guess_std")
    return default


def _refuse_unknown(guessed: set[str], model: ContactModel, others: Mapping[str, Sequence[str]]) -> None:
    """Raise ConfigurationError for a guess of a parameter that neither the model nor another one has."""
    names = [parameter.name for parameter in model.parameters]
    unknown = sorted(guessed.difference(names, *others.values()))
    if unknown:
        other_models = "".join(f"; {other} has {', '.join(others[other])}" for other in others)
        raise ConfigurationError(f"first guess of {unknown[0]}: the model has {', '.join(names)}{other_models}")
