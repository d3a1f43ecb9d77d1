"""Checks of tips and contact models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.contact import ContactModel, Indenter, contact_force
from palpate.testing.demand import demand, demand_close

_DEPTHS = np.geomspace(1e-6, 6e-3, 60)  # [m], a palpation's range


def check_indenter(indenter: Indenter, depths: NDArray[np.float64] = _DEPTHS) -> None:
    """A tip obeys the method of dimensionality reduction, and its one expression runs on every kind of number.

    Checked: contact radius finite, not negative, never shrinking; area 0 at touch, growing, with derivative A' = a;
    the same values from floats, arrays, complex numbers and CasADi symbols.
    """
    name = type(indenter).__name__
    radius = _values(indenter.contact_radius, depths, f"{name}.contact_radius")
    area = _values(indenter.profile_area, depths, f"{name}.profile_area")
    _never_falls(radius, depths, f"{name}.contact_radius")
    _never_falls(area, depths, f"{name}.profile_area")
    demand(np.all(radius >= 0), f"{name}.contact_radius is negative")
    demand(abs(complex(indenter.profile_area(1e-15))) < 1e-12, f"{name}.profile_area is not 0 at touch")
    slope = np.array([complex(indenter.profile_area(d + 1e-30j)).imag / 1e-30 for d in depths])
    demand_close(
        slope / radius, np.ones_like(radius), 1e-6, f"{name}: the derivative of profile_area is not contact_radius"
    )
    for method in ("contact_radius", "profile_area"):
        _same_everywhere(getattr(indenter, method), depths, f"{name}.{method}")


def check_model(model: ContactModel, theta: Sequence[float], depths: NDArray[np.float64] = _DEPTHS) -> None:
    """A contact model pushes when pressed, and its one formula runs on every kind of number.

    Checked at parameters `theta`: one per parameter, within bounds; no force out of contact; force at rest growing with
    depth; more force when pressed faster; the same values from floats, arrays and CasADi symbols; a Jacobian that is
    finite at every depth, 0 included.
    """
    name = type(model).__name__
    demand(len(theta) == len(model.parameters), f"{name} has {len(model.parameters)} parameters, {len(theta)} given")
    names = [parameter.name for parameter in model.parameters]
    demand(len(set(names)) == len(names), f"{name} has two parameters of one name")
    for parameter, value in zip(model.parameters, theta, strict=True):
        demand(parameter.lower <= value <= parameter.upper, f"{name}: {parameter.name} is out of its own bounds")
    demand(float(contact_force(model, -1e-3, -0.01, theta)) == 0.0, f"{name} pushes out of contact")
    at_rest = _values(lambda d: contact_force(model, d, 0.0, theta), depths, f"{name}.force")
    _never_falls(at_rest, depths, f"{name}.force at rest")
    faster = contact_force(model, depths, 0.01, theta) - at_rest
    demand(np.all(faster >= 0), f"{name}.force is smaller when pressed faster")
    _same_everywhere(lambda d: contact_force(model, d, 0.01, theta), depths, f"{name}.force")
    shift = model.delay_shift(list(theta))
    demand(len(shift) == len(theta), f"{name}.delay_shift gives {len(shift)} numbers for {len(theta)} parameters")
    _finite_jacobian(model, theta, np.concatenate([[-1e-3, 0.0], depths]))


def _values(function: Callable[[Any], Any], depths: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """One depth at a time, so that what raises or is no number is named with its depth."""
    values = []
    for depth in depths.tolist():
        try:
            value = float(function(depth))
        except Exception as error:
            raise AssertionError(f"{name} raises at depth {depth:.3g} m: {type(error).__name__}: {error}") from error
        demand(np.isfinite(value), f"{name} is {value} at depth {depth:.3g} m")
        values.append(value)
    return np.array(values)


def _never_falls(values: NDArray[np.float64], depths: NDArray[np.float64], name: str) -> None:
    falls = np.flatnonzero(np.diff(values) < -1e-12 * np.abs(values[1:]))
    where = depths[falls[0]] if len(falls) else 0.0
    demand(not len(falls), f"{name} is not monotone: it falls beyond a depth of {where:.3g} m")


def _same_everywhere(function: Callable[[Any], Any], depths: NDArray[np.float64], name: str) -> None:
    import casadi

    floats = np.array([float(function(float(depth))) for depth in depths])
    demand_close(function(depths), floats, 1e-12, f"{name} on an array")
    symbol = casadi.SX.sym("d")
    compiled = casadi.Function("f", [symbol], [function(symbol)])
    demand_close([float(compiled(float(d))) for d in depths], floats, 1e-9, f"{name} on a CasADi symbol")


def _finite_jacobian(model: ContactModel, theta: Sequence[float], depths: NDArray[np.float64]) -> None:
    import casadi

    state = casadi.SX.sym("s", 2 + len(theta))
    force = contact_force(model, state[0], state[1], casadi.vertsplit(state[2:]))
    # The slope of a root has a pole at 0, which filters step around: finite is asked of what is beyond a micrometre.
    jacobian = casadi.Function("j", [state], [casadi.jacobian(force, state)])
    for depth in depths[(depths <= 0) | (depths >= 1e-6)]:
        numbers = np.array(jacobian([depth, 0.0, *theta])).ravel()
        demand(
            np.all(np.isfinite(numbers)), f"{type(model).__name__}: the Jacobian is not finite at depth {depth:.3g} m"
        )
