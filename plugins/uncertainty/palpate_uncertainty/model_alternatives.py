"""Alternatives for a record: the respects in which its model may be wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from palpate import Floats

from palpate_uncertainty.alternative_fit import Maker, ModelAlternative, Refit, refit
from palpate_uncertainty.refit import Course
from palpate_uncertainty.relaxation_alternatives import fit_relaxation
from palpate_uncertainty.undeclared_thickness import BONDED_COEFFICIENTS

# Choices: the bounds of what an alternative adds, beyond any rig: only a search that runs away meets them.
_MAX_DELAY = 0.02  # [s] of the force
_MAX_MASS = 10.0  # [kg] behind the sensor
_MIN_RIG_STIFFNESS = 1e3  # [N/m] of arm and base
_MAX_LAYER_RATIO = 1.5  # X, contact radius over thickness, at the mean depth
_MIN_POWER, _MAX_ADDED_POWER = 0.3, 2.5  # of depth that the force of another tip grows with; added to the model's
_DEPTH_STEP = 1e-6  # [m], for slopes, a choice
_INITIAL_LAYER_RATIO = 0.2  # X from which the search starts, a choice
_MIN_DEPTH = 1e-9  # [m], so that a power of depth is finite out of contact, a choice
MEMORY = "memory"  # the reason that is not a change of the force at an instant: a material that relaxes


def alternatives(course: Course, base: Refit, frequency: float | None = None) -> dict[str, Callable[[], Refit]]:
    """Return, by reason, the refits of all that the residual may show to be wrong.

    Of a model with memory these are timing, drift and mass. `frequency` [Hz] is that of a
    motion that oscillates with one, else None.
    """
    refits: dict[str, Callable[[], Refit]] = {
        reason: partial(refit, course, base.theta, base.surface, make) for reason, make in makers(course, base).items()
    }
    if (relaxing := relaxing_parameter(course)) is not None:
        refits[MEMORY] = partial(_relaxation, course, base, relaxing, fastest_branch(course, frequency))
    return refits


def _relaxation(course: Course, base: Refit, relaxing: int, fastest: float) -> Refit:
    """Return the refit with a memory of the parameter of index `relaxing`, of no branch faster than `fastest` [s].

    The estimate may stand for the parameters at the end of the relaxation, or for those at its beginning.
    """
    fit = fit_relaxation(course, base.theta, base.surface, relaxing, fastest)
    return Refit(
        reason=MEMORY,
        theta=fit.relaxed,
        surface=fit.surface,
        candidates=np.array([fit.relaxed, fit.instantaneous]),
        residual=fit.residual,
        extra=fit.added_unknowns,
    )


def makers(course: Course, base: Refit) -> dict[str, Maker]:
    """Return, by reason, the respects in which the model of a course may be wrong, but for relaxation."""
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
    """Return the index of the parameter that may relax.

    None for a model with a memory of its own, and for one whose force is not linear in all parameters.
    """
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
        reason="timing",
        force=lambda theta, surface, x: course.forces(theta, surface) - x[0] * course.change(theta, surface),
        start=(0.0,),
        lower=(-_MAX_DELAY,),
        upper=(_MAX_DELAY,),
    )


def _drift(course: Course) -> ModelAlternative:
    """Return the model's force with a drift x[0] [N] over the record, in proportion to time.

    In a record that begins in contact the drift has begun before, at an unknown zero x[1] [N].
    """
    elapsed = (course.time - course.begin) / course.span
    largest = float(np.max(np.abs(course.force[course.used])))
    if course.from_air:
        return ModelAlternative(
            reason="drift",
            force=lambda theta, surface, x: course.forces(theta, surface) + x[0] * elapsed,
            start=(0.0,),
            lower=(-largest,),
            upper=(largest,),
        )
    return ModelAlternative(
        reason="drift",
        force=lambda theta, surface, x: course.forces(theta, surface) + x[0] * elapsed + x[1],
        start=(0.0, 0.0),
        lower=(-largest, -largest),
        upper=(largest, largest),
    )


def _compliance(course: Course, base: Refit) -> ModelAlternative:
    """Return an arm or a base that gives way to the force as the model has it, to first order."""
    force = course.forces(base.theta, base.surface)
    change = course.change(base.theta, base.surface)
    return ModelAlternative(
        reason="compliance",
        force=lambda theta, surface, x: course.yielded(theta, surface, float(x[0]) * force, float(x[0]) * change),
        start=(0.0,),
        lower=(0.0,),
        upper=(1.0 / _MIN_RIG_STIFFNESS,),
    )


def _mass(course: Course) -> ModelAlternative:
    """Return a force with another mass behind the sensor than was taken off."""
    return ModelAlternative(
        reason="mass",
        force=lambda theta, surface, x: course.forces(theta, surface) + x[0] * course.acceleration,
        start=(0.0,),
        lower=(-_MAX_MASS,),
        upper=(_MAX_MASS,),
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
    """Return the shape by means over the fitted samples; None where a fit has its surface below all of them."""
    depth = course.depth(base.surface)[course.used]
    elastic, slope = (part[course.used] for part in course.elastic(base.theta, base.surface))
    if not np.mean(elastic) > 0:
        return None
    power = float(np.mean(slope * depth) / np.mean(elastic))  # of F ~ d^p: p = d F'/F
    return _Shape(float(np.mean(depth)), float(np.mean(slope)), power)


def _thickness(course: Course, unit: Floats, shape: _Shape) -> ModelAlternative:
    """Return the elastic force times c(X), X growing as the contact radius, and the viscous force after its derivative.

    With c(X) = 1 + 1.133 X + 1.283 X^2 + 0.769 X^3 + 0.0975 X^4 (Dimitriadis et al. 2002, eq. 13) the elastic force
    F(d) becomes c F, and its slope F' becomes c F' + c' F: a viscous force, which is proportional to the slope, is
    multiplied by c + c' F/F'. X is the contact radius over the thickness. The contact radius is the slope of the
    elastic force of the parameters `unit` (k,) but for a constant, so the extra number is X at the mean depth, where
    that force has the slope of `shape`.
    """
    c1, c2, c3, c4 = BONDED_COEFFICIENTS

    def stiffening(surface: float, extra: Floats) -> Floats:
        """Return c(X) (n,) of the course's depths below a surface [m]."""
        x = float(extra[0]) * course.elastic(unit, surface)[1] / shape.slope
        return np.asarray(1.0 + x * (c1 + x * (c2 + x * (c3 + x * c4))))

    def force(theta: Floats, surface: float, extra: Floats) -> Floats:
        elastic, slope = course.elastic(theta, surface)
        viscous = course.forces(theta, surface) - elastic
        factor = stiffening(surface, extra)
        # A higher surface is a greater depth.
        factor_below = stiffening(surface + _DEPTH_STEP, extra)
        force_over_slope = np.divide(elastic, slope, out=np.zeros_like(elastic), where=slope > 0)
        growth = force_over_slope * (factor_below - factor) / _DEPTH_STEP
        return np.asarray(elastic * factor + viscous * (factor + growth))

    return ModelAlternative(
        reason="thickness", force=force, start=(_INITIAL_LAYER_RATIO,), lower=(0.0,), upper=(_MAX_LAYER_RATIO,)
    )


