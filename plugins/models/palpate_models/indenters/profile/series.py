"""A contact radius as a few polynomials in depth^(1/4), which run on every kind of number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats, select

from palpate_models.indenters.profile.inverse import ContactRadius

_DEGREE = 8  # a choice: of a piece
_MIN_WIDTH = 1 / 64  # of the whole range of depth^(1/4), a choice: narrowest piece


@dataclass(frozen=True)
class SeriesPiece:
    """Polynomials in t = (w - start)/width, clamped to 0..1, without their constants; lowest power first."""

    start: float
    width: float
    radius: tuple[float, ...]
    area: tuple[float, ...]


@dataclass(frozen=True)
class RadiusSeries:
    """a(d) as a sum of clamped polynomials in w = (d/D)^(1/4), and A(d) as the integral of that very sum.

    The fourth root makes contact radii that begin as d^(1/n), n = 1, 2, 4, smooth in w. Deeper than D the tip is
    assumed to continue as a straight shaft: a stays, A grows linearly.
    """

    depth: float  # D [m]
    face: float  # a(0+) [m]
    edge: float  # a(D) [m]
    pieces: tuple[SeriesPiece, ...]
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


def _clamped(w: Any, piece: SeriesPiece) -> Any:
    """Return t of a piece, 0 before and 1 after it."""
    t = (w - piece.start) / piece.width
    t = select(t, 0.0, t, 0.0 * t)
    return select(t, 1.0, 1.0 + 0.0 * t, t)


def _polynomial(coefficients: tuple[float, ...], t: Any) -> Any:
    """Return a polynomial without a constant, by Horner's scheme."""
    value: Any = 0.0
    for coefficient in reversed(coefficients):
        value = (value + coefficient) * t
    return value


def radius_series(exact: ContactRadius, tolerance: float, floor: float) -> RadiusSeries:
    """Return polynomials that follow a contact radius to a tolerance relative to a(d).

    Where a(d) is below `floor` times the edge, the tolerance is relative to that. Pieces are halved until they meet the
    tolerance or are as narrow as they may be.
    """
    # Start and width of the pieces that are not fitted yet, in depth^(1/4) over that of the edge.
    pieces, error, waiting = [], 0.0, [(0.0, 1.0)]
    while waiting:
        start, width = waiting.pop()
        radius, piece_error = _fit_piece(exact, start, width, floor * exact.edge)
        if piece_error > tolerance and width > _MIN_WIDTH:
            waiting += [(start + width / 2, width / 2), (start, width / 2)]
            continue
        pieces.append(_piece(start, width, radius, exact.depth))
        error = max(error, piece_error)
    edge = exact.face + sum(sum(piece.radius) for piece in pieces)
    return RadiusSeries(exact.depth, exact.face, edge, tuple(pieces), error)


def _fit_piece(exact: ContactRadius, start: float, width: float, floor: float) -> tuple[Floats, float]:
    """Return coefficients in t of a over one piece, and the largest error relative to a between the nodes."""
    # Interpolation at Chebyshev's extrema.
    nodes = (1.0 - np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)) / 2.0
    values = exact(start + width * nodes)
    coefficients: Floats = np.linalg.solve(np.vander(nodes, increasing=True), values).astype(float)
    between = (nodes[1:] + nodes[:-1]) / 2.0
    exact_radius = exact(start + width * between)
    radius = np.polynomial.polynomial.polyval(between, coefficients)
    return coefficients, float(np.max(np.abs(radius - exact_radius) / np.maximum(exact_radius, floor)))


def _piece(start: float, width: float, radius: Floats, depth: float) -> SeriesPiece:
    """Return a piece with the area's polynomial, the integral of a over d = D w^4 with w = start + width t."""
    polynomial = np.polynomial.polynomial
    w = np.array([start, width])
    slope = 4.0 * depth * width * polynomial.polymul(polynomial.polypow(w, 3), radius)
    area = polynomial.polyint(slope)
    return SeriesPiece(start, width, tuple(radius[1:].tolist()), tuple(area[1:].tolist()))
