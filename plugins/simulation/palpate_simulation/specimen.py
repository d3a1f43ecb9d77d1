"""Specimen that a simulated tip presses on: material, shape of its surface, inclusions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from palpate import (
    ConfigurationError,
    ContactModel,
    Floats,
    Indenter,
    Length,
    Setpoint,
    Settings,
    Surface,
)
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from palpate_simulation.inclusions import Inclusion
from palpate_simulation.skin_form import SkinForm
from palpate_simulation.skin_on_surface import SkinOnSurface
from palpate_simulation.specimen_layers import Layer, layered_factors
from palpate_simulation.specimen_scatter import Conditioning, Scatter
from palpate_simulation.specimen_table import gather_parameters, parameter_in_si
from palpate_simulation.surface_relief import Relief

FULL_FRICTION_SPEED = 1e-4  # [m/s] of sliding over which friction comes up (a choice, for a smooth force)
STANDSTILL_SPEED = 1e-12  # [m/s], guards against a division by 0
# Depths [m] at which a round tip has the same radius a^2/d, and the difference that is allowed (choices).
SHALLOW_DEPTH, DEEP_DEPTH = 1e-6, 1e-4
ROUND_DIFFERENCE = 0.02
EDGE_ROUNDING = 1e-9  # [m] that a place may be outside of the specimen by rounding


def _allow_parameters(schema: dict[str, Any]) -> None:
    """Allow parameters next to the model in a JSON schema, and require nothing that a paper's specimen has."""
    schema["additionalProperties"] = {"anyOf": [{"type": "number"}, {"type": "string"}]}
    schema["properties"]["parameters"]["additionalProperties"] = schema["additionalProperties"]
    schema["required"] = ["model"]


