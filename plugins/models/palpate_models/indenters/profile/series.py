"""A contact radius as a few polynomials in depth^(1/4), which run on every kind of number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import select

Floats = NDArray[np.float64]

_DEGREE = 8
_TABLE = 1500  # radii at which the reduced profile is tabulated for its inverse
_NARROWEST = 1 / 64  # piece, in units of the whole range of depth^(1/4)
_NOTHING = 1e-14  # of the depth range: rounding
_FACE = 1e-3  # of the edge: what is flat over less is an apex
_SETTLE = 3  # secant steps from the table's inverse to the exact one


@dataclass(frozen=True)
class Piece:
    """Polynomials in t = (w - start)/width, clamped to 0..1, without their constants; lowest power first."""

    start: float
    width: float
    radius: tuple[float, ...]
    area: tuple[float, ...]


@dataclass(frozen=True)
class RadiusSeries:
    """a(d) as a sum of clamped polynomials in w = (d/D)^(1/4), and A(d) as the integral of that very sum.

    The fourth root makes contact radii that begin as d^(1/n), n = 1, 2, 4, smooth in w. Deeper than D the tip is taken
    to go on as a straight shaft: a stays, A grows linearly.
    """

    depth: float  # D [m]
    face: float  # a(0+) [m]
    edge: float  # a(D) [m]
    pieces: tuple[Piece, ...]
    error: float  # largest deviation of a(d) from the exact root, relative

    def contact_radius(self, depth: Any) -> Any:
        """a(d) [m]."""
        w = (depth / self.depth) ** 0.25
        return self.face + sum(_polynomial(piece.radius, _clamped(w, piece)) for piece in self.pieces)

    def profile_area(self, depth: Any) -> Any:
        """A(d) [m^2]."""
        w = (depth / self.depth) ** 0.25
        within = sum(_polynomial(piece.area, _clamped(w, piece)) for piece in self.pieces)
        return within + self.edge * select(depth, self.depth, depth - self.depth, 0.0 * depth)


def _clamped(w: Any, piece: Piece) -> Any:
    t = (w - piece.start) / piece.width
    t = select(t, 0.0, t, 0.0 * t)
    return select(t, 1.0, 1.0 + 0.0 * t, t)


def _polynomial(coefficients: tuple[float, ...], t: Any) -> Any:
    value: Any = 0.0
    for coefficient in reversed(coefficients):
        value = (value + coefficient) * t
    return value


def radius_series(reduced: Callable[[Floats], Floats], edge: float, tolerance: float, floor: float) -> RadiusSeries:
    """The inverse a(d) of a reduced profile g(x), 0 <= x <= edge [m], to a tolerance relative to a(d).

    Where a(d) is below `floor` times the edge, the tolerance is relative to that.
    Pieces are halved until they meet the tolerance or are as narrow as they may be. Raises ValueError where the reduced
    profile is not finite or does not grow.
    """
    depth = float(reduced(np.array([edge]))[0])
    if not np.isfinite(depth):
        raise ValueError(f"the reduced profile is not finite at the edge, a radius of {edge:.4g} m")
    if depth <= 0:
        raise ValueError("the profile does not rise anywhere: that is the tip 'flat'")
    face = _face(reduced, edge, depth)
    x = face + (edge - face) * np.linspace(0.0, 1.0, _TABLE + 1) ** 4
    g = np.concatenate([[0.0], reduced(x[1:])])
    rising = g > _NOTHING * depth  # below, rounding has the say
    rising[0] = True
    x, g = x[rising], g[rising]
    stuck = np.flatnonzero(~(np.diff(g) > 0))
    if len(stuck):
        raise ValueError(f"the reduced profile does not grow at a radius of {x[stuck[0]]:.4g} m")
    inverse = _Inverse(reduced, x, g, edge)
    pieces, error, waiting = [], 0.0, [(0.0, 1.0)]
    while waiting:
        start, width = waiting.pop()
        radius, worst = _fitted(inverse, start, width, floor * edge)
        if worst > tolerance and width > _NARROWEST:
            waiting += [(start + width / 2, width / 2), (start, width / 2)]
            continue
        pieces.append(_piece(start, width, radius, depth))
        error = max(error, worst)
    return RadiusSeries(depth, face, face + sum(sum(piece.radius) for piece in pieces), tuple(pieces), error)


def _face(reduced: Callable[[Floats], Floats], edge: float, depth: float) -> float:
    """Radius [m] of a flat face, 0 for a tip without one.

    A face touches all at once: the reduced profile is 0 up to its edge, which is the contact radius at depth 0.
    """
    low, high = 0.0, edge
    if float(reduced(np.array([_FACE * edge]))[0]) > _NOTHING * depth:
        return 0.0
    for _ in range(60):
        middle = (low + high) / 2
        inside = float(reduced(np.array([middle]))[0]) <= _NOTHING * depth
        low, high = (middle, high) if inside else (low, middle)
    return low if low > _FACE * edge else 0.0


class _Inverse:
    """a at w, by interpolation in the table and a few secant steps."""

    def __init__(self, reduced: Callable[[Floats], Floats], x: Floats, g: Floats, edge: float) -> None:
        from scipy.interpolate import PchipInterpolator

        self._reduced, self._edge, self._face = reduced, edge, float(x[0])
        self._depth = float(g[-1])
        self._guess = PchipInterpolator((g / self._depth) ** 0.25, x)

    def __call__(self, w: Floats) -> Floats:
        wanted = self._depth * w**4
        a = np.clip(self._guess(w), self._face, self._edge)
        for _ in range(_SETTLE):
            step = 1e-5 * (a - self._face) + 1e-12 * self._edge
            inward = np.where(a > self._edge / 2, -step, step)
            g = self._reduced(a)
            slope = (self._reduced(a + inward) - g) / inward
            moved = np.where(slope > 0, a - (g - wanted) / np.where(slope > 0, slope, 1.0), a)
            # Where the table is coarse against the curve, at a face, a step may overshoot: keep to the table's side.
            a = np.where(np.abs(moved - a) < 0.1 * (a - self._face) + 1e-12 * self._edge, moved, a)
        return np.clip(np.where(w <= 0, self._face, a), self._face, self._edge)


def _fitted(inverse: _Inverse, start: float, width: float, floor: float) -> tuple[Floats, float]:
    """Coefficients in t of a over one piece, and the largest error relative to a between the nodes."""
    nodes = (1.0 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)) / 2.0
    values = inverse(start + width * nodes)
    coefficients: Floats = np.linalg.solve(np.vander(nodes, increasing=True), values).astype(float)
    between = (nodes[1:] + nodes[:-1]) / 2.0
    exact = inverse(start + width * between)
    fitted = np.polynomial.polynomial.polyval(between, coefficients)
    return coefficients, float(np.max(np.abs(fitted - exact) / np.maximum(exact, floor)))


def _piece(start: float, width: float, radius: Floats, depth: float) -> Piece:
    """The area's polynomial is the integral of a over d, with d = D w^4 and w = start + width t."""
    polynomial = np.polynomial.polynomial
    w = np.array([start, width])
    slope = 4.0 * depth * width * polynomial.polymul(polynomial.polypow(w, 3), radius)
    area = polynomial.polyint(slope)
    return Piece(start, width, tuple(radius[1:].tolist()), tuple(area[1:].tolist()))
