"""What a simulated tip presses on: material, shape of its surface, inclusions."""

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
    Quantity,
    Setpoint,
    Settings,
    Surface,
    to_si,
)
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from palpate_simulation.inclusions import Inclusion
from palpate_simulation.paper_specimens import SPECIMENS
from palpate_simulation.skin_form import SkinForm
from palpate_simulation.skin_on_surface import SkinOnSurface
from palpate_simulation.specimen_layers import Layer, layered_factors
from palpate_simulation.specimen_scatter import Conditioning, Scatter
from palpate_simulation.surface_relief import Relief

_SLIP = 1e-4  # [m/s] of sliding over which friction comes up
_ROUND = (1e-6, 1e-4, 0.02)  # [m] depths at which a round tip has the same radius a^2/d, and within what


def _shorthand(schema: dict[str, Any]) -> None:
    """Parameters next to the model, and what the paper's specimen of a name has, are not mistakes of the table."""
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

    model_config = ConfigDict(json_schema_extra=_shorthand)

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
    def _gather_parameters(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        data = _with_the_papers(data)
        if "parameters" in data:
            return data
        own = {key: value for key, value in data.items() if key in cls.model_fields}
        beside = {key: value for key, value in data.items() if key not in own}
        return own | {"parameters": {key: _plain(value) for key, value in beside.items()}}

    @field_validator("model")
    @classmethod
    def _without_a_stated_skin(cls, model: ContactModel) -> ContactModel:
        """Return the model as it is on a level, flat skin: what the true skin is, `relief` says."""
        return model if getattr(model, "skin", None) is None else model.model_copy(update={"skin": None})

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

    @model_validator(mode="after")
    def _layers_need_a_tip(self) -> Self:
        if self.layers and self.indenter is None:
            raise ValueError(
                "layers need a model with an indenter: the depth that is felt depends on the contact's radius"
            )
        if self.layers and self.model.memory:
            raise ValueError("a model with memory can have no layers")
        return self

    @model_validator(mode="after")
    def _a_curved_skin_needs_a_round_tip(self) -> Self:
        if self.body is not None:
            return self._with_a_body()
        curvatures = (0.0, 0.0) if self.relief.form is None else self.relief.form.curvatures
        if not any(curvatures):
            return self
        if not self.tip_radius:
            raise ValueError("relief: radius_x, radius_y need a model whose indenter has a round end, as a sphere has")
        if min(curvatures) * self.tip_radius <= -1.0:
            raise ValueError("relief: a hollow is narrower than the tip")
        return self

    def _with_a_body(self) -> Self:
        if self.relief.form is not None:
            raise ValueError("relief: tilt and radii are those of body: leave one of them out")
        if not self.tip_radius:
            raise ValueError("body needs a model whose indenter has a round end, as a sphere has")
        if any(inclusion.shape != "sphere" for inclusion in self.inclusions):
            raise ValueError('inclusions: below the skin of a body they have shape = "sphere"')
        _ = self.over_inclusions
        return self

    @cached_property
    def form(self) -> SkinForm | SkinOnSurface | None:
        """The skin where it is a body's, tilted or curved; None where it is level and flat but for its roughness."""
        return self.relief.form if self.body is None else SkinOnSurface(self.body)

    @cached_property
    def over_inclusions(self) -> list[Floats]:
        """Places (3,) [m] of a body's skin over its inclusions."""
        return [self.form.over(one.place) for one in self.inclusions] if isinstance(self.form, SkinOnSurface) else []

    @property
    def indenter(self) -> Indenter | None:
        """The tip, of a model that has one."""
        return getattr(self.model, "indenter", None)

    @cached_property
    def tip_radius(self) -> float:
        """Radius [m] of a tip with a round end; 0 of any other, which counts as its lowest point."""
        if self.indenter is None:
            return 0.0
        shallow, deep, within = _ROUND
        radius, other = (float(self.indenter.contact_radius(depth)) ** 2 / depth for depth in (shallow, deep))
        return radius if abs(other / radius - 1.0) < within else 0.0

    @cached_property
    def layered(self) -> tuple[Floats, Floats]:
        """Depths [m] and the factors of the layers at them."""
        assert self.indenter is not None
        return layered_factors(self.layers, self.indenter)

    def upright_place(self, position: Floats, velocity: Floats, out: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Positions and velocities (n, 3) of an upright tip whose round end is where that of a turned tool is.

        `out` (n, 3) points from the tip along the tool, and changes at a `rate` (n, 3) [1/s].
        """
        radius = self.tip_radius
        return position + radius * (out - np.array([0.0, 0.0, 1.0])), velocity + radius * rate

    def conditioned(self, earlier: Iterable[tuple[float, float]]) -> Self:
        """Return the specimen after palpations at distances [m] and ages [s]."""
        if self.conditioning is None:
            return self
        return self.model_copy(update={"palpated": self.palpated + self.conditioning.left_of(earlier)})

    def with_friction(self, contact: Floats, velocity: Floats) -> Floats:
        """Force (n, 3) [N] on a tip: the contact force (n,) along z, friction against its velocity (n, 3) [m/s].

        Friction is mu F tanh(|v|/(0.1 mm/s)), v the velocity along the surface.
        """
        sliding = velocity[:, :2]
        speed = np.linalg.norm(sliding, axis=1)
        friction = self.friction * contact * np.tanh(speed / _SLIP) / np.maximum(speed, 1e-12)
        return np.column_stack([-friction[:, None] * sliding, contact])

    def refuse(self, setpoint: Setpoint) -> None:
        """Raise ConfigurationError where a motion goes through the material or touches off it."""
        x, y, z = setpoint.position.T
        if isinstance(self.form, SkinOnSurface):
            place = setpoint.position - np.array([0.0, 0.0, self.surface])
            self.form.refuse(place)
            depth = -self.form.near(place)[0]
        else:
            depth = self.surface + self.relief.height_at(x, y) - z
        if self.thickness is not None and depth.max() >= self.thickness:
            raise ConfigurationError(
                f"the trajectory goes {1e3 * depth.max():.3g} mm deep, beyond the specimen's thickness of "
                f"{1e3 * self.thickness:.3g} mm"
            )
        for outside, what in self._edges(x, y):
            beside = outside & (depth > 0)
            if beside.any():
                first = int(np.argmax(beside))
                raise ConfigurationError(
                    f"the trajectory touches at x = {1e3 * x[first]:.3g} mm, y = {1e3 * y[first]:.3g} mm, outside the "
                    f"specimen of {what}"
                )

    def _edges(self, x: Floats, y: Floats) -> Iterator[tuple[Any, str]]:
        """Where x, y (n,) [m] are outside of the specimen, and its size in words; for each size that it has."""
        if self.size is not None:
            wide, high = self.size
            outside = (np.abs(x) > wide / 2 + 1e-9) | (np.abs(y) > high / 2 + 1e-9)
            yield outside, f"{1e3 * wide:.3g} mm x {1e3 * high:.3g} mm"
        if self.diameter is not None:
            yield np.hypot(x, y) > self.diameter / 2 + 1e-9, f"{1e3 * self.diameter:.3g} mm of diameter"


def _with_the_papers(data: dict[str, Any]) -> dict[str, Any]:
    """Return a specimen's table, completed from the paper's specimen of its name."""
    known = dict(SPECIMENS.get(str(data.get("name")), {}))
    if "parameters" in data:
        known = {key: value for key, value in known.items() if key in Specimen.model_fields}
    if "size" in data:
        known.pop("diameter", None)
    return known | data


class _Plain(float):
    """A number next to the model, without a unit, as a person writes it."""


def _plain(value: Any) -> Any:
    return _Plain(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _quantity(name: str, given: Any, unit: str) -> float:
    if isinstance(given, _Plain) and (doubt := Quantity(unit).doubt(given)):
        raise ValueError(f"{name}: {doubt}")
    try:
        return to_si(given, unit)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
