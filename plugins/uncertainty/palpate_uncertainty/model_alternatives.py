"""Alternatives for a record: the model, changed in one respect, fitted again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from palpate import Floats

from palpate_uncertainty.refit import Course
from palpate_uncertainty.relaxation_alternatives import fit_relaxation

_LAYER_COEFFICIENTS = (1.133, 1.283, 0.769, 0.0975)  # Dimitriadis et al. 2002, eq. 13
_DEPTH_STEP = 1e-6  # [m], for slopes
_MAX_DELAY = 0.02  # [s] of an alternative
_MAX_SAMPLES = 3000  # samples that a refit looks at
_MAX_SURFACE_SHIFT = 0.02  # [m] that the surface may move
_MAX_MASS = 10.0  # [kg] behind the sensor
_MIN_RIG_STIFFNESS = 1e3  # [N/m] of arm and base
_MAX_FORCE = 1e6  # [N] of a residual, in place of one that is not finite
MEMORY = "memory"  # the reason that is not a change of the force at an instant: a material that relaxes

# From the model's parameters (k,), the surface [m] and the extra numbers:
Force = Callable[[Floats, float, Floats], Floats]  # the force (n,) [N]
Candidates = Callable[[Floats, float, Floats], Floats]  # parameters (c, k) that the estimate may stand for


@dataclass(frozen=True)
class ModelAlternative:
    """One respect in which a model may be wrong, with the bounds of the numbers that it adds."""

    reason: str
    force: Force
    start: tuple[float, ...] = ()
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()
    candidates: Candidates = lambda theta, surface, extra: theta[None]


@dataclass(frozen=True)
class Refit:
    """A model fitted to a course by least squares."""

    reason: str  # empty for the model as it is
    theta: Floats  # (k,) the model's parameters
    surface: float  # [m]
    candidates: Floats  # (c, k) what the parameters may be if this is the truth
    residual: Floats  # (n,) [N] over the course's fitted samples
    extra: int = 0  # numbers that it adds to the model
    numbers: tuple[float, ...] = ()  # those, where one asks for them


Maker = Callable[[Course], ModelAlternative]


def no_change(course: Course) -> ModelAlternative:
    """Return the model as it is."""
    return ModelAlternative("", lambda theta, surface, extra: course.forces(theta, surface))


def refit(course: Course, theta: Floats, surface: float, make: Maker = no_change) -> Refit:
    """Return a model fitted from a start, parameters within its bounds."""
    from palpate_kit.numerics.least_squares import least_squares, normal_by_differences

    small = course if course.model.memory else course.reduced(_MAX_SAMPLES)
    made, k = make(small), len(theta)
    rows = np.flatnonzero(small.used)
    rows = rows[:: max(1, -(-len(rows) // _MAX_SAMPLES))]
    sizes = np.where(theta != 0, np.abs(theta), 1.0)
    scale = np.concatenate([sizes, [1e-4], np.subtract(made.upper, made.lower)])
    lower = np.array([*(p.lowest_estimate for p in course.model.parameters), -_MAX_SURFACE_SHIFT, *made.lower]) / scale
    upper = np.array([*(p.upper for p in course.model.parameters), _MAX_SURFACE_SHIFT, *made.upper]) / scale
    start = np.array([*theta, 0.0, *made.start]) / scale
    margin = 1e-9 * np.maximum(1.0, np.abs(start))
    start = np.clip(start, lower + margin, upper - margin)

    def parts(x: Floats) -> tuple[Floats, float, Floats]:
        numbers = x * scale
        return numbers[:k], surface + float(numbers[k]), numbers[k + 1 :]

    def residual(x: Floats) -> Floats:
        try:
            error = (small.force - made.force(*parts(x)))[rows]
        except ValueError:  # a memory that is too short for the samples
            return np.full(len(rows), _MAX_FORCE)
        if float(np.abs(error).max(initial=0.0)) <= _MAX_FORCE:  # of NaN it is not
            return error
        return np.clip(np.where(np.isfinite(error), error, _MAX_FORCE), -_MAX_FORCE, _MAX_FORCE)

    found = least_squares(normal_by_differences(residual, upper), start, lower, upper, most=40, gain=1e-12)
    numbers, full = parts(found.x), made if small is course else make(course)
    error = (course.force - full.force(*numbers))[course.used]
    return Refit(
        made.reason,
        numbers[0],
        numbers[1],
        full.candidates(*numbers),
        error,
        len(made.start),
        tuple(numbers[2].tolist()),
    )


def alternatives(course: Course, base: Refit, frequency: float | None = None) -> dict[str, Callable[[], Refit]]:
    """By reason, the refit of all that the residual may show to be wrong; of a model with memory only timing, drift and
    mass.

    `frequency` [Hz] is that of a motion that oscillates with one.
    """
    refits: dict[str, Callable[[], Refit]] = {
        reason: partial(refit, course, base.theta, base.surface, make) for reason, make in makers(course, base).items()
    }
    if (relaxing := relaxing_parameter(course)) is not None:
        refits[MEMORY] = partial(_relaxation, course, base, relaxing, fastest_branch(course, frequency))
    return refits


def _relaxation(course: Course, base: Refit, relaxing: int, fastest: float) -> Refit:
    stays, surface, at_first, residual, branches = fit_relaxation(course, base.theta, base.surface, relaxing, fastest)
    return Refit(MEMORY, stays, surface, np.array([stays, at_first]), residual, branches)


def makers(course: Course, base: Refit) -> dict[str, Maker]:
    """By reason, the respects in which the model of a course may be wrong, but for relaxation."""
    elastic = [i for i, parameter in enumerate(course.model.parameters) if parameter.role == "elastic"]
    always: dict[str, Maker] = {"timing": _timing, "drift": _drift, "mass": _mass}
    shape = _shape(course, base) if elastic and not course.model.memory else None
    if shape is None:
        return always
    return always | {
        "thickness": lambda c: _thickness(c, base.theta, shape),
        "another tip": lambda c: _tip(c, elastic, shape),
        "compliance": lambda c: _compliance(c, base),
        "lift-off": _lift_off,
    }


def relaxing_parameter(course: Course) -> int | None:
    """Index of the parameter that may relax; None of a model with a memory of its own, or a force not linear in all."""
    parameters = course.model.parameters
    elastic = [i for i, parameter in enumerate(parameters) if parameter.role == "elastic"]
    linear = len(elastic) == 1 and not course.model.memory and all(parameter.role for parameter in parameters)
    return elastic[0] if linear else None


def fastest_branch(course: Course, frequency: float | None) -> float:
    """Return the time [s] in which what relaxes is distinguished from the model's viscosity; 0 for any time."""
    viscous = any(parameter.role == "viscous" for parameter in course.model.parameters)
    return 1.0 / (2.0 * np.pi * frequency) if frequency is not None and viscous else 0.0


