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
USUAL_VALUES = {"Pa": 1e5, "Pa*s": 300.0, "s": 0.1}  # of soft silicone, by unit
FAST = 0.01  # [m/s], the rate of a palpation
TOUCH, SHALLOW = 1e-9, 1e-4  # [m] depths of a touch, and of the stiffness that it is compared with (choices)
OUTSIDE = -1e-3  # [m], a depth out of contact
TOUCH_FORCE = 1e-3  # of the force at the largest depth, up to which there is a touch and not a jump (a choice)
STEEP_AT_TOUCH = 10.0  # times the stiffness at a depth of 0.1 mm: F ~ d^0.75 and blunter laws
ROLE_ERROR = 1e-4  # of the share, from its proportionality; laws with a root as a series are off by some 5e-6
EFFECT = 1e-9  # of the force, below which a parameter has none
PARAMETER_STEP = 0.01  # of a parameter whose effect is looked for (a choice)
RAMP_DEPTH, RAMP_TIME = 2e-3, 1.0  # [m], [s] of the ramp and of the hold after it, on which effects are looked for
LATE = 1e-4  # [s] of the delay whose effect is compared with delay_shift
SHIFT_ERROR = 0.2  # of the largest shift (a choice): delay_shift is a first order
# Relative steps of one-sided and of central differences (choices near the roots of a double's resolution).
FORWARD_STEP, CENTRAL_STEP = 1e-6, 1e-5
GRADIENT_ERROR = 1e-3  # of a gradient (a choice)
MIN_GRADIENT = 1e-6  # of value over parameter, below which a gradient counts as 0 (a choice)
SINGULAR_DEPTH = 1e-6  # [m]: the slope of a root has a pole at 0, which filters step around


def usual_values(model: ContactModel) -> list[float]:
    """Return a value for each parameter within its bounds: its first guess, their middle, or the order of silicone."""
    theta = []
    for parameter in model.parameters:
        guess = parameter.start
        if guess is None:
            is_bounded = math.isfinite(parameter.lower) and math.isfinite(parameter.upper)
            middle = 0.5 * (parameter.lower + parameter.upper)
            guess = middle if is_bounded else USUAL_VALUES.get(parameter.unit, 1.0)
        theta.append(min(max(guess, parameter.lower), parameter.upper))
    return theta


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
    outside = min(OUTSIDE, 2.0 * float(model.pull_off_depth(list(theta))))
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
    _check_jacobian(model, theta, np.concatenate([[OUTSIDE, 0.0], depths]))


def check_parameters(model: ContactModel, theta: Sequence[float]) -> None:
    """Check names, units, bounds and first guesses of a model's parameters; raises AssertionError."""
    name = type(model).__name__
    demand(len(theta) == len(model.parameters), f"{name} has {len(model.parameters)} parameters, {len(theta)} given")
    names = [parameter.name for parameter in model.parameters]
    demand(len(set(names)) == len(names), f"{name} has two parameters of one name")
    for parameter, number in zip(model.parameters, theta, strict=True):
        demand(parameter.lower <= number <= parameter.upper, f"{name}: {parameter.name} is out of its own bounds")
        start = parameter.start
        is_within = start is None or parameter.lower <= start <= parameter.upper
        demand(is_within, f"{name}: the start of {parameter.name} is out of its own bounds")
        has_unit = parameter.unit == "1" or is_unit(BROKEN_POWER.sub("^2", parameter.unit))
        demand(has_unit, f"{name}: the unit {parameter.unit!r} of {parameter.name} is not known")


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
    touch, shallow, deep = (float(contact_force(model, d, 0.0, theta, empty)) for d in (TOUCH, SHALLOW, deepest))
    demand(touch <= TOUCH_FORCE * deep, f"{name}.force jumps to {touch:.3g} N at touch")
    stiffness = shallow / SHALLOW
    demand(touch / TOUCH <= STEEP_AT_TOUCH * stiffness, f"{name}.force is infinitely stiff at touch")


def _check_effects(model: ContactModel, theta: Sequence[float], depths: Floats) -> None:
    """Check that each parameter has an effect on a ramp and a hold, and the one that its role states."""
    name = type(model).__name__
    time = np.linspace(0.0, 2.0 * RAMP_TIME, 400)
    speed = RAMP_DEPTH / RAMP_TIME
    depth, rate = np.minimum(speed * time, RAMP_DEPTH), np.where(time < RAMP_TIME, speed, 0.0)
    force = force_over_time(model, time, depth, rate, theta)
    smallest_effect = EFFECT * np.abs(force).max()
    for index, parameter in enumerate(model.parameters):
        changed = list(theta)
        changed[index] = theta[index] * (1.0 + PARAMETER_STEP) if theta[index] else 1e-3
        effect = np.abs(force_over_time(model, time, depth, rate, changed) - force).max()
        demand(effect > smallest_effect, f"{name}: {parameter.name} has no effect on the force")
        if parameter.role is not None and theta[index] and not model.adhesive:
            _check_role(model, theta, index, depths, smallest_effect)


