"""Checks of tips."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from palpate import Floats, Indenter, tip_profile
from palpate_engine import Quantity

from palpate_testing.expression_checks import (
    DEPTHS,
    answer_on,
    demand_continuous,
    demand_rising,
    demand_same_everywhere,
    values_of,
)
from palpate_testing.failure_messages import demand, demand_close

COMPLEX_STEP = 1e-30  # [m], a derivative by a complex step has no cancellation (Squire and Trapp 1998)
SLOPE_ERROR = 1e-6  # of the contact radius (a choice: the default area is an integral by quadrature)
SCALING_ROUNDING = 1e-9  # of the contact radius (a choice)
TOUCH_DEPTH, TOUCH_AREA = 1e-15, 1e-12  # [m] of a touch, and [m^2] up to which an area counts as 0 (choices)
COMPARED_RADII = 12  # of a shape (a choice)
SPHERE_EXCESS = 1.001  # times a sphere's radius: a wider contact is wider than the sphere
MAX_CONTACT_RADIUS = 0.5  # [m] at the depths of a palpation; a larger one is in other units than metres
SHALLOW = 1e-3  # of a sphere's radius, at which it is its paraboloid r^2/(2 R) to 0.1 %
SHAPE_ERROR = 0.01  # of the depth, between the tip's shape and that of its contact radius
DEEP = 30.0  # radii of a sphere; no part of it is so deep in contact


def check_indenter(
    indenter: Indenter, depths: Floats = DEPTHS, shape: Callable[[Floats], Floats] | None = None
) -> None:
    """Check that a tip obeys the method of dimensionality reduction and has the shape that it states.

    Checked: contact radius finite, also at touch, not negative, never shrinking, without jumps, in metres; area 0 at
    touch, growing, with derivative A' = a; the same values from floats, arrays, complex numbers and CasADi symbols;
    for a tip whose numbers are all lengths, a tip twice as large has twice the contact radius at twice the depth.
    Where a plane touches the tip decides its contact radius: `shape`, the height z = f(r) (n,) [m] of its surface at
    radii (n,) [m], is compared with the shape that the contact radius stands for, and so is that of a sphere.
    Raises AssertionError with the reason.
    """
    name = type(indenter).__name__
    radius = values_of(indenter.contact_radius, depths, f"{name}.contact_radius")
    area = values_of(indenter.profile_area, depths, f"{name}.profile_area")
    for method in ("contact_radius", "profile_area"):
        values_of(getattr(indenter, method), np.zeros(1), f"{name}.{method}")
    demand_rising(radius, depths, f"{name}.contact_radius")
    demand_rising(area, depths, f"{name}.profile_area")
    demand(np.all(radius >= 0), f"{name}.contact_radius is negative")
    demand(radius[-1] <= MAX_CONTACT_RADIUS, f"{name}.contact_radius is {radius[-1]:.3g} m: is it in metres?")
    area_at_touch = abs(complex(indenter.profile_area(TOUCH_DEPTH)))
    demand(area_at_touch < TOUCH_AREA, f"{name}.profile_area is not 0 at touch")
    for method in ("contact_radius", "profile_area"):
        demand_same_everywhere(getattr(indenter, method), depths, f"{name}.{method}")
    demand_continuous(indenter.contact_radius, depths, f"{name}.contact_radius")
    _check_slope(indenter, depths, radius, name)
    _check_scaling(indenter, depths, radius, name)
    if shape is not None:
        _check_shape(indenter, float(depths[-1]), shape, f"{name}: its surface")
    if indenter.sphere_radius is not None:
        _check_sphere(indenter, indenter.sphere_radius, name)


def _check_slope(indenter: Indenter, depths: Floats, radius: Floats, name: str) -> None:
    """Compare the derivative of the area by the depth, Im A(d + i h)/h, with the contact radius (n,) [m]."""
    subject = f"{name}.profile_area on a complex number"
    areas = [answer_on(indenter.profile_area, depth + COMPLEX_STEP * 1j, subject) for depth in depths]
    slope = np.array([complex(area).imag / COMPLEX_STEP for area in areas])
    has_closed_form = type(indenter).profile_area is not Indenter.profile_area
    hint = "" if has_closed_form else "; the default integral is for smooth contact radii: define profile_area"
    complaint = f"{name}: the derivative of profile_area is not contact_radius{hint}"
    demand_close(slope / radius, np.ones_like(radius), SLOPE_ERROR, complaint)


def _check_scaling(indenter: Indenter, depths: Floats, radius: Floats, name: str) -> None:
    """Compare with a tip of twice the size, if all settings are lengths and angles."""
    doubled_settings = {}
    for key, field in type(indenter).model_fields.items():
        units = [item.unit for item in field.metadata if isinstance(item, Quantity)]
        size = getattr(indenter, key)
        if units not in (["m"], ["rad"]) or not isinstance(size, float):
            return
        doubled_settings[key] = 2.0 * size if units == ["m"] else size
    doubled = type(indenter)(**doubled_settings)
    demand_close(
        doubled.contact_radius(2.0 * depths) / (2.0 * radius),
        np.ones_like(radius),
        SCALING_ROUNDING,
        f"{name}.contact_radius: a tip of twice the size does not have twice the radius at twice the depth",
    )


def _check_shape(indenter: Indenter, depth: float, shape: Callable[[Floats], Floats], name: str) -> None:
    """Compare a surface z = f(r) [m] with the one that a plane would touch within the contact radius at a depth [m]."""
    radii, heights = tip_profile(indenter, depth, points=COMPARED_RADII)
    expected = np.asarray(shape(radii), float) + 0.0 * radii
    worst = int(np.argmax(np.abs(heights - expected)))
    stated, implied = 1e3 * expected[worst], 1e3 * heights[worst]
    demand(
        abs(heights[worst] - expected[worst]) <= SHAPE_ERROR * depth,
        f"{name} rises to {stated:.4g} mm at a radius of {1e3 * radii[worst]:.3g} mm, and its contact radius is that "
        f"of a tip which rises to {implied:.4g} mm there",
    )


def _check_sphere(indenter: Indenter, sphere_radius: float, name: str) -> None:
    """Check that a sphere is r^2/(2 R) at its apex, and states the depth from which on it is a sphere no more."""
    _check_shape(indenter, SHALLOW * sphere_radius, lambda r: r * r / (2.0 * sphere_radius), f"{name}: a sphere")
    deep = DEEP * sphere_radius
    is_wider = float(indenter.contact_radius(deep)) > SPHERE_EXCESS * sphere_radius
    states_end = bool(indenter.validity(deep))
    demand(states_end or not is_wider, f"{name}.validity: at a depth of {DEEP:g} radii the contact is wider than it")
