"""Fung's material: tissue that stiffens exponentially as it is strained, under a sphere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from palpate import ContactModel, Indenter, MaterialValue, Parameter
from pydantic import Field, model_validator

from palpate_models.indenters.power_profiles import Sphere
from palpate_models.indenters.spheres import ExactSphere, NeoHookeanSphere
from palpate_models.parameters import ELASTICITY, VISCOSITY

STIFFENING = Parameter(
    "stiffening", "b", "1", "exponent of Fung's energy; 0 is a neo-Hookean material", start=1.0, start_std=5.0
)
_STRAIN = 0.12  # I_1 - 3 of a stretch 1 - 0.2 sqrt(e), over e = d/R (Lin et al. 2009)
_MAX_DEPTH_RATIO = 0.8  # of R, to which the coefficients below are fitted to finite elements (0267)
_RISE = 0.25  # of e in g
_SPREAD_BY_STIFFENING = 0.022  # of b
_SPREAD_BY_DEPTH = 0.097  # of b e


class Fung(ContactModel):
    """A sphere pressed far into tissue that stiffens with strain: energy E/(6 b) (exp(b (I_1 - 3)) - 1).

    F = 16/9 E sqrt(R) d^1.5 (1 - 0.15 e) exp(g) + 8 eta a(d) d', e = d/R, E being Young's modulus at small strain and
    a(d) that of `neo-hookean-sphere`, which b = 0 is. g = 0.12 b e (1 + e/4)/(1 + 0.022 b + 0.097 b e): it begins as by
    the strain 0.2 sqrt(e) of Lin et al., and stays behind where what is strained most has stiffened and spreads the
    load. Finite elements have it within 1.5 % for b to 10 and e to 0.8 (benchmarks/finite_elements.py). A press that is
    shallow against R does not determine b, which its uncertainty says. Assumes a half-space, incompressible material,
    no friction, and viscosity that does not stiffen.
    Source: Fung 1967; Lin, Shreiber, Dimitriadis and Horkay 2009.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (ELASTICITY, VISCOSITY, STIFFENING)

    indenter: Indenter = Field(description="the tip, a sphere; its true shape and large strain are in the formula")

    @model_validator(mode="after")
    def _known_tip(self) -> Self:
        if not isinstance(self.indenter, Sphere | ExactSphere | NeoHookeanSphere):
            name = type(self.indenter).__name__
            raise ValueError(f"indenter: Fung's material is known under spheres, not under a {name}")
        return self

    @property
    def _sphere(self) -> NeoHookeanSphere:
        assert isinstance(self.indenter, Sphere | ExactSphere | NeoHookeanSphere)
        return NeoHookeanSphere.model_construct(radius=self.indenter.radius)

    def force(self, depth: Any, rate: Any, theta: Sequence[Any], memory: Sequence[Any] = ()) -> Any:
        """16/9 E sqrt(R) d^1.5 (1 - 0.15 e) exp(g) + 8 eta a(d) d' [N]."""
        elasticity, viscosity, stiffening = theta
        sphere = self._sphere
        e = depth / sphere.radius
        spread = 1.0 + stiffening * (_SPREAD_BY_STIFFENING + _SPREAD_BY_DEPTH * e)
        growth = math.e ** (_STRAIN * stiffening * e * (1.0 + _RISE * e) / spread)
        return 8.0 / 3.0 * elasticity * sphere.profile_area(depth) * growth + (
            8.0 * viscosity * sphere.contact_radius(depth) * rate
        )

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E at small strain, and eta."""
        return (
            MaterialValue("elasticity", theta[0], (1.0, 0.0, 0.0), "at small strain; the material stiffens beyond"),
            MaterialValue("viscosity", theta[1], (0.0, 1.0, 0.0), "the same at every strain"),
        )

    def validity(self, depth: float) -> str:
        """Return a warning beyond the depth to which the formula is fitted."""
        radius = self._sphere.radius
        if depth <= _MAX_DEPTH_RATIO * radius:
            return ""
        return f"the depth is {depth / radius:.0%} of the radius; stiffening is known to {_MAX_DEPTH_RATIO:.0%}"
