"""A tip of any profile: from a drawing, a scan or a formula."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from palpate import Depth, Floats, Indenter, InputFile, Length
from pydantic import Field, model_validator

from palpate_models.indenters.profile.formula import parse_formula
from palpate_models.indenters.profile.inverse import ContactRadius
from palpate_models.indenters.profile.points import curve_through, read_points
from palpate_models.indenters.profile.series import RadiusSeries, radius_series
from palpate_models.indenters.profile.smooth import SmoothRadius, smooth_radius
from palpate_models.indenters.profile.transform import reduced_of_curve, reduced_of_function

__all__ = ["Profile"]

_UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}  # [m]
# Tolerance of a(d), and the share of the edge to which it is relative below that share; choices: a formula is exact to
# rounding, points of a drawing or scan are not.
_FORMULA_TOLERANCE = (1e-9, 1e-6)
_POINTS_TOLERANCE = (1e-6, 1e-2)
_MAX_SLOPE = 1e6  # a choice: a steeper formula is vertical
_MAX_ERROR = 1e-3  # of a(d), a choice: a tip that the series does not follow this well is refused
_CHECK_POINTS = 1001  # a choice: radii at which a formula is checked
_ROUNDING = 1e-12  # of the largest height, a choice: rounding of a formula
_EDGE_ROUNDING = 1e-9  # of the edge, a choice: rounding of a stated radius
_COMPLEX_STEP = 1e-40  # [m]; the derivative by a complex step has no difference, so that any small one is exact


class Profile(Indenter):
    """A tip of any axisymmetric profile z = f(r), from a CSV file of points or from a formula.

    The MDR integral g(x) = x * integral of f'(r)/sqrt(x^2 - r^2) over r from 0 to x is computed once, exactly for the
    piecewise cubic through points, by quadrature for a formula; its inverse a(d) is kept as a power times a polynomial
    of depth, to 1e-9 of a(d) for a smooth formula, or as several polynomials in d^(1/4) where the tip has kinks. Beyond
    its edge the tip counts as a straight shaft.
    Assumes a profile that begins at the apex, never falls, and is the same all around; small strain as for every tip.
    Source: Popov and Hess 2015, eq. of the reduced profile; paper, section on the method of dimensionality reduction.
    """

    points: InputFile | None = Field(
        default=None, description="CSV file of two columns, radius r and height z over the apex, from the apex outwards"
    )
    unit: Literal["m", "mm", "um"] = Field(default="mm", description="unit of both columns of the file")
    formula: str | None = Field(
        default=None, description='height over the apex in m by r in m, such as "R - sqrt(R**2 - r**2)"; needs radius'
    )
    constants: dict[str, Length] = Field(
        default={}, description='constants of the formula, lengths such as { R = "5 mm" } or plain numbers'
    )
    radius: Depth | None = Field(
        default=None, gt=0, description="radius at the edge of the tip; left out with points: the last one"
    )

    @model_validator(mode="after")
    def _check_profile(self) -> Self:
        _ = self._series
        return self

    @cached_property
    def _series(self) -> RadiusSeries | SmoothRadius:
        """Return the contact radius by depth; raises ValueError where the profile cannot be a tip's."""
        if (self.points is None) == (self.formula is None):
            raise ValueError("give either points or a formula")
        if self.points is not None:
            (reduced, edge), tolerance = self._reduced_points(), _POINTS_TOLERANCE
        else:
            (reduced, edge), tolerance = self._reduced_formula(), _FORMULA_TOLERANCE
        source = self.points or repr(self.formula)
        try:
            exact = ContactRadius(reduced, edge)
            series = smooth_radius(exact, *tolerance) or radius_series(exact, *tolerance)
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from error
        if series.error > _MAX_ERROR:
            raise ValueError(f"{source}: too rough a profile: its contact radius is kept to {series.error:.1%} only")
        return series

    def _reduced_points(self) -> tuple[Callable[[Floats], Floats], float]:
        """Return the reduced profile g(x) of the file, and the edge [m]; raises ValueError."""
        assert self.points is not None
        if self.constants:
            raise ValueError("constants belong to a formula")
        radii, heights = read_points(self.points, _UNITS[self.unit])
        edge = self.radius if self.radius is not None else float(radii[-1])
        if edge > radii[-1] * (1 + _EDGE_ROUNDING):
            raise ValueError(f"{self.points}: the points end at {radii[-1]:.4g} m, before the radius {edge:.4g} m")
        return reduced_of_curve(curve_through(radii, heights)), edge

    def _reduced_formula(self) -> tuple[Callable[[Floats], Floats], float]:
        """Return the reduced profile g(x) of the formula, and the edge [m]; raises ValueError for no tip."""
        assert self.formula is not None
        if self.radius is None:
            raise ValueError("a formula needs the radius at the edge of the tip")
        profile = parse_formula(self.formula, self.constants)
        # Heights are finite, begin with 0, and never fall.
        radii = np.linspace(0.0, self.radius, _CHECK_POINTS)
        with np.errstate(all="ignore"):
            heights = np.broadcast_to(np.asarray(profile(radii), float), radii.shape)
        broken = np.flatnonzero(~np.isfinite(heights))
        if len(broken):
            raise ValueError(f"{self.formula!r} is {heights[broken[0]]} at r = {radii[broken[0]]:.4g} m")
        if abs(heights[0]) > _ROUNDING * float(np.max(np.abs(heights))):
            raise ValueError(
                f"{self.formula!r} is {heights[0]:.4g} m at r = 0; the profile must begin at the apex with 0"
            )
        falls = np.flatnonzero(np.diff(heights) < -_ROUNDING * np.max(np.abs(heights)))
        if len(falls):
            raise ValueError(f"{self.formula!r} falls at r = {radii[falls[0]]:.4g} m; the tip would be hollow")
        # No slope is vertical.
        with np.errstate(all="ignore"):
            slopes = np.broadcast_to(np.imag(profile(radii + 1j * _COMPLEX_STEP)) / _COMPLEX_STEP, radii.shape)
        steep = np.flatnonzero(~(np.abs(slopes) < _MAX_SLOPE))
        if len(steep):
            raise ValueError(f"{self.formula!r} is vertical at r = {radii[steep[0]]:.4g} m; end the tip before it")
        return reduced_of_function(profile, self.radius), self.radius

    def contact_radius(self, depth: Any) -> Any:
        """Return the root a of g(a) = d [m], by the series."""
        return self._series.contact_radius(depth)

    def profile_area(self, depth: Any) -> Any:
        """Return the integral of the series [m^2]."""
        return self._series.profile_area(depth)

    def validity(self, depth: float) -> str:
        """Return a warning beyond the depth at which the edge touches: a shaft is assumed there."""
        if depth <= self._series.depth:
            return ""
        return f"the tip's profile ends at a depth of {1e3 * self._series.depth:.3g} mm; beyond, a shaft is assumed"
