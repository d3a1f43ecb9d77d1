"""Checks of contact models."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Sequence

import numpy as np
from palpate import ContactModel, Floats, contact_force, force_over_time, is_unit

from palpate_testing.expression_checks import (
    DEPTHS,
    ROUNDING,
    demand_continuous,
    demand_rising,
    demand_same_everywhere,
    values_of,
)
from palpate_testing.failure_messages import demand, demand_close

BROKEN_POWER = re.compile(r"\^\d+\.\d+")  # of a unit such as N/m^1.2, whose symbols are known
FAST = 0.01  # [m/s], the rate of a palpation
TOUCH = 1e-9  # [m]
STEEP_AT_TOUCH = 10.0  # times the stiffness at a depth of 0.1 mm: F ~ d^0.75 and blunter laws
ROLE_ERROR = 1e-4  # of the share, from its proportionality; laws with a root as a series are off by some 5e-6
EFFECT = 1e-9  # of the force, below which a parameter has none
LATE = 1e-4  # [s] of the delay whose effect is compared with delay_shift


def usual_values(model: ContactModel) -> list[float]:
    """Return a value for each parameter within its bounds: its first guess, their middle, or the order of silicone."""
    usual = {"Pa": 1e5, "Pa*s": 300.0, "s": 0.1}
    values = []
    for parameter in model.parameters:
        value = parameter.start
        if value is None:
            finite = math.isfinite(parameter.lower) and math.isfinite(parameter.upper)
            value = 0.5 * (parameter.lower + parameter.upper) if finite else usual.get(parameter.unit, 1.0)
        values.append(min(max(value, parameter.lower), parameter.upper))
    return values


def check_force(model: ContactModel, theta: Sequence[float], depths: Floats = DEPTHS) -> None:
    """Check that a contact model takes (depth, rate, theta, memory) and returns one number that grows with depth.

    A model that declares `adhesive` may pull, and its force may fall with depth. Raises AssertionError.
    """
    name = f"{type(model).__name__}.force"
    empty = (0.0,) * len(model.memory)
    try:
        inspect.signature(model.force).bind(1e-3, 0.0, list(theta), empty)
    except TypeError as error:
        raise AssertionError(f"{name} takes (depth, rate, theta, memory): {error}") from error
    at_rest = values_of(lambda depth: contact_force(model, depth, 0.0, theta, empty), depths, name)
    values_of(lambda depth: contact_force(model, depth, FAST, theta, empty), depths, f"{name} at a rate of 0.01 m/s")
    if not model.adhesive:
        demand_rising(at_rest, depths, f"{name} at rest")


def check_model(model: ContactModel, theta: Sequence[float], depths: Floats = DEPTHS) -> None:
    """Check that a contact model pushes when pressed, and that its one formula is what it states of itself.

    Checked at parameters `theta`: one per parameter, within bounds, as is each first guess, of a known unit and each
    with an effect of its role; no force out of contact, none that jumps or is infinitely stiff at touch; force at rest
    growing with depth (unless it is `adhesive`); more force when pressed faster, less when leaving; the same values
    from floats, arrays and CasADi symbols; a Jacobian that is finite at every depth; `material` and `delay_shift` by
    differences. Raises AssertionError with the reason.
    """
    name = type(model).__name__
    check_parameters(model, theta)
    empty = [0.0] * len(model.memory)
    outside = min(-1e-3, 2.0 * float(model.pull_off_depth(list(theta))))
    demand(float(contact_force(model, outside, -FAST, theta, empty)) == 0.0, f"{name} pushes out of contact")
    check_force(model, theta, depths)
    demand_same_everywhere(lambda d: contact_force(model, d, FAST, theta, empty), depths, f"{name}.force")
    demand_continuous(lambda d: contact_force(model, d, 0.0, theta, empty), depths, f"{name}.force at rest")
    _check_damping(model, theta, depths)
    if not model.adhesive:
        _check_touch(model, theta, float(depths[-1]))
    if model.memory:
        _check_memory(model, theta)
    _check_effects(model, theta, depths)
    _check_material(model, theta)
    shift = model.delay_shift(list(theta))
    demand(len(shift) == len(theta), f"{name}.delay_shift gives {len(shift)} numbers for {len(theta)} parameters")
    if not model.memory and any(shift):
        _check_delay_shift(model, theta, shift)
    _check_jacobian(model, theta, np.concatenate([[-1e-3, 0.0], depths]))


def check_parameters(model: ContactModel, theta: Sequence[float]) -> None:
    """Check names, units, bounds and first guesses of a model's parameters; raises AssertionError."""
    name = type(model).__name__
    demand(len(theta) == len(model.parameters), f"{name} has {len(model.parameters)} parameters, {len(theta)} given")
    names = [parameter.name for parameter in model.parameters]
    demand(len(set(names)) == len(names), f"{name} has two parameters of one name")
    for parameter, value in zip(model.parameters, theta, strict=True):
        demand(parameter.lower <= value <= parameter.upper, f"{name}: {parameter.name} is out of its own bounds")
        start = parameter.start
        within = start is None or parameter.lower <= start <= parameter.upper
        demand(within, f"{name}: the start of {parameter.name} is out of its own bounds")
        known = parameter.unit == "1" or is_unit(BROKEN_POWER.sub("^2", parameter.unit))
        demand(known, f"{name}: the unit {parameter.unit!r} of {parameter.name} is not known")


