"""A contact radius as a power of depth times one polynomial: for tips without kinks, and cheap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import select

from palpate_models.indenters.profile.inverse import ContactRadius

_DEGREES = range(2, 17, 2)  # a choice (0033): the shortest that meets the tolerance is taken
_EXPONENTS = (1.0, 2 / 3, 1 / 2, 1 / 3, 1 / 4, 1 / 6)  # of r, r^1.5, r^2, r^3, r^4, r^6
_EXPONENT_TOLERANCE = 0.02  # a choice: an exponent so near to one of these is that one
_APEX_RADII = (1e-3, 4e-3)  # of the edge, a choice: there the exponent at the apex is taken
_CHECKS_PER_DEGREE = 8  # a choice: depths at which a polynomial is compared
_APEX_POINTS = 4000  # a choice: of the contact radius by depth^(1/4) near the apex
_MIN_APEX = 1e-6  # of depth^(1/4), a choice: where these points begin


@dataclass(frozen=True)
class SmoothRadius:
    """a(d) = s^e P(s) with s = d/D, and A(d) as the integral of that very product, D s^(e+1) sum c_j/(j + 1 + e) s^j.

    Deeper than D the tip is assumed to continue as a straight shaft: a stays, A grows linearly.
    """

    depth: float  # D [m]
    edge: float  # a(D) [m]
    exponent: float  # e
    radius: tuple[float, ...]  # c_j [m], lowest power first
    error: float  # largest deviation of a(d) from the exact root, relative

    def contact_radius(self, depth: Any) -> Any:
        """a(d) [m]."""
        s = self._clamped(depth)
        return s**self.exponent * _polynomial(self.radius, s)

    def profile_area(self, depth: Any) -> Any:
        """A(d) [m^2]."""
        s = self._clamped(depth)
        integral = tuple(c / (j + 1 + self.exponent) for j, c in enumerate(self.radius))
        within = self.depth * s * s**self.exponent * _polynomial(integral, s)
        return within + self.edge * select(depth, self.depth, depth - self.depth, 0.0 * depth)

    def _clamped(self, depth: Any) -> Any:
        s = depth / self.depth
        return select(s, 1.0, 1.0 + 0.0 * s, s)


def _polynomial(coefficients: tuple[float, ...], s: Any) -> Any:
    """Return a polynomial by Horner's scheme."""
    value: Any = 0.0
    for coefficient in reversed(coefficients):
        value = value * s + coefficient
    return value


def smooth_radius(exact: ContactRadius, tolerance: float, floor: float) -> SmoothRadius | None:
    """Return a power times the shortest polynomial that follows a contact radius to a tolerance; None where none does.

    The polynomial is in s = d/D, depth over that at the edge; `exact` takes s^(1/4). The tolerance is relative to a(d),
    or to `floor` times the edge where a(d) is less.
    """
    if exact.face > 0:
        return None
    exponent = _apex_exponent(exact)
    chebyshev = np.polynomial.chebyshev
    for degree in _DEGREES:
        # Interpolation at Chebyshev's nodes.
        nodes = (1.0 + chebyshev.chebpts1(degree + 1)) / 2.0
        values = exact(nodes**0.25) / nodes**exponent
        series = chebyshev.Chebyshev.fit(nodes, values, degree, domain=[0.0, 1.0])
        coefficients = series.convert(kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]).coef
        # The radius between the nodes, which has to grow.
        s = np.linspace(0.0, 1.0, _CHECKS_PER_DEGREE * degree + 1)[1:] ** 2
        exact_radius = exact(s**0.25)
        fitted_radius = s**exponent * np.polynomial.polynomial.polyval(s, coefficients)
        difference = np.abs(fitted_radius - exact_radius) / np.maximum(exact_radius, floor * exact.edge)
        error = float(np.max(difference))
        if error <= tolerance and np.all(np.diff(fitted_radius) > 0):
            radius = tuple(coefficients.tolist())
            return SmoothRadius(depth=exact.depth, edge=sum(radius), exponent=exponent, radius=radius, error=error)
    return None


def _apex_exponent(exact: ContactRadius) -> float:
    """Return e of a(d) ~ d^e at the apex, that of a common shape where it is near."""
    # The slope of ln a by ln d = 4 ln w between two small radii.
    w = np.geomspace(_MIN_APEX, 1.0, _APEX_POINTS)
    a = exact(w)
    near, far = (float(np.interp(np.log(share * exact.edge), np.log(a), np.log(w))) for share in _APEX_RADII)
    exponent = float(np.log(_APEX_RADII[1] / _APEX_RADII[0]) / (4.0 * (far - near)))
    closest = min(_EXPONENTS, key=lambda e: abs(e - exponent))
    return closest if abs(closest - exponent) < _EXPONENT_TOLERANCE else exponent
