"""The contact on a skin that is not level or not flat under the tip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from palpate import Angle, Depth, Floats, Indenter, Settings, select
from pydantic import Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from palpate_models.indenters.cones import TruncatedCone
from palpate_models.indenters.power_profiles import Flat
from palpate_models.indenters.tilted_flat import TiltedFlat
from palpate_models.thickness import Layer, Thickness, contact_validity, corrected_contact

FLAT: Literal["flat"] = "flat"
_FACES = (Flat, TiltedFlat, TruncatedCone)  # tips under which curvature is not known
_MAX_INCLINATION = math.radians(45.0)  # a choice; compared with contact by friction up to 30 degrees (0260)
_NEWTON_STEPS = 3  # for the depth that a tip alone would have, a choice; exact in one for a paraboloid
_APEX_DEPTH = 1e-4  # [m], a choice: there the tip's own radius is taken
_MAX_TURN_SHARE = 0.5  # of cos t, a choice: depth over R + R_1 beyond which the normal is held
_MAX_CONTACT_SHARE = 0.3  # of the skin's radius, a choice: a larger contact is not small against it


class _FlatInTheSchema:
    """An entry of the JSON schema that allows "flat"."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"enum": [FLAT]}, handler(schema)]}


SkinRadius = Annotated[Literal["flat"] | Depth, _FlatInTheSchema()]


