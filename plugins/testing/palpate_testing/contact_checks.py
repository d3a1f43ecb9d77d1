"""Checks of tips and contact models."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from palpate import ContactModel, Floats, Indenter, contact_force, force_over_time
from palpate_engine import Quantity

from palpate_testing.failure_messages import demand, demand_close

_DEPTHS = np.geomspace(1e-6, 6e-3, 60)  # [m], a palpation's range


def check_indenter(indenter: Indenter, depths: Floats = _DEPTHS) -> None:
    """A tip obeys the method of dimensionality reduction, and its one expression runs on every kind of number.

    Checked: contact radius finite, not negative, never shrinking; area 0 at touch, growing, with derivative A' = a;
    the same values from floats, arrays, complex numbers and CasADi symbols; for a tip whose numbers are all lengths, a
    tip twice as large has twice the contact radius at twice the depth.
    """
    name = type(indenter).__name__
    radius = _values(indenter.contact_radius, depths, f"{name}.contact_radius")
    area = _values(indenter.profile_area, depths, f"{name}.profile_area")
    _never_falls(radius, depths, f"{name}.contact_radius")
    _never_falls(area, depths, f"{name}.profile_area")
    demand(np.all(radius >= 0), f"{name}.contact_radius is negative")
    demand(abs(complex(indenter.profile_area(1e-15))) < 1e-12, f"{name}.profile_area is not 0 at touch")
    for method in ("contact_radius", "profile_area"):
        _same_everywhere(getattr(indenter, method), depths, f"{name}.{method}")
    steps = [_called(indenter.profile_area, d + 1e-30j, f"{name}.profile_area on a complex number") for d in depths]
    slope = np.array([complex(step).imag / 1e-30 for step in steps])
    own = type(indenter).profile_area is not Indenter.profile_area
    hint = "" if own else "; the default integral is for smooth contact radii: define profile_area"
    complaint = f"{name}: the derivative of profile_area is not contact_radius{hint}"
    demand_close(slope / radius, np.ones_like(radius), 1e-6, complaint)
    _scales(indenter, depths, radius, name)


def _scales(indenter: Indenter, depths: Floats, radius: Floats, name: str) -> None:
    """A tip of twice the size, where that is known by its settings."""
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


def usual_values(model: ContactModel) -> list[float]:
    """A value for each parameter within its bounds: its first guess, their middle, or the order of silicone."""
    usual = {"Pa": 1e5, "Pa*s": 300.0, "s": 0.1}
    values = []
    for parameter in model.parameters:
        value = parameter.start
        if value is None:
            finite = math.isfinite(parameter.lower) and math.isfinite(parameter.upper)
            value = 0.5 * (parameter.lower + parameter.upper) if finite else usual.get(parameter.unit, 1.0)
        values.append(min(max(value, parameter.lower), parameter.upper))
    return values


def check_force(model: ContactModel, theta: Sequence[float], depths: Floats = _DEPTHS) -> None:
    """A contact model takes (depth, rate, theta, memory) and answers one number; at rest it grows with depth.

    A model that declares `adhesive` may pull, and its force may fall with depth.
    """
    name = f"{type(model).__name__}.force"
    empty = (0.0,) * len(model.memory)
    try:
        inspect.signature(model.force).bind(1e-3, 0.0, list(theta), empty)
    except TypeError as error:
        raise AssertionError(f"{name} takes (depth, rate, theta, memory): {error}") from error
    at_rest = _values(lambda depth: contact_force(model, depth, 0.0, theta, empty), depths, name)
    _values(lambda depth: contact_force(model, depth, 0.01, theta, empty), depths, f"{name} at a rate of 0.01 m/s")
    if not model.adhesive:
        _never_falls(at_rest, depths, f"{name} at rest")


def check_model(model: ContactModel, theta: Sequence[float], depths: Floats = _DEPTHS) -> None:
    """A contact model pushes when pressed, and its one formula runs on every kind of number.

    Checked at parameters `theta`: one per parameter, within bounds; no force out of contact; force at rest growing with
    depth (unless it is `adhesive`); more force when pressed faster; the same values from floats, arrays and CasADi
    symbols; a Jacobian that is finite at every depth, 0 included.
    """
    name = type(model).__name__
    demand(len(theta) == len(model.parameters), f"{name} has {len(model.parameters)} parameters, {len(theta)} given")
    names = [parameter.name for parameter in model.parameters]
    demand(len(set(names)) == len(names), f"{name} has two parameters of one name")
    for parameter, value in zip(model.parameters, theta, strict=True):
        demand(parameter.lower <= value <= parameter.upper, f"{name}: {parameter.name} is out of its own bounds")
    empty = [0.0] * len(model.memory)
    outside = min(-1e-3, 2.0 * float(model.pull_off_depth(list(theta))))
    demand(float(contact_force(model, outside, -0.01, theta, empty)) == 0.0, f"{name} pushes out of contact")
    check_force(model, theta, depths)
    at_rest = _values(lambda d: contact_force(model, d, 0.0, theta, empty), depths, f"{name}.force")
    faster = contact_force(model, depths, 0.01, theta, empty) - at_rest
    demand(np.all(faster >= -1e-12 * np.abs(at_rest)), f"{name}.force is smaller when pressed faster")
    _same_everywhere(lambda d: contact_force(model, d, 0.01, theta, empty), depths, f"{name}.force")
    if model.memory:
        _remembers(model, theta, name)
    shift = model.delay_shift(list(theta))
    demand(len(shift) == len(theta), f"{name}.delay_shift gives {len(shift)} numbers for {len(theta)} parameters")
    _finite_jacobian(model, theta, np.concatenate([[-1e-3, 0.0], depths]))


def _remembers(model: ContactModel, theta: Sequence[float], name: str) -> None:
    """Internal states: one rate each, at any depth; the force on a ramp grows, and faster on a faster ramp."""
    empty = [0.0] * len(model.memory)
    for depth in (-1e-3, 0.0, 1e-3):
        rates = model.memory_rate(depth, 0.01, theta, empty)
        demand(len(rates) == len(empty), f"{name}.memory_rate gives {len(rates)} numbers for {len(empty)} states")
        demand(np.isfinite(np.array(rates, float)).all(), f"{name}.memory_rate is not finite at depth {depth:.3g} m")
    forces = []
    for duration in (0.1, 0.05):
        time = np.linspace(0.0, duration, 200)
        ramp = 1e-3 * time / duration
        forces.append(force_over_time(model, time, ramp, np.full(200, 1e-3 / duration), theta))
        _never_falls(forces[-1], ramp, f"{name}: the force on a ramp")
    demand(forces[1][-1] >= forces[0][-1], f"{name}: the force is smaller on a faster ramp")


def _values(function: Callable[[Any], Any], depths: Floats, name: str) -> Floats:
    """One depth at a time, so that what raises or is not a number is named with its depth."""
    values = []
    for depth in depths.tolist():
        try:
            value = float(function(depth))
        except Exception as error:
            raise AssertionError(f"{name} raises at depth {depth:.3g} m: {type(error).__name__}: {error}") from error
        demand(np.isfinite(value), f"{name} is {value} at depth {depth:.3g} m")
        values.append(value)
    return np.array(values)


def _never_falls(values: Floats, depths: Floats, name: str) -> None:
    falls = np.flatnonzero(np.diff(values) < -1e-12 * np.abs(values[1:]))
    where = depths[falls[0]] if len(falls) else 0.0
    demand(not len(falls), f"{name} is not monotone: it falls beyond a depth of {where:.3g} m")


def _same_everywhere(function: Callable[[Any], Any], depths: Floats, name: str) -> None:
    import casadi

    floats = np.array([float(function(float(depth))) for depth in depths])
    demand_close(_called(function, depths, f"{name} on an array"), floats, 1e-12, f"{name} on an array")
    symbol = casadi.SX.sym("d")
    compiled = casadi.Function("f", [symbol], [_called(function, symbol, f"{name} on a CasADi symbol")])
    demand_close([float(compiled(float(d))) for d in depths], floats, 1e-9, f"{name} on a CasADi symbol")


def _called(function: Callable[[Any], Any], argument: Any, name: str) -> Any:
    try:
        return function(argument)
    except Exception as error:
        how = "use plain operators, or log, sqrt, tanh, arctan, select of palpate"
        raise AssertionError(f"{name} raises {type(error).__name__}: {error}; {how}") from error


def _finite_jacobian(model: ContactModel, theta: Sequence[float], depths: Floats) -> None:
    import casadi

    memory = len(model.memory)
    state = casadi.SX.sym("s", 2 + memory + len(theta))
    numbers = casadi.vertsplit(state)
    force = contact_force(model, numbers[0], numbers[1], numbers[2 + memory :], numbers[2 : 2 + memory])
    # The slope of a root has a pole at 0, which filters step around: finite is asked of what is beyond a micrometre.
    jacobian = casadi.Function("j", [state], [casadi.jacobian(force, state)])
    for depth in depths[(depths <= 0) | (depths >= 1e-6)]:
        slopes = np.array(jacobian([depth, 0.0, *([0.0] * memory), *theta])).ravel()
        demand(
            np.all(np.isfinite(slopes)), f"{type(model).__name__}: the Jacobian is not finite at depth {depth:.3g} m"
        )
