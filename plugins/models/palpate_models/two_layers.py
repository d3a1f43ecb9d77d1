"""A layer on a thick material of another stiffness: two moduli, the thickness known or not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from palpate import ContactModel, Depth, Indenter, MaterialValue, Parameter, log, select
from pydantic import Field, model_validator

from palpate_models.indenters.power_profiles import Sphere
from palpate_models.indenters.spheres import ExactSphere, NeoHookeanSphere
from palpate_models.parameters import ELASTICITY, VISCOSITY

SKIN_ELASTICITY = Parameter(
    "skin_elasticity", "E_s", "Pa", "Young's modulus of the layer on top", start=100e3, start_std=200e3
)
DEEP_ELASTICITY = Parameter(
    ELASTICITY.name,
    "E",
    ELASTICITY.unit,
    "Young's modulus of the material below the layer",
    start=ELASTICITY.start,
    start_std=ELASTICITY.start_std,
)
SKIN_THICKNESS = Parameter(
    "skin_thickness", "h_s", "m", "thickness of the layer on top", lower=1e-4, upper=0.1, start=3e-3, start_std=3e-3
)
_MAX_LOG_RATIO = math.log(12.5)  # of the moduli: the share is fitted to ratios of 1/12 to 12
_MAX_RADIUS_RATIO = 13.0  # contact radius over the layer's thickness to which the share is fitted
# Fitted to the exact solution of Dhaliwal and Rau (1970), see `TwoLayers`: coefficients of powers of ln(1 + x), each a
# polynomial in the logarithm of the moduli's ratio.
_SHARE = (
    (-0.06577, 0.41723, 0.00659, -0.00615, -0.00051),
    (1.01315, -0.66511, -0.12996, 0.01895, 0.00594),
    (0.42597, 0.51558, 0.02059, -0.02006, -0.00347),
    (-0.09906, -0.1084, 0.01322, 0.00451, 6e-05),
)


def layer_share(ratio: Any, x: Any) -> Any:
    """Return the share w with which the layer counts, E_s^w E^(1 - w), for the logarithm of E_s/E and x = sqrt(R d)/h.

    w = 1/(1 + x e^p), p a polynomial in ln(1 + x) and ln(E_s/E), both held beyond the range they are fitted in.
    """
    width = log(1.0 + select(x - _MAX_RADIUS_RATIO, 0.0, _MAX_RADIUS_RATIO + 0.0 * x, x))
    bounded = select(ratio - _MAX_LOG_RATIO, 0.0, _MAX_LOG_RATIO + 0.0 * ratio, ratio)
    bounded = select(-_MAX_LOG_RATIO - bounded, 0.0, -_MAX_LOG_RATIO + 0.0 * ratio, bounded)
    # Horner's scheme in the width.
    power: Any = 0.0
    for row in reversed(_SHARE):
        power = power * width + sum(coefficient * bounded**i for i, coefficient in enumerate(row))
    return 1.0 / (1.0 + x * math.e**power)


class _LayeredMaterial(ContactModel):
    """The common part of both models of two layers."""

    law_error: ClassVar[float] = 0.0036

    indenter: Indenter = Field(description="the tip, a sphere")

    @model_validator(mode="after")
    def _check_tip(self) -> Self:
        if not isinstance(self.indenter, Sphere | ExactSphere | NeoHookeanSphere):
            raise ValueError(
                f"indenter: two layers are known under spheres, not under a {type(self.indenter).__name__}"
            )
        return self

    @property
    def _radius(self) -> float:
        assert isinstance(self.indenter, Sphere | ExactSphere | NeoHookeanSphere)
        return self.indenter.radius

    def _layered_force(self, depth: Any, rate: Any, theta: Sequence[Any], thickness: Any) -> Any:
        """8/3 E_s^w E^(1 - w) A(d) + 8 eta a(d) d' [N]."""
        skin, deep, viscosity = theta[:3]
        x = (self._radius * depth) ** 0.5 / thickness
        modulus = deep * (skin / deep) ** layer_share(log(skin / deep), x)
        elastic = 8.0 / 3.0 * modulus * self.indenter.profile_area(depth)
        return elastic + 8.0 * viscosity * self.indenter.contact_radius(depth) * rate

    def _validity(self, depth: float, thickness: float) -> str:
        """Return a warning beyond the range of the tip or of the share's fit; else an empty text."""
        x = math.sqrt(self._radius * depth) / thickness
        tip = self.indenter.validity(depth)
        wide = (
            ""
            if x <= _MAX_RADIUS_RATIO
            else f"the contact radius is {x:.1f} of the layer's thickness; known to {_MAX_RADIUS_RATIO:g}"
        )
        return "; ".join(text for text in (tip, wide) if text)