class Skin(Settings):
    """The skin under the tip: its inclination t where the tool's axis meets it, and its principal radii of curvature.

    A sphere of radius R that moves by d along its axis goes d_n into the skin along the normal, d_n = d cos t, and
    feels F_n there; along its axis it feels F_n (cos t + s m sin t tan t), m = 2 (1 - nu)/(2 - nu): a tip that sticks
    (s = 1) drags the skin along by d sin t, one that slides (s = 0) does not. On a skin that is curved along the
    inclination it touches off the axis, where sin t_0 = sin t R_1/(R + R_1), and the normal turns as it goes in:
    with L = R + R_1, d_n = L - sqrt(L^2 - 2 L d cos t_0 + d^2) and cos t' = (L cos t_0 - d)/(L - d_n) in place of
    cos t. Curvature takes the tip's own 1/R to sqrt((1/R + 1/R_1)(1/R + 1/R_2)): on a cylinder of 3 R the force is
    0.2 % below that of the elliptic contact, in a groove of 3 R 0.4 %, less on gentler ones; any other rounded tip
    has r^2/2 times the difference added to its profile. Viscosity has the same geometry: a cos t' d' in place of a d'.
    Only spheres are known on an inclination; the contact has to be small against the skin's radius.
    Source: Hertz 1882; Mindlin 1949; Johnson 1985, sections 4.2 and 7.2.
    """

    inclination: Angle = Field(
        default=0.0,
        ge=0,
        le=_MAX_INCLINATION,
        description="angle t between the tool's axis and the skin's normal where it meets it",
    )
    skin_radius: SkinRadius = Field(
        default=FLAT,
        description="principal radius R_1 of the skin along the inclination: positive where it bulges, negative in a "
        'hollow, or "flat"',
    )
    skin_radius_across: SkinRadius | None = Field(
        default=None, description="principal radius R_2 across it; left out: skin_radius, as on a sphere"
    )
    stick: float = Field(
        default=0.5,
        ge=0,
        le=1,
        description="s: 0 where the tip slides on an inclination, 1 where it sticks; midway where it is not known",
    )

    @property
    def curvatures(self) -> tuple[float, float]:
        """1/R_1 and 1/R_2 [1/m]."""
        across = self.skin_radius if self.skin_radius_across is None else self.skin_radius_across
        return _curvature(self.skin_radius), _curvature(across)

    def check(self, indenter: Indenter) -> None:
        """Raise ValueError where a tip cannot touch such a skin, or its contact is not known."""
        if 0.0 in (self.skin_radius, self.skin_radius_across):
            raise ValueError('skin: a radius of 0 is not a skin; write "flat" where it is not curved')
        if not any(self.curvatures):
            return
        if isinstance(indenter, _FACES):
            raise ValueError(f"skin: curvature is known for rounded tips, not for the face of a {_name(indenter)}")
        tip_radius = float(indenter.contact_radius(_APEX_DEPTH)) ** 2 / _APEX_DEPTH
        if min(self.curvatures) * tip_radius <= -1.0:
            hollow = -1e3 / min(self.curvatures)
            raise ValueError(
                f"skin: a hollow of radius {hollow:.3g} mm is too narrow for a tip of {1e3 * tip_radius:.3g} mm"
            )

    def contact(self, indenter: Indenter, thickness: Layer, poisson: float, depth: Any) -> tuple[Any, Any]:
        """Return area [m^2] and length [m] in place of A(d) c(d) and its derivative, for depths along the tool."""
        tip_radius = indenter.contact_radius(depth) ** 2 / depth  # 2 r^2/z of the tip, R of a sphere
        normal_depth, cosine = self._along_the_normal(tip_radius, depth)
        if any(self.curvatures):
            curvature = _added_curvature(tip_radius, *self.curvatures)
            area, radius = _curved_contact(indenter, thickness, curvature, tip_radius, normal_depth)
        else:
            area, radius = corrected_contact(indenter, thickness, normal_depth)
        if not self.inclination:
            return area, radius
        # The force along the tool: cos t + s m sin t tan t, with Mindlin's m = 2 (1 - nu)/(2 - nu).
        drag = self.stick * 2.0 * (1.0 - poisson) / (2.0 - poisson)
        axial = cosine + drag * (1.0 - cosine * cosine) / cosine
        return area * axial, radius * axial * cosine

    def _along_the_normal(self, tip_radius: Any, depth: Any) -> tuple[Any, Any]:
        """Return the depth d_n [m] along the normal and cos t', at a depth along the tool.

        `tip_radius` R [m]; t' is the angle between tool and normal once the normal has turned with the depth. With
        L = R + R_1 and the turn q = d/L these are d_n = d (2 cos t_0 - q)/(1 + r) and cos t' = (cos t_0 - q)/r,
        r = sqrt(1 - q (2 cos t_0 - q)).
        """
        if not self.inclination:
            return depth, 1.0
        cosine: Any = math.cos(self.inclination)
        # cos t_0 where the tip touches first.
        curvature = self.curvatures[0]
        if curvature:
            cosine = (1.0 - (math.sin(self.inclination) / (1.0 + tip_radius * curvature)) ** 2) ** 0.5
        # d_n and cos t' with d/L, without the differences of large lengths.
        turn = depth * curvature / (1.0 + tip_radius * curvature)
        max_turn = _MAX_TURN_SHARE * cosine
        turn = select(turn - max_turn, 0.0, max_turn, turn)  # deeper the tip would come off at the side
        root = (1.0 - turn * (2.0 * cosine - turn)) ** 0.5
        return depth * (2.0 * cosine - turn) / (1.0 + root), (cosine - turn) / root

    def inclination_at(self, indenter: Indenter, depth: float) -> float:
        """Return the angle t' [rad] between tool and normal at the contact, at a depth [m] along the tool."""
        tip_radius = float(indenter.contact_radius(depth)) ** 2 / depth
        return math.acos(self._along_the_normal(tip_radius, depth)[1])

    def validity(self, indenter: Indenter, depth: float) -> str:
        """Return a warning where the geometry does not hold at a depth [m] along the tool; else an empty text."""
        if self.inclination and indenter.sphere_radius is None:
            return f"an inclined skin is known under spheres, not under a {_name(indenter)}"
        curvature = max(map(abs, self.curvatures))
        share = float(indenter.contact_radius(depth)) * curvature
        if share <= _MAX_CONTACT_SHARE:
            return ""
        return f"the contact is {share:.0%} of the skin's radius; its curvature is known to {_MAX_CONTACT_SHARE:.0%}"


def curved_share(model: Any, curvature: Floats, depth: Floats) -> Floats | None:
    """See `ContactModel.curved_share`, of a model with an indenter; NaN in a hollow that is narrower than the tip."""
    tip = model.indenter
    if model.skin is not None or isinstance(tip, _FACES):
        return None
    tip_radius = tip.contact_radius(depth) ** 2 / depth
    fits = (1.0 + tip_radius[:, None] * curvature > 0.0).all(axis=1)
    added = _added_curvature(tip_radius, *np.where(fits[:, None], curvature, 0.0).T)
    area, _ = _curved_contact(tip, model.thickness, added, tip_radius, depth)
    return np.where(fits, area / corrected_contact(tip, model.thickness, depth)[0], np.nan)


