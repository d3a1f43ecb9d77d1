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

# w_1, c_1, w_2, c_2 of g = w_1 exp(-c_1 sqrt(x)) + w_2 exp(-c_2 x), x = D t/a^2 (Hu, Zhao, Vlassak and Suo 2010).
_SPHERE = (0.491, 0.908, 0.509, 1.679)
_CONE = (0.493, 0.822, 0.507, 1.348)
_FLAT = (1.304, 1.0, -0.304, 0.254)
_ROOT_STATES = 9  # a choice: exponentials for exp(-c_1 sqrt(x)); with these rates g is within 0.02 for x > 0.003
_MAX_RATE = 1e3  # in D/a^2, a choice with `_ROOT_STATES`
_MIN_RATE = 1 / 40  # in c_1^2 D/a^2, a choice with `_ROOT_STATES`
_MIN_DEPTH = 1e-4  # [m], a choice: a smaller contact counts as that at this depth, or the first would relax at once


def _master_curve(indenter: Indenter) -> tuple[float, float, float, float]:
    """Return the coefficients of a tip's master curve; raises ValueError for a tip without one."""
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
    def _check_geometry(self) -> Self:
        _master_curve(self.indenter)
        if self.poisson != 0.5:
            raise ValueError("poroelastic: poisson is that of the first moment, 0.5; drained_poisson is a parameter")
        if isinstance(self.thickness, Thickness) or self.skin is not None:
            raise ValueError("poroelastic: is known for a half-space only, without thickness and skin")
        return self

    def curved_share(self, curvature: Floats, depth: Floats) -> None:
        """None: the relaxation of a gel on a curved skin is not known."""

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """Return strengths [Pa], and rates in D/a^2, of `theta`: modulus [Pa], drained Poisson's ratio, diffusivity D.

        What fades follows the tip's master curve g = w_1 exp(-c_1 sqrt(x)) + w_2 exp(-c_2 x), x = D t/a^2, with
        exp(-c sqrt(x)) = int c/(2 sqrt(pi) r^1.5) exp(-c^2/(4 r)) exp(-r x) dr, by the trapezoidal rule over ln r.
        """
        elasticity, poisson, _ = theta
        lasting_share = (1.0 - self.poisson**2) / (1.0 - poisson * poisson)
        fading = lasting_share * elasticity * (1.0 - 2.0 * poisson)
        w1, c1, w2, c2 = _master_curve(self.indenter)
        first = math.log(_MIN_RATE * c1**2)
        step = (math.log(_MAX_RATE) - first) / (_ROOT_STATES - 1)
        rates = [math.exp(first + k * step) for k in range(_ROOT_STATES)]
        shares = [step * c1 / (2 * math.sqrt(math.pi * x)) * math.exp(-(c1**2) / (4 * x)) for x in rates]
        shares[-1] += 1.0 - sum(shares)  # all that is faster than the fastest
        arms = [(w1 * share * fading, rate) for share, rate in zip(shares, rates, strict=True)]
        return RelaxationSpectrum(lasting_share * elasticity, None, (*arms, (w2 * fading, c2)))

    def pace(self, radius: Any, theta: Sequence[Any]) -> Any:
        """D/a^2 [1/s]."""
        min_radius = float(self.indenter.contact_radius(_MIN_DEPTH))
        bounded_radius = select(radius, min_radius, radius, min_radius + 0.0 * radius)
        return theta[2] / (bounded_radius * bounded_radius)

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E when the solvent has moved, and E_0 = 3 G = 3 E/(2 (1 + nu_s)) before."""
        elasticity, poisson, _ = theta
        ratio = 1.5 / (1.0 + poisson)  # E_0/E
        return (
            MaterialValue("elasticity", elasticity, (1.0, 0.0, 0.0), "when the solvent has moved"),
            MaterialValue(
                "instant_elasticity", ratio * elasticity, (ratio, -ratio * elasticity / (1.0 + poisson), 0.0),
                "before the solvent moves",
            ),
        )  # fmt: skip