def _check_damping(model: ContactModel, theta: Sequence[float], depths: Floats) -> None:
    """Compare the force when pressed and when leaving with that at rest."""
    name, empty = type(model).__name__, [0.0] * len(model.memory)
    at_rest = contact_force(model, depths, 0.0, theta, empty)
    rounding = ROUNDING * np.abs(at_rest)
    pressed = contact_force(model, depths, FAST, theta, empty)
    leaving = contact_force(model, depths, -FAST, theta, empty)
    demand(np.all(pressed - at_rest >= -rounding), f"{name}.force is smaller when pressed faster")
    demand(np.all(at_rest - leaving >= -rounding), f"{name}.force is larger when leaving")


def _check_touch(model: ContactModel, theta: Sequence[float], deepest: float) -> None:
    """Check that the force begins at 0, with a finite stiffness."""
    name, empty = type(model).__name__, [0.0] * len(model.memory)
    touch, shallow, deep = (float(contact_force(model, d, 0.0, theta, empty)) for d in (TOUCH, 1e-4, deepest))
    demand(touch <= 1e-3 * deep, f"{name}.force jumps to {touch:.3g} N at touch")
    stiffness = shallow / 1e-4
    demand(touch / TOUCH <= STEEP_AT_TOUCH * stiffness, f"{name}.force is infinitely stiff at touch")


def _check_effects(model: ContactModel, theta: Sequence[float], depths: Floats) -> None:
    """Check that each parameter has an effect on a ramp and a hold, and the one that its role states."""
    name, empty = type(model).__name__, [0.0] * len(model.memory)
    time = np.linspace(0.0, 2.0, 400)
    depth, rate = np.minimum(2e-3 * time, 2e-3), np.where(time < 1.0, 2e-3, 0.0)
    force = force_over_time(model, time, depth, rate, theta)
    for place, parameter in enumerate(model.parameters):
        more = list(theta)
        more[place] = theta[place] * 1.01 if theta[place] else 1e-3
        change = np.abs(force_over_time(model, time, depth, rate, more) - force).max()
        demand(change > EFFECT * np.abs(force).max(), f"{name}: {parameter.name} has no effect on the force")
        if parameter.role is None or not theta[place] or model.adhesive:
            continue
        half, twice = list(theta), list(theta)
        half[place], twice[place] = 0.5 * theta[place], 2.0 * theta[place]

        def share(values: Sequence[float], role: str = parameter.role) -> Floats:
            """Return the force at rest, or what a rate adds to it (n,) [N]."""
            at_rest = np.asarray(contact_force(model, depths, 0.0, values, empty), float)
            return at_rest if role == "elastic" else contact_force(model, depths, FAST, values, empty) - at_rest

        # A role is a share that is linear in the parameter: from one to two it grows twice as much as from a half.
        grown, first = share(twice) - share(theta), 2.0 * (share(theta) - share(half))
        complaint = f"{name}: the force is not proportional to {parameter.name}, whose role is {parameter.role!r}"
        demand(np.abs(first).max() > EFFECT * np.abs(force).max(), complaint)
        demand_close(grown, first, ROLE_ERROR, complaint)


