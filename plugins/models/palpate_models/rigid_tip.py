"""A rigid tip in finite elements: its shape, and the traction of a surface that overlaps it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

_EDGE = 0.1  # of a flat tip's radius, over which its edge is rounded
_ROUND = 1.2  # radii out to which a rounded flat tip may touch


@dataclass(frozen=True)
class TipProfile:
    """A rigid tip: height f(r) [m] over its lowest point, and its derivative, on arrays of radii (n,) [m]."""

    height: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats]
    reach: float  # [m] radius out to which it may touch
    sticking: bool = False  # the surface does not slide on it


def rounded_flat(radius: float, depth: float, sticking: bool = False) -> tuple[TipProfile, float]:
    """A flat tip whose rounded edge touches out to a radius [m] at a depth [m] of a half-space, and its area A [m^2].

    An edge makes the pressure endless, which no elements bear: f(r) = (r - b)^2/(2 e) beyond the face of radius b,
    e a tenth of the radius, with b from g(radius) = depth, g(x) = x/e (sqrt(x^2 - b^2) - b arccos(b/x)) the reduced
    profile. A = int (depth - g) from 0 to the radius, so that the force on a half-space is 2 E* A.
    """
    from scipy.integrate import quad
    from scipy.optimize import brentq

    edge = _EDGE * radius

    def reduced(x: float, b: float) -> float:
        return x / edge * (np.sqrt(x**2 - b**2) - b * np.arccos(b / x)) if x > b else 0.0

    solve: Any = brentq  # its annotations want numpy's floats
    face = float(solve(lambda b: reduced(radius, b) - depth, 1e-3 * radius, radius))
    area = depth * radius - float(quad(reduced, face, radius, args=(face,))[0])

    def height(r: Floats) -> Floats:
        return np.asarray(np.maximum(np.abs(r) - face, 0.0) ** 2 / (2.0 * edge))

    def slope(r: Floats) -> Floats:
        return np.asarray(np.sign(r) * np.maximum(np.abs(r) - face, 0.0) / edge)

    return TipProfile(height, slope, _ROUND * radius, sticking), area


@dataclass(frozen=True)
class Overlap:
    """The energy k/2 <overlap>^2 of a surface in a tip, overlap along the axis; its derivatives are the traction."""

    tip: TipProfile
    depth: float
    stiff: float

    def _at(self, w: Any) -> tuple[Any, Any, Any]:
        place = w.x[0] + w.u[0]
        overlap = w.u[1] + self.depth - self.tip.height(place)
        return np.maximum(overlap, 0.0), overlap > 0, self.tip.slope(place)

    def force(self, w: Any) -> Any:
        """Traction along the axis, over 2 pi of the circumference."""
        return self.stiff * self._at(w)[0] * w.x[0]

    def traction(self, v: Any, w: Any) -> Any:
        """Its work on a virtual displacement."""
        overlap, touching, slope = self._at(w)
        found = self.stiff * overlap * (v[1] - slope * v[0])
        return (found + (self.stiff * touching * w.u[0] * v[0] if self.tip.sticking else 0.0)) * w.x[0]

    def tangent(self, u: Any, v: Any, w: Any) -> Any:
        """The traction's derivative by the displacement."""
        overlap, touching, slope = self._at(w)
        place, step = w.x[0] + w.u[0], 1e-4 * self.tip.reach
        bend = (self.tip.slope(place + step) - self.tip.slope(place - step)) / (2 * step)
        found = touching * (u[1] - slope * u[0]) * (v[1] - slope * v[0]) - overlap * bend * u[0] * v[0]
        if self.tip.sticking:
            found = found + touching * u[0] * v[0]
        return self.stiff * found * w.x[0]