def _curvature(radius: Literal["flat"] | float) -> float:
    """Return 1/R [1/m]; 0 for "flat"."""
    return 0.0 if isinstance(radius, str) else 1.0 / radius


def _added_curvature(tip_radius: Any, along: Any, across: Any) -> Any:
    """Return the curvature k [1/m] that a skin of two curvatures adds to that of a tip of a radius [m]."""
    return ((1.0 / tip_radius + along) * (1.0 / tip_radius + across)) ** 0.5 - 1.0 / tip_radius


def _curved_contact(
    indenter: Indenter, thickness: Layer, curvature: Any, tip_radius: Any, depth: Any
) -> tuple[Any, Any]:
    """Return area [m^2] and its derivative by depth [m] of a tip on a skin that adds k x^2 to its reduced profile g.

    k is the `curvature` [1/m], `tip_radius` [m] the tip's contact radius squared over depth, which is R of a sphere.
    The contact radius a is that of the tip alone at the depth u of its own profile, u = g(a), u + k a(u)^2 = d. The
    area is the integral of d - g(x) - k x^2 over 0..a: A(u) + k a^3 - k a^3/3. A layer has the tip's factor at u:

        d/dd [A c(u)] = a c + A c'(u) du/dd,    du/dd = 1/(1 + k d(a^2)/du)

    with d(a^2)/du = p a^2/u, exact where a^2 is proportional to u^p, as of cones, paraboloids and any other power.
    """
    # The depth u by Newton's method, from the root of a paraboloid; its slope may stay that of the start.
    u = depth / (1.0 + curvature * tip_radius)
    power = _square_power(indenter, u)
    for _ in range(_NEWTON_STEPS):
        skin_depth = curvature * indenter.contact_radius(u) ** 2
        u = u - (u + skin_depth - depth) / (1.0 + skin_depth * power / u)
    radius = indenter.contact_radius(u)
    area = indenter.profile_area(u) + 2.0 / 3.0 * curvature * radius**3
    if not isinstance(thickness, Thickness):
        return area, radius
    factor, log_slope = thickness.factor(indenter, u)  # c and u c'(u)
    depth_ratio = u + _square_power(indenter, u) * curvature * radius**2  # u/(du/dd)
    return area * factor, radius * factor + area * log_slope / depth_ratio


def _square_power(indenter: Indenter, depth: Any) -> Any:
    """Return p of a contact radius with a^2 proportional to d^p: 2 (a d/A - 1), since A is the integral of a."""
    return 2.0 * (indenter.contact_radius(depth) * depth / indenter.profile_area(depth) - 1.0)


def _name(indenter: Indenter) -> str:
    return type(indenter).__name__


@dataclass(frozen=True)
class ContactGeometry:
    """Everything about a contact but its material: tip, layer, skin and Poisson's ratio."""

    indenter: Indenter
    thickness: Layer
    skin: Skin | None
    poisson: float

    @classmethod
    def of(cls, model: Any) -> ContactGeometry:
        """Return the geometry of a contact model with these keys."""
        return cls(model.indenter, model.thickness, model.skin, model.poisson)

    def check(self) -> None:
        """Raise ValueError where a correction is not known for the tip or the Poisson's ratio."""
        if isinstance(self.thickness, Thickness):
            self.thickness.check(self.indenter, self.poisson)
        if self.skin is not None:
            self.skin.check(self.indenter)

    def contact(self, depth: Any) -> tuple[Any, Any]:
        """Return A [m^2] and its derivative a [m] at a depth [m]: F = 2 E/(1 - nu^2) A + 4 eta/(1 - nu) a d'."""
        if self.skin is None:
            return corrected_contact(self.indenter, self.thickness, depth)
        return self.skin.contact(self.indenter, self.thickness, self.poisson, depth)

    def validity(self, depth: float) -> str:
        """Return a warning where the geometry does not hold at a depth [m]; else an empty text."""
        tip_and_layer = contact_validity(self.indenter, self.thickness, depth)
        skin = "" if self.skin is None else self.skin.validity(self.indenter, depth)
        return "; ".join(text for text in (tip_and_layer, skin) if text)
