"""Cones: sharp, rounded by a sphere, and cut off."""

from __future__ import annotations

import math
from typing import Any

from palpate import Angle, Depth, Indenter, arctan, log, select, tanh
from pydantic import Field

from palpate_models.indenters.spheres import sphere_angle, sphere_area

_ANGLE = "angle t between the cone and the untouched surface: 90 degrees less half of the opening angle"
_MAX_ANGLE = math.radians(88.0)  # beyond it, the fixed number of Newton steps does not reach rounding
_RISE_STEPS = 4  # Newton steps of a truncated cone from its guess to rounding
_RADIUS_STEPS = 5  # Newton steps of a blunt cone from its guess to rounding
_CONE_DEPTH = 1.5  # depths of the sphere, a choice: any depth of the cone, where its root is not used


class Cone(Indenter):
    """A cone of angle t to the surface, z = r tan(t).

    a(d) = 2 d/(pi tan t), A(d) = d^2/(pi tan t), so that the elastic force is (2/pi) E* d^2/tan t. The theory is of
    small slopes: beyond t of some 30 degrees, friction and large strain matter.
    Source: Sneddon 1965; Love 1939; Popov and Hess 2015, table 2.1.
    """

    angle: Angle = Field(gt=0, lt=math.pi / 2, description=_ANGLE)

    def contact_radius(self, depth: Any) -> Any:
        """2 d/(pi tan t) [m]."""
        return 2.0 / (math.pi * math.tan(self.angle)) * depth

    def profile_area(self, depth: Any) -> Any:
        """d^2/(pi tan t) [m^2]."""
        return depth * depth / (math.pi * math.tan(self.angle))


class TruncatedCone(Indenter):
    """A cone of angle t to the surface that ends in a flat face of radius b: z = max(r - b, 0) tan(t).

    d = a tan(t) acos(b/a) gives the contact radius a(d) >= b, by Newton's method with a fixed number of steps;
    A = tan(t)/2 [a^2 acos(b/a) + b sqrt(a^2 - b^2)]. As d goes to 0 the tip is `flat`, for large d a `cone`.
    Source: Ejike 1981; Popov, Hess and Willert 2019, chapter 2.
    """

    angle: Angle = Field(gt=0, lt=math.pi / 2, description=_ANGLE)
    face_radius: Depth = Field(gt=0, description="radius b of the flat face")

    def _rise(self, depth: Any) -> Any:
        """Return s = sqrt(a^2/b^2 - 1), from sqrt(1 + s^2) atan(s) = d/(b tan t) = q."""
        q = depth / (self.face_radius * math.tan(self.angle))
        # The guess has both limits: q for a flat tip, 2 q/pi for a cone.
        s = q * (1.0 + 2.0 / math.pi * q) / (1.0 + q)
        for _ in range(_RISE_STEPS):
            root, angle = (1.0 + s * s) ** 0.5, arctan(s)
            s = s - (root * angle - q) * root / (1.0 + s * angle)
        return s

    def contact_radius(self, depth: Any) -> Any:
        """Return the root a of a tan(t) acos(b/a) = d [m]."""
        return self.face_radius * (1.0 + self._rise(depth) ** 2) ** 0.5

    def profile_area(self, depth: Any) -> Any:
        """tan(t)/2 [a^2 acos(b/a) + b sqrt(a^2 - b^2)] [m^2]."""
        s = self._rise(depth)
        return math.tan(self.angle) / 2.0 * self.face_radius**2 * ((1.0 + s * s) * arctan(s) + s)


class BluntCone(Indenter):
    """A cone of angle t to the surface, rounded at its tip by a sphere of radius R.

    The sphere ends without a kink at b = R sin t. Up to a = b the tip is `exact-sphere`. Beyond, with
    s = sqrt(a^2/b^2 - 1) and L = ln((R + a)/(R cos t + b s)), the contact radius is the root of
    d = a [L + tan(t) atan(s)], by Newton's method with a fixed number of steps, and
    A = 1/2 [(R^2 + a^2) L + b s R cos t - a R + tan(t) (a^2 atan(s) + b^2 s)].
    Source: the MDR integral of the profile; for a parabolic cap Briscoe, Sebastian and Adams 1994.
    """

    angle: Angle = Field(gt=0, le=_MAX_ANGLE, description=_ANGLE + "; 88 degrees at most")
    tip_radius: Depth = Field(gt=0, description="radius R of the sphere at the tip")

    @property
    def sphere_depth(self) -> float:
        """The depth [m] from which on the cone is in contact, too."""
        return self.tip_radius * math.sin(self.angle) * math.atanh(math.sin(self.angle))

    def _cone_radius(self, depth: Any) -> Any:
        """Return the contact radius in units of R, at a depth in units of R that reaches the cone."""
        sine, cosine, tangent = math.sin(self.angle), math.cos(self.angle), math.tan(self.angle)
        # Far out the tip is a cone whose apex lies a little below: a guess from below, where it exceeds b.
        guess = 2.0 / (math.pi * tangent) * (depth + sine * tangent - 1.0 + cosine)
        a = select(guess, sine, guess, sine)
        for _ in range(_RADIUS_STEPS):
            s = _root_of((a / sine) ** 2 - 1.0)
            per_radius = log((1.0 + a) / (cosine + sine * s)) + tangent * arctan(s)
            slope = per_radius + a / (1.0 + a) + sine * (tangent - s) / (cosine + sine * s)
            a = a - (a * per_radius - depth) / slope
        return a

    def contact_radius(self, depth: Any) -> Any:
        """Return the sphere's, then the root a of a [L + tan(t) atan(s)] = d [m]."""
        scaled, edge = depth / self.tip_radius, self.sphere_depth / self.tip_radius
        cone = self._cone_radius(select(scaled, edge, scaled, _CONE_DEPTH * edge))
        sphere = tanh(sphere_angle(select(scaled, edge, edge, scaled)))
        return self.tip_radius * select(scaled, edge, cone, sphere)

    def profile_area(self, depth: Any) -> Any:
        """Return the sphere's, then 1/2 [(R^2 + a^2) L + b s R cos t - a R + tan(t) (a^2 atan(s) + b^2 s)] [m^2]."""
        sine, cosine, tangent = math.sin(self.angle), math.cos(self.angle), math.tan(self.angle)
        scaled, edge = depth / self.tip_radius, self.sphere_depth / self.tip_radius
        a = self._cone_radius(select(scaled, edge, scaled, _CONE_DEPTH * edge))
        s = _root_of((a / sine) ** 2 - 1.0)
        # The terms of the cap, then those of the cone.
        capped = (1.0 + a * a) * log((1.0 + a) / (cosine + sine * s)) + sine * s * cosine - a
        cone = (capped + tangent * (a * a * arctan(s) + sine * sine * s)) / 2.0
        sphere = sphere_area(select(scaled, edge, edge, scaled))
        return self.tip_radius**2 * select(scaled, edge, cone, sphere)


def _root_of(square: Any) -> Any:
    """Return the square root; 0, with a finite derivative, where rounding makes the argument negative."""
    return select(square, 0.0, select(square, 0.0, square, 1.0) ** 0.5, 0.0)