def _check_role(
    model: ContactModel, theta: Sequence[float], index: int, depths: Floats, smallest_effect: float
) -> None:
    """Check that the share of the force that a parameter's role states is linear in the parameter.

    The share is the force at rest of an elastic parameter, or the force that a rate adds of a viscous one. From one
    to two times the parameter it grows twice as much as from a half.
    """
    parameter = model.parameters[index]
    empty = [0.0] * len(model.memory)

    def share(factor: float) -> Floats:
        """Return the share (n,) [N] with a factor on the parameter."""
        values = list(theta)
        values[index] = factor * theta[index]
        at_rest = np.asarray(contact_force(model, depths, 0.0, values, empty), float)
        return at_rest if parameter.role == "elastic" else contact_force(model, depths, FAST, values, empty) - at_rest

    growth, expected_growth = share(2.0) - share(1.0), 2.0 * (share(1.0) - share(0.5))
    name = type(model).__name__
    complaint = f"{name}: the force is not proportional to {parameter.name}, whose role is {parameter.role!r}"
    demand(np.abs(expected_growth).max() > smallest_effect, complaint)
    demand_close(growth, expected_growth, ROLE_ERROR, complaint)


def _check_material(model: ContactModel, theta: Sequence[float]) -> None:
    """Compare the gradients of `material` with central differences."""
    name = type(model).__name__
    for number, prop in enumerate(model.material(list(theta))):
        subject = f"{name}.material: the gradient of {prop.name}"
        demand(np.isfinite(prop.value), f"{name}.material: {prop.name} is {prop.value}")
        demand(
            len(prop.gradient) == len(theta), f"{subject} has {len(prop.gradient)} numbers for {len(theta)} parameters"
        )
        for index, parameter in enumerate(model.parameters):
            size = abs(theta[index]) or 1.0
            step = CENTRAL_STEP * size
            above, below = list(theta), list(theta)
            above[index], below[index] = theta[index] + step, theta[index] - step
            slope = (model.material(above)[number].value - model.material(below)[number].value) / (2.0 * step)
            scale = max(abs(slope), abs(prop.value) / size * MIN_GRADIENT)
            gradient = prop.gradient[index]
            is_right = abs(gradient - slope) <= GRADIENT_ERROR * scale
            demand(is_right, f"{subject} by {parameter.name} is {gradient:.4g}, by differences {slope:.4g}")


def _check_delay_shift(model: ContactModel, theta: Sequence[float], shift: Sequence[float]) -> None:
    """Compare `delay_shift` with the shift that least squares has of a slow motion whose force is recorded late.

    With the Jacobian J of the force by the parameters, J shift = dF/d(delay), in columns that are scaled to 1.
    """
    force = _recorded_force(model, theta)
    columns = []
    for i, number in enumerate(theta):
        step = FORWARD_STEP * (abs(number) or 1.0)
        columns.append((_recorded_force(model, [*theta[:i], number + step, *theta[i + 1 :]]) - force) / step)
    jacobian = np.column_stack(columns)
    scale = np.abs(jacobian).max(axis=0)
    slope = (_recorded_force(model, theta, LATE) - force) / LATE
    scaled_shift, *_ = np.linalg.lstsq(jacobian / scale, slope, rcond=None)
    # Each shift counts by the force [N/s] that it makes, against the largest of all.
    tolerance = SHIFT_ERROR * np.abs(scaled_shift).max()
    for index, parameter in enumerate(model.parameters):
        is_right = abs(shift[index] * scale[index] - scaled_shift[index]) <= tolerance
        implied = scaled_shift[index] / scale[index]
        name = f"{type(model).__name__}.delay_shift"
        complaint = f"a late force shifts {parameter.name} by {implied:.4g} per second, not by {shift[index]:.4g}"
        demand(is_right, f"{name}: {complaint}")


def _recorded_force(model: ContactModel, theta: Sequence[float], delay: float = 0.0) -> Floats:
    """Return the force (800,) [N], late by a delay [s], of a sine of 1 mm and 0.5 Hz around a depth of 3 mm."""
    time = np.linspace(0.0, 4.0, 800)
    omega = 2.0 * np.pi * 0.5
    phase = omega * (time - delay)
    return force_over_time(model, time, 3e-3 + 1e-3 * np.sin(phase), 1e-3 * omega * np.cos(phase), theta)


def _check_memory(model: ContactModel, theta: Sequence[float]) -> None:
    """Check internal states: one rate each, at any depth; the force on a ramp grows, and faster on a faster ramp."""
    name, empty = type(model).__name__, [0.0] * len(model.memory)
    for depth in (OUTSIDE, 0.0, 1e-3):
        rates = np.array(model.memory_rate(depth, FAST, theta, empty))
        demand(len(rates) == len(empty), f"{name}.memory_rate gives {len(rates)} numbers for {len(empty)} states")
        # A root of a depth out of contact is complex.
        is_number = rates.dtype.kind in "if" and np.isfinite(rates).all()
        demand(is_number, f"{name}.memory_rate is not a finite number at depth {depth:.3g} m")
    # Two ramps to 1 mm, in 100 and in 50 ms.
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
    jacobian = casadi.Function("j", [state], [casadi.jacobian(force, state)])
    for depth in depths[(depths <= 0) | (depths >= SINGULAR_DEPTH)]:
        slopes = np.array(jacobian([depth, 0.0, *([0.0] * memory), *theta])).ravel()
        is_finite = bool(np.all(np.isfinite(slopes)))
        demand(is_finite, f"{type(model).__name__}: the Jacobian is not finite at depth {depth:.3g} m")
