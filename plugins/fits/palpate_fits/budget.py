"""An uncertainty budget after the GUM: source, standard uncertainty, sensitivity, contribution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, ContactModel, Floats, Part, to_si

from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual, reading
from palpate_fits.uncertainty import scaled_inverse

TIMING = "timing of force against motion"  # the row of a delay
_READINGS = {"tip_mass": "kg", "force_scale": "1", "position_scale": "1", "bias": "N"}
_SAMPLES = 20_000
_PROBE = 1e-4  # [s], at which the sensitivity to a delay is taken


@dataclass(frozen=True)
class BudgetSource:
    """Something that is known with a standard uncertainty only."""

    name: str  # "radius", "tip_mass", "force_scale"
    path: tuple[str, ...]  # of the model's key; empty for what concerns the readings
    std: float
    unit: str


def sources_of(model: ContactModel, declared: Mapping[str, Any]) -> tuple[BudgetSource, ...]:
    """The declared sources; raises ConfigurationError where one does not exist or has the wrong unit."""
    keys = {".".join(path): (path, unit) for path, unit in _keys(model)}
    found = []
    for name, value in declared.items():
        if name in ("delay", "timing"):
            raise ConfigurationError(
                "estimator casadi-fit: systematic: the uncertainty of timing belongs to the signal: set "
                'uncertainty = "0.5 ms" beside its channel in [alignment]'
            )
        full = [key for key in keys if key == name or key.split(".")[-1] == name]
        if name not in _READINGS and not full:
            allowed = ", ".join([*_READINGS, *keys])
            kind = type(model).__name__
            raise ConfigurationError(
                f"estimator casadi-fit: systematic: {name!r} is no number of {kind} or its tip; there are: {allowed}"
            )
        path, unit = ((), _READINGS[name]) if name in _READINGS else keys[full[0]]
        try:
            std = float(value) if unit == "1" and not isinstance(value, str) else to_si(value, unit)
        except ValueError as error:
            raise ConfigurationError(f"estimator casadi-fit: systematic: {name}: {error}") from error
        if std < 0:
            raise ConfigurationError(f"estimator casadi-fit: systematic: {name}: {std:g} is negative")
        found.append(BudgetSource(name, tuple(path), std, unit))
    return tuple(found)


def _keys(part: Part, above: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], str]]:
    """Every number among a part's keys, and its unit."""
    found: list[tuple[tuple[str, ...], str]] = []
    for name, field in type(part).model_fields.items():
        value = getattr(part, name)
        if isinstance(value, Part):
            found += _keys(value, (*above, name))
        elif isinstance(value, float):
            unit = next((item.unit for item in field.metadata if isinstance(getattr(item, "unit", None), str)), "1")
            found.append(((*above, name), unit))
    return found


def with_key(part: Any, path: tuple[str, ...], change: float) -> Any:
    """A part with a number among its keys changed."""
    name, *rest = path
    inner = getattr(part, name)
    changed = with_key(inner, tuple(rest), change) if rest else inner + change
    return part.model_copy(update={name: changed})


class Sensitivities:
    """How a change of anything moves the minimum: -(J^T J)^-1 J^T of the change of the residual (first order)."""

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

    def of_model(self, path: tuple[str, ...], std: float) -> Floats:
        """Shift (p,) of the free unknowns for one standard uncertainty of a key of the model."""
        up, down = (self._errors(with_key(self._residual.model, path, side * std), self._x) for side in (1, -1))
        return self._shift(0.5 * (up - down))

    def of_parameter(self, place: int, step: float) -> Floats:
        """Shift for a step of a parameter that is not free."""
        return self._shift(self.column(place, step) * step)

    def column(self, place: int, step: float) -> Floats:
        """Derivative (n,) of the residual by a parameter that is not free."""
        if (place, step) not in self._columns:
            up, down = self._x.copy(), self._x.copy()
            up[place] += step
            down[place] -= step
            high, low = (self._residual.errors(self._record, x) for x in (up, down))
            self._columns[place, step] = (high - low) / (2 * step)
        return self._columns[place, step]

    def of_force(self, share: float) -> Floats:
        """Shift for a force that reads too much by a share of itself."""
        return self._shift(-share * self._record.weight * self._record.force)

    def of_position(self, share: float) -> Floats:
        """Shift for a position, rate and acceleration that read too much by a share."""
        record, history = self._record, self._record.history
        fixed = float(record.height.max())
        if history is not None:
            history = history * np.array([1.0, 1 + share, 1 + share, 1 + share])
            history[:, 1:3] -= fixed * share
        stretched = replace(
            record,
            height=fixed + (record.height - fixed) * (1 + share),
            rate=record.rate * (1 + share),
            acceleration=record.acceleration * (1 + share),
            history=history,
        )
        return self._shift(self._residual.errors(stretched, self._x) - self._residual.errors(record, self._x))

    def _shift(self, change: Floats) -> Floats:
        return np.asarray(-self._inverse @ (self.jacobian.T @ change))

    def _errors(self, model: ContactModel, x: Floats) -> Floats:
        """Residual of another model, which is not worth compiling."""
        record = self._record
        if model.memory:
            return Residual(model, ()).errors(record, x)
        expected = reading(model, x.tolist(), list(record.parts), record.transition)
        return np.asarray(record.weight * (expected - record.force))


def shift_of(source: BudgetSource, found: Sensitivities, places: Mapping[str, int]) -> Floats:
    """Shift (p,) of the free unknowns for one standard uncertainty of a source."""
    if source.path:
        return found.of_model(source.path, source.std)
    if source.name == "force_scale":
        return found.of_force(source.std)
    if source.name == "position_scale":
        return found.of_position(source.std)
    return found.of_parameter(places[source.name], source.std)


def row(
    source: str, std: float | None, unit: str, shift: Floats, step: float, names: list[str], x: Floats
) -> dict[str, Any]:
    """One row of the budget; `shift` is what a change of `step` does to the unknowns of these names and values."""
    effects = {}
    for name, moved, value in zip(names, shift.tolist(), x.tolist(), strict=True):
        sensitivity = moved / step if step else 0.0
        contribution = None if std is None else abs(sensitivity) * std
        percent = 100.0 * contribution / abs(value) if contribution is not None and value else None
        effects[name] = {"sensitivity": sensitivity, "contribution": contribution, "percent": percent}
    return {"source": source, "u": std, "unit": unit, "effects": effects}
