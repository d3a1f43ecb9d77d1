"""The MDR integral of a profile: g(x) = x * integral of f'(r)/sqrt(x^2 - r^2) over r from 0 to x."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from palpate import Floats

_PANELS = 20  # a choice: of the quadrature, for formulas
_NODES = 12  # a choice: of each panel
_KINK_RADII = 1000  # a choice: radii in the search for kinks
_KINK_RATIO = 5  # a choice: a jump of the slope over the changes around it
_MIN_JUMP = 1e-9  # of the largest change, a choice: a smaller jump is rounding
_JUMP_LEFT = 0.5  # of a jump, a choice: a kink keeps more when its interval shrinks, a bend does not
_HALVINGS = 60  # of an interval: 1e-18, below rounding
_COMPLEX_STEP = 1e-40  # [m]; the derivative by a complex step has no difference, so that any small one is exact


def reduced_of_curve(curve: Any) -> Callable[[Floats], Floats]:
    """Return g(x) of a scipy piecewise cubic f(r): exact, since its slope is a quadratic on each piece.

    With r = x sin(p) the integral is x times that of f'(x sin p) over p from 0 to pi/2.
    """
    edges, slope = curve.x, curve.derivative()
    # Coefficients of the slope in powers of r itself, not of the distance from the piece's start.
    c2, c1, c0 = slope.c
    start = edges[:-1]
    powers = np.array([c0 - c1 * start + c2 * start**2, c1 - 2 * c2 * start, c2])

    def reduced(x: Floats) -> Floats:
        # Angles p of the pieces' edges; an edge beyond x is at pi/2. Then the integrals of 1, sin p and sin^2 p.
        with np.errstate(divide="ignore", invalid="ignore"):
            sine = np.minimum(np.where(x[:, None] > 0, edges / x[:, None], 1.0), 1.0)
        angle, cosine = np.arcsin(sine), np.sqrt((1 - sine) * (1 + sine))
        square = (angle - sine * cosine) / 2  # integral of sin^2
        terms = np.diff(angle), -x[:, None] * np.diff(cosine), x[:, None] ** 2 * np.diff(square)
        return np.asarray(x * sum(term @ power for term, power in zip(terms, powers, strict=True)), float)

    return reduced


def reduced_of_function(profile: Callable[[Any], Any], edge: float) -> Callable[[Floats], Floats]:
    """Return the reduced profile g(x) [m] of a profile f(r) [m], 0 <= r <= edge, that takes complex numbers.

    With r = x sin(p), g(x) = x times the integral of f'(x sin p) over p from 0 to pi/2. The slope f' is exact, by a
    complex step; the integral is by Gauss-Legendre on panels of p, each of which is divided at every kink of f.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)

    def slope(radii: Floats) -> Floats:
        return np.broadcast_to(np.imag(profile(radii + 1j * _COMPLEX_STEP)) / _COMPLEX_STEP, radii.shape)

    kink_radii = np.array(_kinks(slope, edge))
    panels = np.linspace(0.0, np.pi / 2, _PANELS + 1)

    def reduced(x: Floats) -> Floats:
        # Panels of the angle p, divided at the kinks; one beyond x is at pi/2, and makes a panel without width.
        with np.errstate(divide="ignore"):
            kink_angles = np.arcsin(np.minimum(kink_radii / x[:, None], 1.0))
        panel_ends = np.sort(np.hstack([np.tile(panels, (len(x), 1)), kink_angles]), axis=1)
        half_widths = np.diff(panel_ends)[:, :, None] / 2
        # Nodes from -1..1 on each panel.
        angles = panel_ends[:, :-1, None] + half_widths * (1 + nodes)
        slopes = slope(x[:, None, None] * np.sin(angles))
        return np.asarray(x * np.sum(slopes * half_widths * weights, axis=(1, 2)), float)

    return reduced


def _kinks(slope: Callable[[Floats], Floats], edge: float) -> list[float]:
    """Return the radii [m] at which the slope of a profile jumps."""
    # Candidates: intervals whose slope changes far more than around them.
    # Around are the intervals two and three away, since the next ones may have a part of the kink.
    radii = np.linspace(0.0, edge, _KINK_RADII + 2)[1:-1]
    change = np.abs(np.diff(slope(radii)))
    around = np.maximum.reduce([np.roll(change, shift) for shift in (-3, -2, 2, 3)])
    kinks = []
    for i in np.flatnonzero(change > _KINK_RATIO * around + _MIN_JUMP * np.max(change, initial=0.0)):
        # The half that has more of the change, again and again.
        low, high = radii[i], radii[i + 1]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            slope_low, slope_middle, slope_high = slope(np.array([low, middle, high]))
            is_below = abs(slope_middle - slope_low) > abs(slope_high - slope_middle)
            low, high = (low, middle) if is_below else (middle, high)
        if abs(np.diff(slope(np.array([low, high])))[0]) > _JUMP_LEFT * change[i]:
            kinks.append(float(high))
    return kinks
