"""What a sensor between flange and tip feels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Length, Settings, contact_force, to_si
from pydantic import Field, ValidationInfo, field_validator, model_validator

Floats = NDArray[np.float64]

GRAVITY = 9.80665  # [m/s^2]
_TORQUE_NOISE = 0.02  # N*m for one newton of force noise, of the order of the real sensor's


class Specimen(Settings):
    """What the tip presses on: a contact model with its true parameters, at a height that nobody is told.

    The parameters stand beside the model, by name: ``{ model = "dr", elasticity = "112.5 kPa", ... }``.
    """

    model: ContactModel = Field(description="contact model of the truth; need not be one that is estimated with")
    surface: Length = Field(default=0.0, description="height of the skin over the origin of the work frame")
    parameters: dict[str, float] = Field(description="true values by parameter name; may stand in the table itself")

    @model_validator(mode="before")
    @classmethod
    def _gather_parameters(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "parameters" in data:
            return data
        own = {key: value for key, value in data.items() if key in ("model", "surface")}
        return own | {"parameters": {key: value for key, value in data.items() if key not in own}}

    @field_validator("parameters", mode="before")
    @classmethod
    def _in_si(cls, given: Any, info: ValidationInfo) -> Any:
        model = info.data.get("model")
        if model is None or not isinstance(given, dict):
            return {}
        names = {parameter.name: parameter.unit for parameter in model.parameters}
        for name in (*given, *names):
            if name not in names or name not in given:
                problem = "is unknown" if name in given else "is missing"
                raise ValueError(f"parameter {name!r} {problem}; the specimen's model has: {', '.join(names)}")
        return {name: _quantity(name, given[name], unit) for name, unit in names.items()}

    def push(self, height: Floats, speed: Floats) -> Floats:
        """Contact force [N] (n,) on a tip at a height [m] over the origin that rises at a speed [m/s]."""
        theta = [self.parameters[parameter.name] for parameter in self.model.parameters]
        force: Floats = contact_force(self.model, self.surface - height, -speed, theta, pulls=False)
        return force


def _quantity(name: str, given: Any, unit: str) -> float:
    try:
        return to_si(given, unit)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def sensed_wrench(
    contact: Floats, acceleration: Floats, tip_mass: float, offset: Any, noise: Floats, noise_std: float, limit: float
) -> Floats:
    """Reading (n, 6) [N, N*m] = contact + inertia - weight + offset + noise, compressive positive, within the range.

    Contact force (n,) and offset [N] act along z, acceleration (n, 3) [m/s^2] is that of the tip, `noise` (n, 6) is
    standard normal.
    """
    wrench = np.zeros((len(contact), 6))
    wrench[:, :3] = -tip_mass * acceleration
    wrench[:, 2] += contact - tip_mass * GRAVITY + offset
    scaled = noise * noise_std
    scaled[:, 3:] *= _TORQUE_NOISE
    return np.clip(wrench + scaled, -limit, limit)
