"""A rigid tip in finite elements: its shape, and the traction of a surface that overlaps it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

_EDGE_SHARE = 0.1  # of a flat tip's radius, a choice: its edge is rounded over so much
_REACH_SHARE = 1.2  # radii, a choice: how far out a rounded flat tip may touch
_SLOPE_STEP = 1e-4  # of the reach, a choice: central difference of the tip's slope
_MIN_FACE = 1e-3  # of the radius, a choice: smallest face in the search for it


@dataclass(frozen=True)
class TipProfile:
    """A rigid tip: height f(r) [m] over its lowest point, and its derivative, on arrays of radii (n,) [m]."""

    height: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats]
    reach: float  # [m] radius out to which it may touch
    sticking: bool = False  # the surface does not slide on it


def rounded_flat(radius: float, depth: float, sticking: bool = False) -> tuple[TipProfile, float]:
    """Return a flat tip whose rounded edge touches out to a radius [m] at a depth [m], and its area A [m^2].

    The body is a half-space. An edge makes the pressure endless, which no elements bear: f(r) = (r - b)^2/(2 e) beyond
    the face of radius b, e a tenth of the radius, with b from g(radius) = depth, g(x) = x/e (sqrt(x^2 - b^2) -
    b arccos(b/x)) the reduced profile. A = int (depth - g) from 0 to the radius, so that the force is 2 E* A.
    """
    from scipy.integrate import quad
    from scipy.optimize import brentq

    edge = _EDGE_SHARE * radius

    def reduced(x: float, b: float) -> float:
        return x / edge * (np.sqrt(x**2 - b**2) - b * np.arccos(b / x)) if x > b else 0.0

    solve: Any = brentq  # its annotations want numpy's floats
    face = float(solve(lambda b: reduced(radius, b) - depth, _MIN_FACE * radius, radius))
    area = depth * radius - float(quad(reduced, face, radius, args=(face,))[0])

    def height(r: Floats) -> Floats:
        return np.asarray(np.maximum(np.abs(r) - face, 0.0) ** 2 / (2.0 * edge))

    def slope(r: Floats) -> Floats:
        return np.asarray(np.sign(r) * np.maximum(np.abs(r) - face, 0.0) / edge)

    return TipProfile(height, slope, _REACH_SHARE * radius, sticking), area


@dataclass(frozen=True)
class Overlap:
    """The energy k/2 <overlap>^2 of a surface in a tip, overlap along the axis; its derivatives are the traction."""

    tip: TipProfile
    depth: float
    stiff: float

    def _contact(self, w: Any) -> tuple[Any, Any, Any]:
        """Return overlap, contact and the tip's slope at the deformed place."""
        radius = w.x[0] + w.u[0]
        overlap = w.u[1] + self.depth - self.tip.height(radius)
        return np.maximum(overlap, 0.0), overlap > 0, self.tip.slope(radius)

    def force(self, w: Any) -> Any:
        """Return the traction along the axis, over 2 pi of the circumference."""
        return self.stiff * self._contact(w)[0] * w.x[0]

    def traction(self, v: Any, w: Any) -> Any:
        """Return the traction's work on a virtual displacement; a sticking tip holds the surface, too."""
        overlap, touching, slope = self._contact(w)
        work = self.stiff * overlap * (v[1] - slope * v[0])
        if self.tip.sticking:
            work = work + self.stiff * touching * w.u[0] * v[0]
        return work * w.x[0]

    def tangent(self, u: Any, v: Any, w: Any) -> Any:
        """Return the traction's derivative by the displacement."""
        overlap, touching, slope = self._contact(w)
        radius, step = w.x[0] + w.u[0], _SLOPE_STEP * self.tip.reach
        curvature = (self.tip.slope(radius + step) - self.tip.slope(radius - step)) / (2 * step)
        work = touching * (u[1] - slope * u[0]) * (v[1] - slope * v[0]) - overlap * curvature * u[0] * v[0]
        if self.tip.sticking:
            work = work + touching * u[0] * v[0]
        return self.stiff * work * w.x[0]
