"""What a simulated tip presses on: material, shape of its surface, inclusions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import ConfigurationError, ContactModel, Length, Setpoint, Settings, contact_force, force_over_time, to_si
from pydantic import Field, ValidationInfo, field_validator, model_validator

from palpate_devices.inclusions import Inclusion
from palpate_devices.relief import Relief

Floats = NDArray[np.float64]

_SLIP = 1e-4  # [m/s] of sliding over which friction comes up


class Specimen(Settings):
    """What the tip presses on: a contact model with its true parameters, at a height that nobody is told.

    The parameters stand beside the model, by name: ``{ model = "dr", elasticity = "112.5 kPa", ... }``. Inclusions make
    elastic and viscous parameters larger by 1 + the sum of their contrasts where the tip is, all by the same factor;
    relief makes the surface uneven. Left out, the specimen is homogeneous and level.
    """

    model: ContactModel = Field(description="contact model of the truth; need not be one that is estimated with")
    surface: Length = Field(default=0.0, description="height of the skin over the origin of the work frame")
    relief: Relief = Field(default=Relief(), description="tilt, roughness and swell of the skin")
    inclusions: tuple[Inclusion, ...] = Field(default=(), description="stiffer or softer bodies below the skin")
    felt_at: Length = Field(
        default=0.004, gt=0, description="depth whose contact radius blurs the inclusions, at every depth of the tip"
    )
    thickness: Length | None = Field(default=None, gt=0, description="height of the material; no motion may go deeper")
    size: tuple[Length, Length] | None = Field(
        default=None, description="extent [x, y] around the origin; no motion may touch outside of it"
    )
    friction: float = Field(
        default=0.0, ge=0, le=2, allow_inf_nan=False, description="coefficient of friction of the sliding tip"
    )
    parameters: dict[str, float] = Field(description="true values by parameter name; may stand in the table itself")

    @model_validator(mode="before")
    @classmethod
    def _gather_parameters(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "parameters" in data:
            return data
        own = {key: value for key, value in data.items() if key in cls.model_fields}
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

    def depth(self, position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """Depth [m] below the true skin and its rate [m/s], (n,), of a tip at positions (n, 3) with velocities."""
        height, along_x, along_y = self.relief.at(position[:, 0], position[:, 1])
        rise = along_x * velocity[:, 0] + along_y * velocity[:, 1]
        return self.surface + height - position[:, 2], rise - velocity[:, 2]

    def theta(self, x: Floats, y: Floats) -> list[Any]:
        """The model's parameters where a tip at x, y (n,) [m] feels them."""
        theta: list[Any] = [self.parameters[parameter.name] for parameter in self.model.parameters]
        if not self.inclusions:
            return theta
        indenter = getattr(self.model, "indenter", None)
        radius = 0.0 if indenter is None else float(indenter.contact_radius(self.felt_at))
        factor = 1.0 + sum(inclusion.contrast(x, y, radius) for inclusion in self.inclusions)
        factor = np.maximum(factor, 0.01)
        roles = [parameter.role for parameter in self.model.parameters]
        return [value * factor if role else value for value, role in zip(theta, roles, strict=True)]

    def push(self, instants: Floats, position: Floats, velocity: Floats) -> Floats:
        """Contact force (n,) [N] on a tip at positions (n, 3) with velocities (n, 3), at instants (n,) [s] in order.

        Raises ConfigurationError where a model with memory is asked for what it cannot: inclusions, or forgetting that
        is too fast for the instants.
        """
        depth, rate = self.depth(position, velocity)
        if not self.model.memory:
            theta = self.theta(position[:, 0], position[:, 1])
            return np.asarray(contact_force(self.model, depth, rate, theta, pulls=False), float)
        if self.inclusions:
            raise ConfigurationError("device sim: specimen: a model with memory can have no inclusions")
        values = [self.parameters[parameter.name] for parameter in self.model.parameters]
        try:
            return force_over_time(self.model, instants, depth, rate, values, pulls=False)
        except ValueError as error:
            raise ConfigurationError(f"device sim: specimen: {error}") from error

    def with_friction(self, contact: Floats, velocity: Floats) -> Floats:
        """Force (n, 3) [N] on a tip: the contact force (n,) along z, friction against its velocity (n, 3) [m/s].

        Friction is mu F tanh(|v|/(0.1 mm/s)), v the velocity along the surface.
        """
        sliding = velocity[:, :2]
        speed = np.linalg.norm(sliding, axis=1)
        friction = self.friction * contact * np.tanh(speed / _SLIP) / np.maximum(speed, 1e-12)
        return np.column_stack([-friction[:, None] * sliding, contact])

    def refuse(self, setpoint: Setpoint) -> None:
        """Raise ConfigurationError where a motion goes through the material or touches beside it."""
        x, y, z = setpoint.position.T
        height, _, _ = self.relief.at(x, y)
        depth = self.surface + height - z
        if self.thickness is not None and depth.max() >= self.thickness:
            raise ConfigurationError(
                f"the trajectory goes {1e3 * depth.max():.3g} mm deep, beyond the specimen's thickness of "
                f"{1e3 * self.thickness:.3g} mm"
            )
        if self.size is None:
            return
        outside = (np.abs(x) > self.size[0] / 2 + 1e-9) | (np.abs(y) > self.size[1] / 2 + 1e-9)
        beside = outside & (depth > 0)
        if beside.any():
            first = int(np.argmax(beside))
            raise ConfigurationError(
                f"the trajectory touches at x = {1e3 * x[first]:.3g} mm, y = {1e3 * y[first]:.3g} mm, outside the "
                f"specimen of {1e3 * self.size[0]:.3g} mm x {1e3 * self.size[1]:.3g} mm"
            )


def _quantity(name: str, given: Any, unit: str) -> float:
    try:
        return to_si(given, unit)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
