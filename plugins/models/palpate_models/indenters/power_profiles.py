"""Tips whose profile is a power of the radius: paraboloid, quartic, any power, and the flat punch as its limit."""

from __future__ import annotations

import math
from typing import Any

from palpate import Depth, Indenter
from pydantic import Field

_MAX_DEPTH_RATIO = 2.0  # radii, a choice: there the force of the paraboloid is 20 % above that of the sphere


def hess_factor(exponent: float) -> float:
    """Return k_n of the reduced profile k_n c_n x^n of a tip c_n r^n: pi/2, 2 and 8/3 for n = 1, 2 and 4."""
    n = exponent
    return math.sqrt(math.pi) / 2 * n * math.gamma(n / 2) / math.gamma((n + 1) / 2)


class Sphere(Indenter):
    """A sphere, approximated by the paraboloid r^2/(2 R) at its tip, as in the paper and in Hertz's theory.

    a(d) = sqrt(R d), A(d) = (2/3) sqrt(R) d^1.5, so that the elastic force is (4/3) E* sqrt(R) d^1.5.
    Valid for a contact radius small against R: the force of the real sphere (`exact-sphere`) is lower by the part
    d/(10 R), which is 10 % at d = R; beyond a tenth of R a condition says so. In words, as in --tip "sphere 3 mm", a
    sphere is the real one.
    Source: paper, eq. TotalForce; Hertz 1882; Popov and Hess 2015, table 2.1.
    """

    radius: Depth = Field(gt=0, description="radius R of the sphere, half of its diameter")

    @property
    def sphere_radius(self) -> float:
        """R [m]."""
        return self.radius

    def contact_radius(self, depth: Any) -> Any:
        """sqrt(R d) [m]."""
        return (self.radius * depth) ** 0.5

    def profile_area(self, depth: Any) -> Any:
        """(2/3) sqrt(R) d^1.5 [m^2]."""
        return 2.0 / 3.0 * depth * (self.radius * depth) ** 0.5

    def validity(self, depth: float) -> str:
        """Return a warning beyond the depth to which the paraboloid approximates a sphere."""
        if depth <= _MAX_DEPTH_RATIO * self.radius:
            return ""
        return f"the depth is {depth / self.radius:.3g} times the radius of the sphere: take exact-sphere"


class Paraboloid(Indenter):
    """A paraboloid of revolution, z = r^2/(2 R), with the radius of curvature R at its apex.

    a(d) = sqrt(R d), A(d) = (2/3) sqrt(R) d^1.5: the same forces as `sphere`, which approximates a sphere by it; here
    the shape is meant, so that it adds no error at any depth.
    Source: Popov and Hess 2015, table 2.1; Hertz 1882.
    """

    curvature_radius: Depth = Field(gt=0, description="radius of curvature R at the apex")

    @property
    def radius(self) -> float:
        """R [m], the size of the tip as that of a sphere."""
        return self.curvature_radius

    def contact_radius(self, depth: Any) -> Any:
        """sqrt(R d) [m]."""
        return (self.curvature_radius * depth) ** 0.5

    def profile_area(self, depth: Any) -> Any:
        """(2/3) sqrt(R) d^1.5 [m^2]."""
        return 2.0 / 3.0 * depth * (self.curvature_radius * depth) ** 0.5


class Flat(Indenter):
    """A flat-ended cylinder.

    a(d) = R, A(d) = R d, so that the elastic force is 2 R E* d. Valid while the face is parallel to the surface:
    a tilt of 2 degrees costs some 5 % of the force.
    Source: paper, eq. flat; Boussinesq 1885; Popov and Hess 2015.
    """

    radius: Depth = Field(gt=0, description="radius R of the face")

    def contact_radius(self, depth: Any) -> Any:
        """R [m], whatever the depth."""
        return self.radius + 0.0 * depth

    def profile_area(self, depth: Any) -> Any:
        """R d [m^2]."""
        return self.radius * depth


class Power(Indenter):
    """A tip whose profile is the power c_n r^n.

    The reduced profile is k_n c_n x^n with Hess's factor k_n = sqrt(pi)/2 n Gamma(n/2) / Gamma((n + 1)/2), hence
    a(d) = (d/(k_n c_n))^(1/n) and A(d) = n/(n + 1) (k_n c_n)^(-1/n) d^((n+1)/n). n = 2 with c = 1/(2 R) is `Sphere`
    (k_2 = 2); n = 4 with c = 1e7 m^-3 is the paper's quartic tip (k_4 = 2.667).
    Source: paper, eq. x4; Popov and Hess 2015, table 2.1; Galin 1946.
    """

    exponent: float = Field(ge=1, allow_inf_nan=False, description="n of c_n r^n; 1: cone, 2: paraboloid, 4: quartic")
    coefficient: float = Field(gt=0, allow_inf_nan=False, description="c_n of c_n r^n, in m^(1-n)")

    @property
    def reduced_coefficient(self) -> float:
        """k_n c_n [m^(1-n)]."""
        return self.coefficient * hess_factor(self.exponent)

    def contact_radius(self, depth: Any) -> Any:
        """(d/(k_n c_n))^(1/n) [m]."""
        return (depth / self.reduced_coefficient) ** (1.0 / self.exponent)

    def profile_area(self, depth: Any) -> Any:
        """n/(n + 1) a(d) d [m^2]."""
        return self.exponent / (self.exponent + 1.0) * depth * self.contact_radius(depth)


class Quartic(Indenter):
    """The paper's quartic tip, z = c_4 r^4: flatter than a sphere at its apex, steeper at its rim.

    a(d) = (3 d/(8 c_4))^(1/4), A(d) = (4/5) a(d) d, with Hess's factor k_4 = 8/3. The paper's printed tip has
    c_4 = 1e7 m^-3, the default. Small strain is assumed, as for every tip.
    Source: paper, eq. x4; Popov and Hess 2015, table 2.1.
    """

    coefficient: float = Field(default=1e7, gt=0, allow_inf_nan=False, description="c_4 of c_4 r^4, in m^-3")

    def contact_radius(self, depth: Any) -> Any:
        """(3 d/(8 c_4))^(1/4) [m]."""
        return (0.375 / self.coefficient * depth) ** 0.25

    def profile_area(self, depth: Any) -> Any:
        """(4/5) a(d) d [m^2]."""
        return 0.8 * depth * self.contact_radius(depth)