def _timing(course: Course) -> ModelAlternative:
    """Return a force that is recorded late, to first order."""
    return ModelAlternative(
        "timing",
        lambda theta, surface, x: course.forces(theta, surface) - x[0] * course.change(theta, surface),
        (0.0,),
        (-_MAX_DELAY,),
        (_MAX_DELAY,),
    )


def _drift(course: Course) -> ModelAlternative:
    """Return a force that drifts from the first contact on; where there was no air before it, from anywhere."""
    since, most = (course.time - course.begin) / course.span, float(np.max(np.abs(course.force[course.used])))
    if course.from_air:
        return ModelAlternative("drift", lambda t, s, x: course.forces(t, s) + x[0] * since, (0.0,), (-most,), (most,))
    ends = (most, most)
    return ModelAlternative(
        "drift", lambda t, s, x: course.forces(t, s) + x[0] * since + x[1], (0.0, 0.0), (-most, -most), ends
    )


def _compliance(course: Course, base: Refit) -> ModelAlternative:
    """Return an arm or a base that gives way to the force as the model has it, to first order."""
    force = course.forces(base.theta, base.surface)
    change = course.change(base.theta, base.surface)
    return ModelAlternative(
        "compliance",
        lambda theta, surface, x: course.yielded(theta, surface, float(x[0]) * force, float(x[0]) * change),
        (0.0,),
        (0.0,),
        (1.0 / _MIN_RIG_STIFFNESS,),
    )