class TwoLayers(_LayeredMaterial):
    """A layer of known thickness h, bonded to a half-space of another modulus, under a sphere.

    F = 8/3 E_s^w E^(1 - w) A(d) + 8 eta a(d) d', w = 1/(1 + x e^p) with x = sqrt(R d)/h and p a polynomial in ln(1 + x)
    and ln(E_s/E): a press that is shallow against h feels the layer, a deep one what is below. Within 0.36 % of the
    exact solution (Hankel transforms, Fredholm's equation over the contact) for E_s/E from 1/12 to 12, x to 13.
    One deep press, or presses by two tips, determine both moduli; a shallow one only that of the layer, which the
    uncertainty of the other says. Assumes incompressible layers, small strain, no friction, one viscosity for both.
    Source: Dhaliwal and Rau 1970; the fit by palpate.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (SKIN_ELASTICITY, DEEP_ELASTICITY, VISCOSITY)

    skin_thickness: Depth = Field(gt=0, description="thickness h of the layer on top")

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """8/3 E_s^w E^(1 - w) A(d) + 8 eta a(d) d' [N]."""
        return self._layered_force(depth, rate, theta, self.skin_thickness)

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E of what is below the layer, and eta."""
        return _material(theta, 3)

    def validity(self, depth: float) -> str:
        """Return a warning where tip or layer's share do not hold at a depth [m]; else an empty text."""
        return self._validity(depth, self.skin_thickness)


class FreeTwoLayers(_LayeredMaterial):
    """A layer of unknown thickness h_s, bonded to a half-space of another modulus, under a sphere.

    F = 8/3 E_s^w E^(1 - w) A(d) + 8 eta a(d) d' as in `two-layers`, with the thickness in w among the unknowns.
    A press has to reach from depths that feel the layer alone, sqrt(R d) well below h_s, to ones that feel what is
    below; else thickness and moduli stand for one another, which their uncertainties and correlations say.
    Source: Dhaliwal and Rau 1970; the fit by palpate.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (SKIN_ELASTICITY, DEEP_ELASTICITY, VISCOSITY, SKIN_THICKNESS)

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """8/3 E_s^w E^(1 - w) A(d) + 8 eta a(d) d' [N]."""
        return self._layered_force(depth, rate, theta, theta[3])

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E of what is below the layer, and eta."""
        return _material(theta, 4)

    def validity(self, depth: float) -> str:
        """Return a warning where the tip does not hold at a depth [m]; else an empty text."""
        return self.indenter.validity(depth)


def _material(theta: Sequence[float], count: int) -> tuple[MaterialValue, ...]:
    """Return E below the layer and eta, the second and third of `count` parameters."""
    elastic = tuple(float(i == 1) for i in range(count))
    viscous = tuple(float(i == 2) for i in range(count))
    below = "of what lies below the layer; it is determined where the press is deep against the layer's thickness"
    return (
        MaterialValue("elasticity", theta[1], elastic, below),
        MaterialValue("viscosity", theta[2], viscous, "one for both layers"),
    )
