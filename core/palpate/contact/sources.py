"""What is known of a model's own numbers: declared standard uncertainties, and defaults that are stated as such."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from palpate.contact.interfaces import ContactModel
from palpate.errors import ConfigurationError
from palpate.parts import numbers_of
from palpate.units import to_si

READINGS = {"force_scale": "1", "position_scale": "1"}
_RADII = ("radius", "curvature_radius")
_RADIUS = 0.005  # of itself
_POISSON = 0.02  # half-width of a rectangular distribution that ends at the value


@dataclass(frozen=True)
class Source:
    """A number that is known with a standard uncertainty only."""

    name: str  # "radius", "poisson", "force_scale"
    path: tuple[str, ...]  # of the model's key; empty for what concerns the readings
    value: float
    std: float
    unit: str
    declared: bool


def sources_of(model: ContactModel, declared: Mapping[str, Any]) -> tuple[Source, ...]:
    """Every source that concerns a model; raises ConfigurationError for a value that is none.

    A tip's radius that is not declared is known to 0.5 %, and Poisson's ratio within 0.02 below its value: u is
    0.02/sqrt(3) about a value at the end of a rectangular distribution.
    """
    found = [
        Source(name, (), 1.0, _number(name, declared[name], unit), unit, True)
        for name, unit in READINGS.items()
        if name in declared
    ]
    for path, value, unit in numbers_of(model):
        given = declared.get(".".join(path), declared.get(path[-1]))
        if given is not None:
            found.append(Source(path[-1], path, value, _number(path[-1], given, unit), unit, True))
        elif path[-1] in _RADII:
            found.append(Source(path[-1], path, value, _RADIUS * abs(value), unit, False))
        elif path == ("poisson",):
            found.append(Source("poisson", path, value, _POISSON / math.sqrt(3), unit, False))
    return tuple(found)


def unknown_sources(models: Mapping[str, ContactModel], declared: Mapping[str, Any]) -> dict[str, str]:
    """What is wrong with declared uncertainties, by name: a key that no model has, or a value that is none."""
    keys = {key: unit for model in models.values() for path, _, unit in numbers_of(model)
            for key in (path[-1], ".".join(path))}  # fmt: skip
    problems = {}
    for name, value in declared.items():
        unit = READINGS.get(name, keys.get(name))
        if unit is None:
            known = ", ".join(sorted({*READINGS, *(key for key in keys if "." not in key)}))
            problems[name] = f"is no number of a model or its tip; there are: {known}"
            continue
        try:
            _number(name, value, unit)
        except ConfigurationError as error:
            problems[name] = str(error)
    return problems


def _number(name: str, value: Any, unit: str) -> float:
    try:
        std = float(value) if unit == "1" and not isinstance(value, str) else to_si(value, unit)
    except ValueError as error:
        raise ConfigurationError(str(error)) from error
    if not (std >= 0 and math.isfinite(std)):
        raise ConfigurationError(f"{value!r} is no standard uncertainty: it must be finite and not negative")
    return std
