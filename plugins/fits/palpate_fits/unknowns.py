"""The unknowns of a fit: the model's parameters, the surface, and errors of force and timing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Floats, to_si

EXTRAS = ("surface", "bias", "slope", "tip_mass", "delay")
_EXTRA_UNITS = ("m", "N", "N/s", "kg", "s")
_MAX_DELAY = 0.05  # [s]; the motion at another time is a Taylor expansion, good to 1 % of itself there at 2 Hz


@dataclass(frozen=True)
class FitUnknown:
    """One number of a fit, free or fixed."""

    name: str
    unit: str  # SI
    lower: float
    upper: float
    free: bool
    value: float | None = None  # fixed value, or a first guess

    def inside(self, value: float) -> float:
        """Return the nearest value within the bounds."""
        return float(min(max(value, self.lower), self.upper))


@dataclass(frozen=True)
class Unknowns:
    """All numbers of a fit in the order of the residual's parameters: the model's, then EXTRAS."""

    items: tuple[FitUnknown, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names, in order."""
        return tuple(item.name for item in self.items)

    @cached_property
    def free(self) -> tuple[int, ...]:
        """The places of the free ones."""
        return tuple(i for i, item in enumerate(self.items) if item.free)

    def index(self, name: str) -> int:
        """Return the place of a name."""
        return self.names.index(name)

    def bounds(self, places: Sequence[int]) -> tuple[Floats, Floats]:
        """Return lower and upper bounds (n,) at some places."""
        return np.array([self.items[i].lower for i in places]), np.array([self.items[i].upper for i in places])

    def changed(self, name: str, **changes: Any) -> Unknowns:
        """Return the unknowns with other settings of the one of a name."""
        place = self.index(name)
        item = replace(self.items[place], **changes)
        return Unknowns((*self.items[:place], item, *self.items[place + 1 :]))


def unknowns_of(
    model: ContactModel,
    extras: Sequence[str],
    fixed: Mapping[str, Any],
    guesses: Mapping[str, Any],
    bounds: Mapping[str, tuple[Any, Any]],
) -> Unknowns:
    """Return the unknowns of a model under the settings; raises ConfigurationError where they contradict each other.

    `extras` are the names of those of EXTRAS that are free, `fixed`, `guesses` and `bounds` have values by name, as
    numbers [SI] or texts with a unit.
    """
    units = {p.name: p.unit for p in model.parameters} | dict(zip(EXTRAS, _EXTRA_UNITS, strict=True))
    for key, table in (("fixed", fixed), ("start_at", guesses), ("bounds", bounds)):
        for name in table:
            if name not in units:
                _refuse(f"{key}: no unknown {name!r}; there are: {', '.join(units)}")
    # Each with its bounds, and the value that is fixed or from which the fit starts.
    physical_limits = _physical_limits(model)
    items = []
    for name, unit in units.items():
        limits = _limits(name, unit, physical_limits[name], bounds)
        value = _stated_value(name, unit, limits, fixed, guesses)
        if name in fixed and name in extras:
            _refuse(f"{name} is fixed and among the unknowns: take it out of one of them")
        is_unknown = name not in EXTRAS or name == "surface" or name in extras
        is_free = is_unknown and name not in fixed
        items.append(FitUnknown(name=name, unit=unit, lower=limits[0], upper=limits[1], free=is_free, value=value))
    return Unknowns(tuple(items))


def _physical_limits(model: ContactModel) -> dict[str, tuple[float, float]]:
    """Return the bounds [SI] of all that can be an unknown, without those of the settings."""
    limits = {p.name: (p.lowest_estimate, p.upper) for p in model.parameters}
    limits |= dict.fromkeys(EXTRAS, (-np.inf, np.inf))
    limits["tip_mass"] = (0.0, np.inf)
    limits["delay"] = (-_MAX_DELAY, _MAX_DELAY)
    return limits


def _stated_value(
    name: str, unit: str, limits: tuple[float, float], fixed: Mapping[str, Any], guesses: Mapping[str, Any]
) -> float | None:
    """Return the value [SI] at which an unknown is fixed or from which it starts; None where the settings have none.

    Raises ConfigurationError for a start outside the limits.
    """
    if name in fixed:
        return _number("fixed", name, fixed[name], unit)
    if name not in guesses:
        return None
    low, high = limits
    value = _number("start_at", name, guesses[name], unit)
    if not low <= value <= high:
        _refuse(f"start_at: {name} = {value:g} {unit} is outside its bounds {low:g} to {high:g}")
    return value


def at_physical_bounds(unknowns: Unknowns, model: ContactModel) -> Unknowns:
    """Return the unknowns with the lower bounds that a material has, in place of those of least squares."""
    for parameter in model.parameters:
        item = unknowns.items[unknowns.index(parameter.name)]
        unknowns = unknowns.changed(parameter.name, lower=max(item.lower, parameter.lower))
    return unknowns


def _limits(name: str, unit: str, usual: tuple[float, float], bounds: Mapping[str, Any]) -> tuple[float, float]:
    """Return the bounds of an unknown [SI], those of the settings within the `usual` ones."""
    if name not in bounds:
        return usual
    low, high = (_number("bounds", name, edge, unit) for edge in bounds[name])
    if low >= high:
        _refuse(f"bounds: {name} from {low:g} to {high:g} {unit} leaves nothing: the first must be the smaller")
    if high < usual[0] or low > usual[1]:
        _refuse(
            f"bounds: {name} from {low:g} to {high:g} {unit} is outside what is possible, {usual[0]:g} to {usual[1]:g}"
        )
    return max(low, usual[0]), min(high, usual[1])


def _number(table: str, name: str, value: Any, unit: str) -> float:
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise ConfigurationError(f"estimator casadi-fit: {table}: {name}: {error}") from error


def _refuse(problem: str) -> None:
    raise ConfigurationError(f"estimator casadi-fit: {problem}")
