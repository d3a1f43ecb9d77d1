"""Sources of uncertainty: numbers of a model by their declared standard uncertainties, and defaults that are stated as
such."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from palpate import ContactModel
from palpate_engine import POISSON_STD, READINGS, declared_std, numbers_of

_RADII = ("radius", "curvature_radius")
# Standard uncertainties of what nobody has declared: choices, as the help of [run] uncertainties states them.
_RADIUS_SHARE = 0.005  # of a tip's radius
_INCLINATION_STD = math.radians(2.0)  # [rad]
_SKIN_RADIUS_SHARE = 0.05  # of a skin's radius
_STICK_STD = 0.5  # between a tip that slides and one that sticks, and half of the way from one to the other


@dataclass(frozen=True)
class UncertaintySource:
    """A number that is known with a standard uncertainty only."""

    name: str  # "radius", "poisson", "force_scale"
    path: tuple[str, ...]  # of the model's key; empty for what concerns the readings
    value: float
    std: float
    unit: str
    declared: bool


def declared_source(model: ContactModel, name: str, value: Any, other_units: Mapping[str, str]) -> UncertaintySource:
    """Return the source of uncertainty of a name, with the `value` that declares its standard uncertainty.

    It is a number of the model or its tip, or one of the readings, or of `other_units` (by name), whose value is 1.
    Raises ValueError for an unknown name, or a value that is not an uncertainty.
    """
    units = {**READINGS, **other_units}
    # A number of a model is (path of keys, value, unit). A number is named by its last key or by its path; of several
    # with one last key the first counts.
    numbers = {}
    for number_of_model in reversed(numbers_of(model)):
        keys = number_of_model[0]
        numbers[keys[-1]] = numbers[".".join(keys)] = number_of_model
    if name not in units and name not in numbers:
        allowed = ", ".join([*units, *(".".join(path) for path, _, _ in numbers_of(model))])
        raise ValueError(f"{name!r} is not a number of {type(model).__name__} or its tip; there are: {allowed}")
    path, number, unit = ((), 1.0, units[name]) if name in units else numbers[name]
    try:
        std = declared_std(value, unit)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    return UncertaintySource(name, path=path, value=number, std=std, unit=unit, declared=True)


def sources_of(model: ContactModel, declared: Mapping[str, Any]) -> tuple[UncertaintySource, ...]:
    """Return every number of a model and its readings that is known with an uncertainty, declared or by default.

    `declared` are uncertainties by name; raises ValueError for a value that is not one. A tip's radius that is not
    declared is known to 0.5 %, and Poisson's ratio within 0.02 below its value: u is 0.02/sqrt(3) about a value at the
    end of a rectangular distribution. Of a skin that is stated, the inclination is known to 2 degrees, a radius to 5 %,
    and whether the tip sticks on an inclination is not known.
    """
    sources = []
    # Scales of the readings, such as `force_scale`, are 1; then the numbers of the model: path of keys, value, unit.
    for name, unit in READINGS.items():
        if name in declared:
            reading_std = declared_std(declared[name], unit)
            sources.append(UncertaintySource(name, path=(), value=1.0, std=reading_std, unit=unit, declared=True))
    is_level = not getattr(getattr(model, "skin", None), "inclination", 0.0)
    # A declared uncertainty goes before a default; a number without either is exact.
    for path, value, unit in numbers_of(model):
        if is_level and path == ("skin", "stick"):
            continue
        declared_value = declared.get(".".join(path), declared.get(path[-1]))
        std = _default_std(path, value) if declared_value is None else declared_std(declared_value, unit)
        if std is None:
            continue
        sources.append(
            UncertaintySource(path[-1], path=path, value=value, std=std, unit=unit, declared=declared_value is not None)
        )
    return tuple(sources)


def _default_std(path: tuple[str, ...], value: float) -> float | None:
    """Return the standard uncertainty of a number of a model without a declared one; None for an exact number."""
    if path[-1] in _RADII:
        return _RADIUS_SHARE * abs(value)
    if path == ("poisson",):
        return POISSON_STD
    if path[0] == "skin":
        defaults = {"inclination": _INCLINATION_STD, "stick": _STICK_STD}
        return defaults.get(path[-1], _SKIN_RADIUS_SHARE * abs(value))
    return None