def _check_material(model: ContactModel, theta: Sequence[float]) -> None:
    """Compare the gradients of `material` with differences."""
    name = type(model).__name__
    values = model.material(list(theta))
    for number, value in enumerate(values):
        what = f"{name}.material: the gradient of {value.name}"
        demand(np.isfinite(value.value), f"{name}.material: {value.name} is {value.value}")
        demand(
            len(value.gradient) == len(theta), f"{what} has {len(value.gradient)} numbers for {len(theta)} parameters"
        )
        for place, parameter in enumerate(model.parameters):
            step = 1e-5 * (abs(theta[place]) or 1.0)
            more, less = list(theta), list(theta)
            more[place], less[place] = theta[place] + step, theta[place] - step
            above, below = model.material(more)[number].value, model.material(less)[number].value
            slope = (above - below) / (2.0 * step)
            scale = max(abs(slope), abs(value.value) / (abs(theta[place]) or 1.0) * 1e-6)
            is_right = abs(value.gradient[place] - slope) <= 1e-3 * scale
            demand(is_right, f"{what} by {parameter.name} is {value.gradient[place]:.4g}, by differences {slope:.4g}")


def _check_delay_shift(model: ContactModel, theta: Sequence[float], shift: Sequence[float]) -> None:
    """Compare `delay_shift` with what least squares finds of a slow motion whose force is recorded late."""
    time = np.linspace(0.0, 4.0, 800)
    omega = 2.0 * np.pi * 0.5

    def force(values: Sequence[float], delay: float = 0.0) -> Floats:
        phase = omega * (time - delay)
        return force_over_time(model, time, 3e-3 + 1e-3 * np.sin(phase), 1e-3 * omega * np.cos(phase), values)

    steps = [1e-6 * (abs(value) or 1.0) for value in theta]
    stepped = [[*theta[:i], theta[i] + step, *theta[i + 1 :]] for i, step in enumerate(steps)]
    jacobian = np.column_stack([(force(v) - force(theta)) / step for v, step in zip(stepped, steps, strict=True)])
    scale = np.abs(jacobian).max(axis=0)
    late = (force(theta, LATE) - force(theta)) / LATE
    scaled_shift, *_ = np.linalg.lstsq(jacobian / scale, late, rcond=None)
    # Each shift counts by the force [N/s] that it makes, against the largest of all.
    tolerance = 0.2 * np.abs(scaled_shift).max()
    for place, parameter in enumerate(model.parameters):
        is_right = abs(shift[place] * scale[place] - scaled_shift[place]) <= tolerance
        implied = scaled_shift[place] / scale[place]
        name = f"{type(model).__name__}.delay_shift"
        complaint = f"a late force shifts {parameter.name} by {implied:.4g} per second, not by {shift[place]:.4g}"
        demand(is_right, f"{name}: {complaint}")


def _check_memory(model: ContactModel, theta: Sequence[float]) -> None:
    """Check internal states: one rate each, at any depth; the force on a ramp grows, and faster on a faster ramp."""
    name, empty = type(model).__name__, [0.0] * len(model.memory)
    for depth in (-1e-3, 0.0, 1e-3):
        rates = np.array(model.memory_rate(depth, FAST, theta, empty))
        demand(len(rates) == len(empty), f"{name}.memory_rate gives {len(rates)} numbers for {len(empty)} states")
        # A root of a depth out of contact is complex.
        is_number = rates.dtype.kind in "if" and np.isfinite(rates).all()
        demand(is_number, f"{name}.memory_rate is not a finite number at depth {depth:.3g} m")
    forces = []
    for duration in (0.1, 0.05):
        time = np.linspace(0.0, duration, 200)
        ramp = 1e-3 * time / duration
        forces.append(force_over_time(model, time, ramp, np.full(200, 1e-3 / duration), theta))
        demand_rising(forces[-1], ramp, f"{name}: the force on a ramp")
    demand(forces[1][-1] >= forces[0][-1], f"{name}: the force is smaller on a faster ramp")


def _check_jacobian(model: ContactModel, theta: Sequence[float], depths: Floats) -> None:
    """Check that the derivatives of the force by depth, rate, memory and parameters are finite at depths (n,) [m]."""
    import casadi

    memory = len(model.memory)
    state = casadi.SX.sym("s", 2 + memory + len(theta))
    numbers = casadi.vertsplit(state)
    force = contact_force(model, numbers[0], numbers[1], numbers[2 + memory :], numbers[2 : 2 + memory])
    # The slope of a root has a pole at 0, which filters step around: finite is asked of what is beyond a micrometre.
    jacobian = casadi.Function("j", [state], [casadi.jacobian(force, state)])
    for depth in depths[(depths <= 0) | (depths >= 1e-6)]:
        slopes = np.array(jacobian([depth, 0.0, *([0.0] * memory), *theta])).ravel()
        finite = bool(np.all(np.isfinite(slopes)))
        demand(finite, f"{type(model).__name__}: the Jacobian is not finite at depth {depth:.3g} m")