def _tip(course: Course, elastic: list[int], shape: _Shape) -> ModelAlternative:
    """Return an elastic force that is another power of depth, and the viscous force after its slope.

    With the model's F ~ d^p the elastic force becomes (d/d_mean)^q F, q the extra number, whose slope is
    (d/d_mean)^q (1 + q/p) F'; a viscous force is proportional to the slope. Which tip that is, is not known: the
    elastic parameters, at the indexes `elastic`, may be what the force, or what its slope, at the mean depth would need
    in the model. `shape` has the mean depth and the model's power p there.
    """

    def force(theta: Floats, surface: float, extra: Floats) -> Floats:
        change = (np.maximum(course.depth(surface), _MIN_DEPTH) / shape.depth) ** float(extra[0])
        elastic_force, _ = course.elastic(theta, surface)
        viscous = course.forces(theta, surface) - elastic_force
        return np.asarray(change * (elastic_force + viscous * (1.0 + float(extra[0]) / shape.power)))

    def candidates(theta: Floats, _surface: float, extra: Floats) -> Floats:
        by_slope = theta.copy()
        by_slope[elastic] *= 1.0 + float(extra[0]) / shape.power
        return np.array([theta, by_slope])

    return ModelAlternative(
        reason="another tip",
        force=force,
        start=(0.0,),
        lower=(_MIN_POWER - shape.power,),
        upper=(_MAX_ADDED_POWER,),
        candidates=candidates,
    )
