"""Tips with the exact shape of a sphere or an ellipsoid."""

from __future__ import annotations

from typing import Any, ClassVar

from palpate import Depth, Indenter, select, tanh
from pydantic import Field

_SERIES_DEPTH = 0.0025  # d/R, a choice: below it the closed form of the area loses digits to cancellation
_POLE_GUARD = 1e-300  # a choice: 0/0 at d = 0 is 0
_NEWTON_STEPS = 3  # from the guess to rounding
_LARGE_STRAIN = 0.15  # of A by d/R, fitted to finite elements (see `NeoHookeanSphere`)


def sphere_angle(depth: Any) -> Any:
    """Return u >= 0 with u tanh(u) = depth: Newton steps from a guess within 10 % everywhere reach rounding."""
    u = (depth + depth * depth * (1.0 + 3.0 * depth) / (3.0 + 3.0 * depth)) ** 0.5
    for _ in range(_NEWTON_STEPS):
        x = tanh(u)
        u = u - (u * x - depth) / (x + u * (1.0 - x * x) + _POLE_GUARD)
    return u


def sphere_area(depth: Any) -> Any:
    """Return the area of the unit sphere in the reduced plane, at a depth over R; its derivative is tanh(u)."""
    u = sphere_angle(depth)
    x = tanh(u)
    s = u * u
    # u - tanh(u) as a series where the difference of both would lose digits.
    series = u * s * (1 / 3 - s * (2 / 15 - s * (17 / 315 - s * (62 / 2835 - s * 1382 / 155925))))
    return (select(depth, _SERIES_DEPTH, u - x, series) + u * x * x) / 2.0


class ExactSphere(Indenter):
    """A sphere as it is, r^2 + (R - z)^2 = R^2, for depths that are not small against its radius.

    d = (a/2) ln((R + a)/(R - a)) gives the contact radius a(d), by Newton's method with a fixed number of steps;
    A = 1/2 [(a^2 + R^2)/2 ln((R + a)/(R - a)) - a R]. The force is below that of the paraboloid `sphere`: by 0.1 %, 1 %
    and 10 % at d/R = 0.01, 0.1 and 1. Small strain is still assumed; below the equator the tip counts as a sphere on.
    Source: Sneddon 1965; Popov and Hess 2015, table 2.1.
    """

    word: ClassVar[str] = "sphere"  # type = "sphere" is the paper's paraboloid (0435)
    radius: Depth = Field(gt=0, description="radius R of the sphere, half of its diameter")

    @property
    def sphere_radius(self) -> float:
        """R [m]."""
        return self.radius

    def contact_radius(self, depth: Any) -> Any:
        """Return the root a of (a/2) ln((R + a)/(R - a)) = d [m]."""
        return self.radius * tanh(sphere_angle(depth / self.radius))

    def profile_area(self, depth: Any) -> Any:
        """1/2 [(a^2 + R^2)/2 ln((R + a)/(R - a)) - a R] [m^2]."""
        return self.radius**2 * sphere_area(depth / self.radius)


class NeoHookeanSphere(Indenter):
    """A sphere pressed far into a neo-Hookean half-space: Hertz's force times 1 - 0.15 d/R.

    A(d) = (2/3) sqrt(R) d^1.5 (1 - 0.15 d/R) and its derivative sqrt(R d) (1 - 0.25 d/R), which stands for a(d): the
    force of an incompressible neo-Hookean half-space under a sphere that slides, shape and large strain together, E
    being its Young's modulus at small strain. The exact sphere at small strain (`exact-sphere`) has 1 - 0.10 d/R, so
    that large strain takes 5 % at d = R. With `thickness` dimitriadis or garcia both corrections are multiplied.
    Valid to d = R, beyond which a(d) is held; viscosity follows by the correspondence principle, as with `thickness`.
    Source: Long, Hall, Wu and Hui 2011; Zhang et al. 2014; the finite elements of benchmarks/finite_elements.py.
    """

    radius: Depth = Field(gt=0, description="radius R of the sphere, half of its diameter")

    @property
    def sphere_radius(self) -> float:
        """R [m]."""
        return self.radius

    def contact_radius(self, depth: Any) -> Any:
        """sqrt(R d) (1 - 0.25 d/R) [m]."""
        e = self._bounded(depth)
        return self.radius * e**0.5 * (1.0 - 0.25 * e)  # 5/3 of the area's coefficient

    def profile_area(self, depth: Any) -> Any:
        """(2/3) sqrt(R) d^1.5 (1 - 0.15 d/R) [m^2]."""
        e = self._bounded(depth)
        area = 2.0 / 3.0 * e**1.5 * (1.0 - _LARGE_STRAIN * e) + 0.75 * (depth / self.radius - e)  # a(R) is 0.75 R
        return self.radius**2 * area

    def _bounded(self, depth: Any) -> Any:
        """Return depth over radius, 1 at most: deeper, the contact radius is held at its last value."""
        scaled = depth / self.radius
        return select(scaled, 1.0, 1.0 + 0.0 * scaled, scaled)

    def validity(self, depth: float) -> str:
        """Return a warning beyond the depth to which the correction is fitted."""
        if depth <= self.radius:
            return ""
        return f"the depth is {depth / self.radius:.0%} of the radius; the large-strain correction is known to 100 %"


class Ellipsoid(Indenter):
    """An ellipsoid of revolution about the axis of indentation, with semi-axes b across and c along it.

    Its profile c/b (b - sqrt(b^2 - r^2)) is that of a sphere of radius b, stretched by c/b along the axis, and so is
    the reduced profile: a(d) = a_sphere(d b/c), A(d) = (c/b) A_sphere(d b/c). b = c is `exact-sphere`; c > b is a
    pointed tip, c < b is a blunt one, with radius of curvature b^2/c at the apex.
    Source: Sneddon 1965 for the sphere; the MDR integral is linear in the profile.
    """

    radius: Depth = Field(gt=0, description="semi-axis b across the axis of indentation")
    height: Depth = Field(gt=0, description="semi-axis c along the axis of indentation")

    def contact_radius(self, depth: Any) -> Any:
        """Return the sphere's contact radius at the depth d b/c [m]."""
        return self.radius * tanh(sphere_angle(depth / self.height))

    def profile_area(self, depth: Any) -> Any:
        """c/b times the sphere's area at the depth d b/c [m^2]."""
        return self.radius * self.height * sphere_area(depth / self.height)
