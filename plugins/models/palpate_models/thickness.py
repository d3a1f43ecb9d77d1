"""A layer of finite thickness is stiffer, or softer, than the half-space of the contact theories."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from palpate import Depth, Indenter, InputFile, Settings
from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from palpate_models.indenters.cones import Cone
from palpate_models.indenters.power_profiles import Flat, Paraboloid, Sphere
from palpate_models.indenters.spheres import Ellipsoid, ExactSphere, NeoHookeanSphere
from palpate_models.thickness_table import read_table

# Coefficients of 1, X, X^2, X^3, X^4 at nu = 0.5; X is contact radius over layer height. Sources: see `Thickness`.
# By base, bonded or not:
_DIMITRIADIS = {True: (1.0, 1.133, 1.283, 0.769, 0.0975), False: (1.0, 0.884, 0.781, 0.386, 0.0048)}
HALF_SPACE = "half-space"
_HALF_PI = math.pi / 2  # Garcia's variable for the cone is d/(h tan t) = pi/2 times contact radius over height
# By shape of the tip:
_GARCIA = {
    "sphere": (1.0, 1.133, 1.497, 1.469, 0.755),
    "flat": (1.0, 1.133, 1.283, 0.598, -0.291),
    "cone": tuple(c * _HALF_PI**i for i, c in enumerate((1.0, 0.721, 0.650, 0.491, 0.225))),
}
# a, b, f, g of the fit to finite elements (benchmarks/finite_elements.py); by bonded base and sticking tip.
_CYLINDER = {
    (True, False): (0.768, 1.555, -0.267, -0.027),
    (False, False): (0.383, 0.617, -0.063, -0.032),
    (True, True): (0.576, 2.217, -0.039, 0.025),
}
_CYLINDER_SHAPE = 50 / 22  # diameter over height of the cylinder in the finite elements
_CYLINDER_RADII = (2 / 22, 10 / 22)  # of the sphere, over height
_CYLINDER_DEPTH = 5 / 22  # over height, the deepest of the finite elements
_SPHERE_SHAPE = 0.15  # the exact sphere at large strain: 1 - 0.15 d/R (see `neo-hookean-sphere`)
_SHAPE_TOLERANCE = 0.05  # a choice: relative difference of diameter/height up to which the fit holds
_ROUNDING = 1e-3  # a choice: relative excess of a limit that rounding of its statement may have
_MAX_STRAIN = 0.1  # depth over height to which the corrections are derived (Dimitriadis et al. 2002)


@dataclass(frozen=True)
class _Contact:
    """Nominal contact radius a = scale d^power, as the published corrections use it."""

    shape: Literal["sphere", "flat", "cone"]
    scale: float
    power: float
    radius: float = math.nan  # [m] of the sphere


class Thickness(Settings):
    """Correction of the half-space for a layer of height h on a rigid base, for incompressible material (nu = 0.5).

    The elastic force of the half-space is multiplied by c(d). With X = a/h, where a = sqrt(R d) for spheres of any
    kind, R for a flat tip and 2 d/(pi tan t) for a cone:
    `dimitriadis` (sphere): bonded 1 + 1.133 X + 1.283 X^2 + 0.769 X^3 + 0.0975 X^4, not bonded
    1 + 0.884 X + 0.781 X^2 + 0.386 X^3 + 0.0048 X^4.
    `garcia` (sphere, flat, cone; bonded): sphere 1 + 1.133 X + 1.497 X^2 + 1.469 X^3 + 0.755 X^4, flat
    1 + 1.133 X + 1.283 X^2 + 0.598 X^3 - 0.291 X^4, cone 1 + 0.721 Y + 0.650 Y^2 + 0.491 Y^3 + 0.225 Y^4, Y = pi X/2.
    `finite-cylinder` (paraboloid `sphere`; free side, diameter/height 50/22): with e = d/R and X,
    (1 - 0.15 e)(1 + a X + b X^2 + f X e + g e), fitted to finite elements of a neo-Hookean cylinder within 0.9 %; it
    holds the exact shape of the sphere and large strain, too.
    `table` (any smooth tip and size): finite elements of the specimen under the tip, from
    `palpate model thickness`, 1 + a polynomial of degree 4 in sqrt(d).
    None of the sources treats speed. By the correspondence principle for a material of Kelvin-Voigt type, the viscous
    force follows from the derivative of the corrected elastic one, d/dd [A(d) c(d)], in place of a(d); so it is here.
    Source: Dimitriadis et al. 2002, eqs. 12 and 13; Garcia and Garcia 2018.
    """

    law: Literal["dimitriadis", "garcia", "finite-cylinder", "table"] = Field(
        default="table", description="which correction"
    )
    table: InputFile | None = Field(
        default=None, description="table: file of `palpate model thickness`, depths and factors"
    )
    height: Depth = Field(default=0.0, ge=0, description="height h of the layer; of a table it is in the file")
    bonded: bool | None = Field(
        default=None,
        description="whether the layer is glued to its base, or may slide; not stated: taken as glued",
    )
    sticking: bool = Field(default=False, description="finite-cylinder: whether the tip sticks to the surface")
    diameter: Depth | None = Field(default=None, gt=0, description="finite-cylinder: diameter of the specimen")
    radius: Depth | None = Field(
        default=None, gt=0, description="radius R of the sphere that approximates the tip, if it is not a sphere"
    )

    @model_validator(mode="after")
    def _check_law(self) -> Self:
        """Raise ValueError where keys are missing that the law needs, or stated that it does not have."""
        if (self.law == "table") != (self.table is not None):
            raise ValueError('a table of factors is law = "table", and that law needs a table = "thickness.csv"')
        if self.table is not None:
            read_table(self.table)
            if self.height or self.diameter is not None or self.sticking or self.radius is not None:
                raise ValueError("height, diameter, sticking and radius of a table are in its file")
            return self
        if self.height <= 0:
            raise ValueError(f"{self.law} needs the height of the layer")
        if self.law == "garcia" and not self.is_bonded:
            raise ValueError("garcia is for a bonded layer; dimitriadis has one that is not (for spheres)")
        if self.law == "finite-cylinder":
            if self.diameter is None:
                raise ValueError("finite-cylinder needs the diameter of the specimen")
            shape = self.diameter / self.height
            if abs(shape / _CYLINDER_SHAPE - 1) > _SHAPE_TOLERANCE:
                raise ValueError(f"finite-cylinder is for diameter/height 2.27 (50 by 22 mm), not {shape:.2f}")
            if (self.is_bonded, self.sticking) not in _CYLINDER:
                raise ValueError("finite-cylinder with a sticking tip is known for a bonded base only")
        elif self.sticking or self.diameter is not None:
            raise ValueError(f"sticking and diameter belong to finite-cylinder, not to {self.law}")
        return self

    @property
    def is_bonded(self) -> bool:
        """Return True for a layer that is glued to its base, which one is of which nobody states it."""
        return self.bonded is not False

    def check(self, indenter: Indenter, poisson: float) -> None:
        """Raise ValueError where the correction is not known for a tip or a Poisson's ratio."""
        # All corrections are of incompressible material, with a Poisson's ratio of 0.5.
        if self.table is not None:
            read_table(self.table).refuse(indenter)
            if poisson != 0.5:
                raise ValueError(f"thickness: the corrections are for poisson = 0.5, not {poisson:g}")
            return
        contact = self._contact(indenter)
        if poisson != 0.5:
            raise ValueError(f"thickness: the corrections are for poisson = 0.5, not {poisson:g}")
        if self.law == "dimitriadis" and contact.shape != "sphere":
            if not self.is_bonded:
                raise ValueError(
                    f"thickness: a base on which the layer slides is known for spheres, not for a {contact.shape} tip"
                )
            raise ValueError(f"thickness: dimitriadis is for spheres, not for a {contact.shape} tip; try garcia")
        if self.law == "finite-cylinder":
            if not isinstance(indenter, Sphere):
                raise ValueError("thickness: finite-cylinder is for the tip 'sphere', whose true shape it corrects for")
            low, high = (self.height * limit for limit in _CYLINDER_RADII)
            if not (1.0 - _ROUNDING) * low <= indenter.radius <= (1.0 + _ROUNDING) * high:
                raise ValueError(
                    f"thickness: finite-cylinder is for radii of {1e3 * low:.3g} to {1e3 * high:.3g} mm here"
                )

    def _contact(self, indenter: Indenter) -> _Contact:
        """Return the nominal contact of a tip, of radius scale depth^power; raises ValueError without a correction.

        Of a flat tip it is the tip's radius, of a cone 2 d/(pi tan t), of all others sqrt(R d).
        """
        radius = self.radius
        if radius is None:
            match indenter:
                case Flat():
                    return _Contact("flat", indenter.radius, 0.0)
                case Cone():
                    return _Contact("cone", 2.0 / (math.pi * math.tan(indenter.angle)), 1.0)
                case Sphere() | ExactSphere() | NeoHookeanSphere():
                    radius = indenter.radius
                case Paraboloid():
                    radius = indenter.curvature_radius
                case Ellipsoid():
                    radius = indenter.radius**2 / indenter.height
                case _:
                    name = type(indenter).__name__
                    raise ValueError(
                        f"thickness: no correction is known for a {name}; give radius if it is like a sphere"
                    )
        return _Contact("sphere", math.sqrt(radius), 0.5, radius)

    def treats_as_sphere(self, indenter: Indenter) -> bool:
        """Return True for a tip that is a sphere, or stands for one; raises ValueError without a correction."""
        return self._contact(indenter).shape == "sphere"

    def factor(self, indenter: Indenter, depth: Any) -> tuple[Any, Any]:
        """Return c(d), and d c'(d), the factor's derivative times depth."""
        if self.table is not None:
            return read_table(self.table).factor(depth)
        contact = self._contact(indenter)
        x = contact.scale / self.height * depth**contact.power
        if self.law == "finite-cylinder":
            return self._cylinder_factor(x, depth / contact.radius)
        # Horner's scheme for both; d X'(d) is the contact's power times X.
        _, c1, c2, c3, c4 = _DIMITRIADIS[self.is_bonded] if self.law == "dimitriadis" else _GARCIA[contact.shape]
        factor = 1.0 + x * (c1 + x * (c2 + x * (c3 + x * c4)))
        return factor, contact.power * x * (c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * 4.0 * c4)))

    def _cylinder_factor(self, x: Any, e: Any) -> tuple[Any, Any]:
        """Return the factor of the finite cylinder and its derivative times depth, for X and e = d/R."""
        a, b, f, g = _CYLINDER[self.is_bonded, self.sticking]
        layer = 1.0 + a * x + b * x * x + f * x * e + g * e
        slope = a * x / 2.0 + b * x * x + 1.5 * f * x * e + g * e
        sphere = 1.0 - _SPHERE_SHAPE * e
        return sphere * layer, sphere * slope - _SPHERE_SHAPE * e * layer

    def validity(self, indenter: Indenter, depth: float) -> str:
        """Return a warning where the correction does not hold at a depth [m]; else an empty text."""
        if self.table is not None:
            deepest = read_table(self.table).deepest
            if depth <= (1.0 + _ROUNDING) * deepest:
                return ""
            return f"the table of thickness ends at {1e3 * deepest:.3g} mm, not {1e3 * depth:.3g} mm"
        contact = self._contact(indenter)
        strain, x = depth / self.height, contact.scale * depth**contact.power / self.height
        if self.law == "finite-cylinder":
            if strain <= (1.0 + _ROUNDING) * _CYLINDER_DEPTH:
                return ""
            limit = 1e3 * _CYLINDER_DEPTH * self.height
            return f"the thickness correction is fitted to depths of {limit:.3g} mm, not {1e3 * depth:.3g} mm"
        if x > 1:
            return f"the contact radius is {x:.2g} of the layer's height; the thickness correction is for less than 1"
        if strain > _MAX_STRAIN:
            return f"the depth is {strain:.0%} of the layer's height; the thickness correction is derived for 10 %"
        return ""


Layer = Thickness | Literal["half-space"] | None  # stated to be thick, or not stated


def corrected_contact(indenter: Indenter, thickness: Layer, depth: Any) -> tuple[Any, Any]:
    """Return A(d) c(d) [m^2] and its derivative [m]; without a correction the tip's own area and contact radius."""
    area, radius = indenter.profile_area(depth), indenter.contact_radius(depth)
    if not isinstance(thickness, Thickness):
        return area, radius
    factor, slope = thickness.factor(indenter, depth)
    return area * factor, radius * factor + area * slope / depth


def contact_validity(indenter: Indenter, thickness: Layer, depth: float) -> str:
    """Return a warning where a tip or a thickness correction does not hold at a depth [m]; else an empty text."""
    layer = thickness.validity(indenter, depth) if isinstance(thickness, Thickness) else ""
    return "; ".join(text for text in (indenter.validity(depth), layer) if text)


class _NoneInTheSchema:
    """An entry of the JSON schema that allows "none" and "half-space"."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"enum": ["none", HALF_SPACE]}, handler(schema)]}


OptionalThickness = Annotated[
    Thickness | Literal["half-space"] | None,
    BeforeValidator(lambda value: None if value == "none" else value),
    _NoneInTheSchema(),
]
