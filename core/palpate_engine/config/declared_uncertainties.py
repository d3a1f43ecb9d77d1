"""Standard uncertainties that ``[run] uncertainties`` declares: whether each is one, and of a number that there is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from palpate.contact import ContactModel
from palpate.parts import numbers_of
from palpate.units import to_si

POISSON_RANGE = 0.02  # of a Poisson's ratio, below a value whose uncertainty nobody declares: a choice
POISSON_STD = POISSON_RANGE / math.sqrt(3)  # a rectangular distribution that ends at the value
READINGS = {"force_scale": "1", "position_scale": "1"}  # units of the factors of force and position, which any rig has


def unknown_sources(models: Mapping[str, ContactModel], declared: Mapping[str, Any]) -> dict[str, str]:
    """Return the problem of each wrong declared uncertainty, by name: a key that no model has, or an invalid value."""
    # A number is named by its last key, or by its path where several tips have that key; each name has a unit.
    numbers = [number for model in models.values() for number in numbers_of(model)]
    keys = {key: unit for path, _, unit in numbers for key in (path[-1], ".".join(path))}
    problems = {}
    for name, value in declared.items():
        unit = READINGS.get(name, keys.get(name))
        if unit is None:
            short_keys = sorted({*READINGS, *(key for key in keys if "." not in key)})
            problems[name] = f"is not a number of a model or its tip; there are: {', '.join(short_keys)}"
            continue
        try:
            declared_std(value, unit)
        except ValueError as error:
            problems[name] = str(error)
    return problems


def declared_std(value: Any, unit: str) -> float:
    """Return a declared standard uncertainty [unit]; raises ValueError for anything else."""
    std = float(value) if unit == "1" and not isinstance(value, str) else to_si(value, unit)
    if not (std >= 0 and math.isfinite(std)):
        raise ValueError(f"{value!r} is not a standard uncertainty: it must be finite and not negative")
    return std
