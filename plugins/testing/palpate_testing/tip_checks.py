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
    demand(abs(complex(indenter.profile_area(1e-15))) < 1e-12, f"{name}.profile_area is not 0 at touch")
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
    """Compare the derivative of the area (complex step, n) with the contact radius (n,) [m]."""
    area = indenter.profile_area
    steps = [answer_on(area, depth + 1e-30j, f"{name}.profile_area on a complex number") for depth in depths]
    slope = np.array([complex(step).imag / 1e-30 for step in steps])
    has_closed_form = type(indenter).profile_area is not Indenter.profile_area
    hint = "" if has_closed_form else "; the default integral is for smooth contact radii: define profile_area"
    complaint = f"{name}: the derivative of profile_area is not contact_radius{hint}"
    demand_close(slope / radius, np.ones_like(radius), 1e-6, complaint)


def _check_scaling(indenter: Indenter, depths: Floats, radius: Floats, name: str) -> None:
    """Compare with a tip of twice the size, where the settings state the size."""
    sizes = {}
    for key, field in type(indenter).model_fields.items():
        units = [item.unit for item in field.metadata if isinstance(item, Quantity)]
        value = getattr(indenter, key)
        if units not in (["m"], ["rad"]) or not isinstance(value, float):
            return
        sizes[key] = 2.0 * value if units == ["m"] else value
    twice = type(indenter)(**sizes)
    demand_close(
        twice.contact_radius(2.0 * depths) / (2.0 * radius),
        np.ones_like(radius),
        1e-9,
        f"{name}.contact_radius: a tip of twice the size does not have twice the radius at twice the depth",
    )


def _check_shape(indenter: Indenter, depth: float, shape: Callable[[Floats], Floats], name: str) -> None:
    """Compare a surface z = f(r) [m] with the one that a plane would touch within the contact radius at a depth [m]."""
    radii, heights = tip_profile(indenter, depth, points=12)
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
    is_wider = float(indenter.contact_radius(deep)) > 1.001 * sphere_radius
    states_end = bool(indenter.validity(deep))
    demand(states_end or not is_wider, f"{name}.validity: at a depth of {DEEP:g} radii the contact is wider than it")