class Specimen(Settings):
    """What the tip presses on: a contact model with its true parameters, at a height that is not declared.

    The parameters are next to the model, by name: ``{ model = "dr", elasticity = "112.5 kPa", ... }``. Inclusions make
    elastic and viscous parameters larger by 1 + the sum of their contrasts where the tip is, all by the same factor;
    layers on top of the material do so at each depth (see `specimen_layers`); relief makes the surface uneven: on one
    that is tilted or curved the force is along the local normal, and that of Hertz's elliptic contact. What `skin` of
    the model states is for the estimator alone.
    Left out, the specimen is homogeneous and level. With a `name`, what stands in the table replaces what the paper's
    specimen of that name has. A rigid base is felt where the model has a `thickness` correction, a tip that does not
    stand square where its indenter is `tilted-flat`, relaxation where the model has a memory. `scatter` and
    `conditioning` multiply the whole force.
    """

    model_config = ConfigDict(json_schema_extra=_allow_parameters)

    name: Literal["S1", "S2", "S3", "S4", "S5", "chicken", "chicken-sphere"] | None = Field(
        default=None, description="the paper's specimen it is based on; other keys override it"
    )
    model: ContactModel = Field(description="contact model of the truth; need not be one used for estimation")
    surface: Length = Field(default=0.0, description="height of the skin over the origin of the work frame")
    relief: Relief = Field(default=Relief(), description="tilt, roughness and swell of the skin")
    body: Surface | None = Field(
        default=None, description="surface that is its skin, such as an ellipsoid; relief has its roughness alone then"
    )
    inclusions: tuple[Inclusion, ...] = Field(default=(), description="stiffer or softer bodies below the skin")
    layers: tuple[Layer, ...] = Field(default=(), description="layers on top of the material, from the skin downwards")
    felt_at: Length = Field(
        default=0.004, gt=0, description="depth whose contact radius blurs the inclusions, at every depth of the tip"
    )
    thickness: Length | None = Field(default=None, gt=0, description="height of the material; no motion may go deeper")
    size: tuple[Length, Length] | None = Field(
        default=None, description="extent [x, y] around the origin; no motion may touch outside of it"
    )
    diameter: Length | None = Field(
        default=None, gt=0, description="of a round specimen around the origin; no motion may touch outside of it"
    )
    unloading: Literal["following", "ting"] = Field(
        default="following",
        description='"following": the contact follows the depth in loading and unloading; "ting": it shrinks faster in '
        "unloading, after Ting (1966), for one loading and one unloading of a model with a relaxation modulus",
    )
    friction: float = Field(
        default=0.0, ge=0, le=2, allow_inf_nan=False, description="coefficient of friction of the sliding tip"
    )
    scatter: Scatter | None = Field(default=None, description="stiffness that varies from place to place")
    conditioning: Conditioning | None = Field(default=None, description="softening by palpations of the same place")
    palpated: float = Field(
        default=0.0, ge=0, allow_inf_nan=False, description="palpations before this one; [repeat] counts them"
    )
    parameters: dict[str, float] = Field(description="true values by parameter name; may also be keys of this table")

    @model_validator(mode="before")
    @classmethod
    def _gather_parameters(cls, table: Any) -> Any:
        """Return the table with the parameters that stand next to the model under `parameters`."""
        return gather_parameters(table, cls.model_fields) if isinstance(table, dict) else table

    @field_validator("model")
    @classmethod
    def _drop_stated_skin(cls, model: ContactModel) -> ContactModel:
        """Return the model on a level, flat skin: the true skin is that of `relief`."""
        return model if getattr(model, "skin", None) is None else model.model_copy(update={"skin": None})

    @field_validator("parameters", mode="before")
    @classmethod
    def _convert_parameters(cls, entries: Any, info: ValidationInfo) -> Any:
        """Return the parameters in SI; raises ValueError for one that the model lacks, or that the table lacks."""
        model = info.data.get("model")
        if model is None or not isinstance(entries, dict):
            return {}
        units = {parameter.name: parameter.unit for parameter in model.parameters}
        for name in (*entries, *units):
            if name not in units or name not in entries:
                problem = "is unknown" if name in entries else "is missing"
                raise ValueError(f"parameter {name!r} {problem}; the specimen's model has: {', '.join(units)}")
        return {name: parameter_in_si(name, entries[name], unit) for name, unit in units.items()}

    @model_validator(mode="after")
    def _check_layers(self) -> Self:
        """Return the specimen; raises ValueError for layers under a model that cannot have any."""
        if self.layers and self.indenter is None:
            raise ValueError(
                "layers need a model with an indenter: the depth that is felt depends on the contact's radius"
            )
        if self.layers and self.model.memory:
            raise ValueError("a model with memory can have no layers")
        return self

    @model_validator(mode="after")
    def _check_skin(self) -> Self:
        """Return the specimen; raises ValueError for a curved skin under a tip that is not round, or too large."""
        if self.body is not None:
            return self._check_body()
        curvatures = (0.0, 0.0) if self.relief.form is None else self.relief.form.curvatures
        if not any(curvatures):
            return self
        if not self.tip_radius:
            raise ValueError("relief: radius_x, radius_y need a model whose indenter has a round end, as a sphere has")
        if min(curvatures) * self.tip_radius <= -1.0:
            raise ValueError("relief: a hollow is narrower than the tip")
        return self

    def _check_body(self) -> Self:
        """Return the specimen; raises ValueError for what a body's skin cannot have."""
        if self.relief.form is not None:
            raise ValueError("relief: tilt and radii are those of body: leave one of them out")
        if not self.tip_radius:
            raise ValueError("body needs a model whose indenter has a round end, as a sphere has")
        if any(inclusion.shape != "sphere" for inclusion in self.inclusions):
            raise ValueError('inclusions: below the skin of a body they have shape = "sphere"')
        _ = self.over_inclusions  # now, so that one off the skin is reported with the table
        return self

    @cached_property
    def form(self) -> SkinForm | SkinOnSurface | None:
        """Skin of a body, or one that is tilted or curved; None for a level, flat one, whatever its roughness."""
        return self.relief.form if self.body is None else SkinOnSurface(self.body)

    @cached_property
    def over_inclusions(self) -> list[Floats]:
        """Places (3,) [m] of a body's skin over its inclusions; none without a body."""
        if not isinstance(self.form, SkinOnSurface):
            return []
        return [self.form.over(inclusion.place) for inclusion in self.inclusions]

    @property
    def indenter(self) -> Indenter | None:
        """Tip of the model; None for a model without one."""
        return getattr(self.model, "indenter", None)

    @cached_property
    def tip_radius(self) -> float:
        """Radius R = a^2/d [m] of a tip with a round end; 0 of any other, which counts as its lowest point.

        The contact radius a of a round end grows as sqrt(R d) while the depth d is small.
        """
        if self.indenter is None:
            return 0.0
        radius = float(self.indenter.contact_radius(SHALLOW_DEPTH)) ** 2 / SHALLOW_DEPTH
        deeper_radius = float(self.indenter.contact_radius(DEEP_DEPTH)) ** 2 / DEEP_DEPTH
        return radius if abs(deeper_radius / radius - 1.0) < ROUND_DIFFERENCE else 0.0

    @cached_property
    def layered(self) -> tuple[Floats, Floats]:
        """Depths (m,) [m] and the factors (m,) by which the layers multiply the force there."""
        assert self.indenter is not None
        return layered_factors(self.layers, self.indenter)

    def upright_place(self, position: Floats, velocity: Floats, out: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities (n, 3) of an upright tip whose round end is at that of a turned tool.

        `position` [m] and `velocity` [m/s] (n, 3) are those of the turned tool's tip; the direction `out` (n, 3) points
        from it along the tool, and changes at a `rate` (n, 3) [1/s].
        """
        radius = self.tip_radius
        return position + radius * (out - np.array([0.0, 0.0, 1.0])), velocity + radius * rate

    def conditioned(self, earlier: Iterable[tuple[float, float]]) -> Self:
        """Return the specimen after palpations at distances [m] and ages [s]."""
        if self.conditioning is None:
            return self
        return self.model_copy(update={"palpated": self.palpated + self.conditioning.effective_count(earlier)})

    def with_friction(self, contact: Floats, velocity: Floats) -> Floats:
        """Return the force (n, 3) [N] on a tip with velocities (n, 3) [m/s]: `contact` (n,) [N] along z, and friction.

        Friction is mu F tanh(|v|/(0.1 mm/s)) against the velocity v along the surface.
        """
        sliding = velocity[:, :2]
        speed = np.linalg.norm(sliding, axis=1)
        friction = self.friction * contact * np.tanh(speed / FULL_FRICTION_SPEED) / np.maximum(speed, STANDSTILL_SPEED)
        return np.column_stack([-friction[:, None] * sliding, contact])

    def refuse(self, setpoint: Setpoint) -> None:
        """Raise ConfigurationError where a motion goes through the material or touches off it."""
        x, y, z = setpoint.position.T
        if isinstance(self.form, SkinOnSurface):
            position = setpoint.position - np.array([0.0, 0.0, self.surface])
            self.form.refuse(position)
            depth = -self.form.near(position)[0]
        else:
            depth = self.surface + self.relief.height_at(x, y) - z
        if self.thickness is not None and depth.max() >= self.thickness:
            raise ConfigurationError(
                f"the trajectory goes {1e3 * depth.max():.3g} mm deep, beyond the specimen's thickness of "
                f"{1e3 * self.thickness:.3g} mm"
            )
        for is_outside, size in self._edges(x, y):
            touches_outside = is_outside & (depth > 0)
            if touches_outside.any():
                first = int(np.argmax(touches_outside))
                raise ConfigurationError(
                    f"the trajectory touches at x = {1e3 * x[first]:.3g} mm, y = {1e3 * y[first]:.3g} mm, outside the "
                    f"specimen of {size}"
                )

    def _edges(self, x: Floats, y: Floats) -> Iterator[tuple[Any, str]]:
        """Yield for `size` and `diameter`, if stated: True (n,) for x, y (n,) [m] outside of it, and its text."""
        if self.size is not None:
            width, height = self.size
            is_outside = (np.abs(x) > width / 2 + EDGE_ROUNDING) | (np.abs(y) > height / 2 + EDGE_ROUNDING)
            yield is_outside, f"{1e3 * width:.3g} mm x {1e3 * height:.3g} mm"
        if self.diameter is not None:
            is_outside = np.hypot(x, y) > self.diameter / 2 + EDGE_ROUNDING
            yield is_outside, f"{1e3 * self.diameter:.3g} mm of diameter"
