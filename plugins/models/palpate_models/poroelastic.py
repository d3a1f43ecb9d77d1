"""A gel whose solvent moves: the force at a held depth relaxes with the square of the contact radius."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from palpate import Floats, Indenter, MaterialValue, Parameter, select
from pydantic import model_validator

from palpate_models.indenters.cones import Cone
from palpate_models.indenters.power_profiles import Flat, Paraboloid, Sphere
from palpate_models.indenters.spheres import Ellipsoid, ExactSphere
from palpate_models.parameters import LASTING_ELASTICITY
from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.relaxing_models import RelaxingModel
from palpate_models.thickness import Thickness

# g = w_1 exp(-c_1 sqrt(x)) + w_2 exp(-c_2 x), x = D t/a^2.
_SPHERE = (0.491, 0.908, 0.509, 1.679)
_CONE = (0.493, 0.822, 0.507, 1.348)
_FLAT = (1.304, 1.0, -0.304, 0.254)
_ROOT_STATES = 9
_FASTEST = 1e3  # of the rates, in D/a^2
_SLOWEST = 1 / 40  # of c_1^2
_SHALLOW = 1e-4  # [m]; a smaller contact counts as that at this depth, or the first one would relax at once


def _master(indenter: Indenter) -> tuple[float, float, float, float]:
    """Coefficients of a tip; raises ValueError for one of which none are known."""
    match indenter:
        case Sphere() | ExactSphere() | Paraboloid() | Ellipsoid():
            return _SPHERE
        case Cone():
            return _CONE
        case Flat():
            return _FLAT
    raise ValueError(f"poroelastic: is known for spheres, cones and flat tips, not for a {type(indenter).__name__}")


class Poroelastic(RelaxingModel):
    """A gel or tissue whose solvent moves (Biot's), pressed fast and held, by a sphere, a cone or a flat tip.

    At once it is incompressible, F_0 = 8 G A(d), and in the end F_inf = F_0/(2 (1 - nu_s)) = 2 E/(1 - nu_s^2) A(d),
    with G = E/(2 (1 + nu_s)). Between: (F - F_inf)/(F_0 - F_inf) = g(D t/a^2), for a sphere
    g(x) = 0.491 exp(-0.908 sqrt(x)) + 0.509 exp(-1.679 x), for a cone
    0.493 exp(-0.822 sqrt(x)) + 0.507 exp(-1.348 x), for a flat tip 1.304 exp(-sqrt(x)) - 0.304 exp(-0.254 x); here as a
    spring and ten arms q_k whose rates go with D/a(d)^2, within 0.02 for x > 0.003, a no less than at 0.1 mm.
    Assumes a half-space, no friction, solvent that drains at the surface around the tip, and a press that is fast
    against a^2/D: the theory is that of a hold; for motion beyond it a is that of the moment. Unlike what
    `standard-linear-solid` does, a larger contact relaxes more slowly: two depths, or two tips, distinguish them, one
    hold does not.
    Source: Hu, Zhao, Vlassak and Suo 2010.
    """

    memory: ClassVar[tuple[str, ...]] = tuple(f"force_{k}" for k in range(1, _ROOT_STATES + 2))
    parameters: ClassVar[tuple[Parameter, ...]] = (
        LASTING_ELASTICITY,
        Parameter(
            "drained_poisson", "nu_s", "1", "Poisson's ratio when the solvent has moved", upper=0.499, start=0.3,
            start_std=0.2,
        ),
        Parameter("diffusivity", "D", "m^2/s", "effective diffusivity of the solvent", start=1e-6, start_std=1e-5),
    )  # fmt: skip

    @model_validator(mode="after")
    def _known_tip(self) -> Self:
        _master(self.indenter)
        if self.poisson != 0.5:
            raise ValueError("poroelastic: poisson is that of the first moment, 0.5; drained_poisson is a parameter")
        if isinstance(self.thickness, Thickness) or self.skin is not None:
            raise ValueError("poroelastic: is known for a half-space only, without thickness and skin")
        return self

    def curved_share(self, curvature: Floats, depth: Floats) -> None:
        """None: the relaxation of a gel on a curved skin is not known."""

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """Strengths [Pa], and rates in D/a^2."""
        elasticity, poisson, _ = theta
        per = (1.0 - self.poisson**2) / (1.0 - poisson * poisson)
        fading = per * elasticity * (1.0 - 2.0 * poisson)
        w1, c1, w2, c2 = _master(self.indenter)
        first = math.log(_SLOWEST * c1**2)
        step = (math.log(_FASTEST) - first) / (_ROOT_STATES - 1)
        rates = [math.exp(first + k * step) for k in range(_ROOT_STATES)]
        shares = [step * c1 / (2 * math.sqrt(math.pi * x)) * math.exp(-(c1**2) / (4 * x)) for x in rates]
        shares[-1] += 1.0 - sum(shares)  # what is faster than the fastest
        arms = [(w1 * share * fading, rate) for share, rate in zip(shares, rates, strict=True)]
        return RelaxationSpectrum(per * elasticity, None, (*arms, (w2 * fading, c2)))

    def pace(self, radius: Any, theta: Sequence[Any]) -> Any:
        """D/a^2 [1/s]."""
        least = float(self.indenter.contact_radius(_SHALLOW))
        wide = select(radius, least, radius, least + 0.0 * radius)
        return theta[2] / (wide * wide)

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E when the solvent has moved, and E_0 = 3 G = 3 E/(2 (1 + nu_s)) before."""
        elasticity, poisson, _ = theta
        per = 1.5 / (1.0 + poisson)
        return (
            MaterialValue("elasticity", elasticity, (1.0, 0.0, 0.0), "when the solvent has moved"),
            MaterialValue(
                "instant_elasticity", per * elasticity, (per, -per * elasticity / (1.0 + poisson), 0.0),
                "before the solvent moves",
            ),
        )  # fmt: skip