def _mass(course: Course) -> ModelAlternative:
    """Another mass behind the sensor than was taken off."""
    return ModelAlternative(
        "mass",
        lambda theta, surface, x: course.forces(theta, surface) + x[0] * course.acceleration,
        (0.0,),
        (-_MAX_MASS,),
        (_MAX_MASS,),
    )


def _lift_off(course: Course) -> ModelAlternative:
    """Return a surface that does not pull: the tip leaves it faster than it comes back."""
    return ModelAlternative("lift-off", lambda theta, surface, x: np.maximum(course.forces(theta, surface), 0.0))


@dataclass(frozen=True)
class _Shape:
    """The elastic force of a model at the mean depth of a record."""

    depth: float  # [m]
    slope: float  # [N/m]
    power: float  # of depth, that it grows with


def _shape(course: Course, base: Refit) -> _Shape | None:
    """None where a fit has lost the contact: its surface is below all of the record."""
    depth, (low, slope) = course.depth(base.surface)[course.used], course.elastic(base.theta, base.surface)
    low, slope = low[course.used], slope[course.used]
    if not np.mean(low) > 0:
        return None
    return _Shape(float(np.mean(depth)), float(np.mean(slope)), float(np.mean(slope * depth) / np.mean(low)))


def _thickness(course: Course, unit: Floats, shape: _Shape) -> ModelAlternative:
    """Return the elastic force times c(X), X growing as the contact radius, and the viscous force after its derivative.

    The contact radius is the slope of the elastic force in depth, but for a constant, which the extra number takes.
    """

    def layer(surface: float, extra: Floats) -> Floats:
        x = float(extra[0]) * course.elastic(unit, surface)[1] / shape.slope
        return np.asarray(
            1.0
            + x
            * (
                _LAYER_COEFFICIENTS[0]
                + x * (_LAYER_COEFFICIENTS[1] + x * (_LAYER_COEFFICIENTS[2] + x * _LAYER_COEFFICIENTS[3]))
            )
        )

    def force(theta: Floats, surface: float, extra: Floats) -> Floats:
        low, slope = course.elastic(theta, surface)
        factor, deeper = layer(surface, extra), layer(surface + _DEPTH_STEP, extra)
        growth = np.divide(low, slope, out=np.zeros_like(low), where=slope > 0) * (deeper - factor) / _DEPTH_STEP
        viscous = course.forces(theta, surface) - low
        return np.asarray(low * factor + viscous * (factor + growth))

    return ModelAlternative("thickness", force, (0.2,), (0.0,), (1.5,))


def _tip(course: Course, elastic: list[int], shape: _Shape) -> ModelAlternative:
    """Return an elastic force that is another power of depth, and the viscous force after its slope.

    Which tip that is, is not known: the elastic parameters may be what the force, or what its slope, at the mean depth
    would need in the model.
    """

    def force(theta: Floats, surface: float, extra: Floats) -> Floats:
        change = (np.maximum(course.depth(surface), 1e-9) / shape.depth) ** float(extra[0])
        low, _ = course.elastic(theta, surface)
        viscous = course.forces(theta, surface) - low
        return np.asarray(change * (low + viscous * (1.0 + float(extra[0]) / shape.power)))

    def candidates(theta: Floats, surface: float, extra: Floats) -> Floats:
        by_slope = theta.copy()
        by_slope[elastic] *= 1.0 + float(extra[0]) / shape.power
        return np.array([theta, by_slope])

    return ModelAlternative("another tip", force, (0.0,), (0.3 - shape.power,), (2.5,), candidates)
