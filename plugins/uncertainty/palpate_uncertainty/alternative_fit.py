"""A model, or one changed in one respect, fitted again to the samples of a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_uncertainty.refit import Course

# Bounds that only a refit meets which runs away, and its cost: one that ends does not depend on them.
_MAX_SURFACE_SHIFT = 0.02  # [m] that the surface may move, a choice
_MAX_SAMPLES = 3000  # samples that a refit looks at, a choice of time
_MAX_EVALUATIONS = 40  # of a refit, a choice
_MIN_GAIN = 1e-12  # of the cost; of 3000 samples the step that is left out is 5e-5 standard deviations
_SURFACE_SCALE = 1e-4  # [m], the size of a step of the surface, a choice
_BOUND_MARGIN = 1e-9  # of an unknown, by which the start is inside its bounds, a choice
_MAX_FORCE = 1e6  # [N] of a residual, in place of one that is not finite, a choice

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
    """Fit a course's model, changed by `make`, by least squares from parameters (k,) and a surface [m] on.

    `course` has the samples in contact, with their model and smoothed motion. The unknowns x are the parameters, the
    shift of the surface and the alternative's extra numbers, each over its scale. The search sees at most 3000 of the
    fitted samples, evenly spread; the residual is of all of them. A model with memory runs over every sample of the
    course, and only its residual is thinned.
    """
    from palpate_kit.numerics.least_squares import least_squares, normal_by_differences

    # The samples that the search sees, and its unknowns over their scales.
    thinned = course if course.model.memory else course.reduced(_MAX_SAMPLES)
    alternative = make(thinned)
    rows = np.flatnonzero(thinned.used)
    rows = rows[:: max(1, -(-len(rows) // _MAX_SAMPLES))]  # the quotient is rounded up
    scale, start, lower, upper = _scaled_range(course, theta, alternative)

    def numbers(x: Floats) -> tuple[Floats, float, Floats]:
        """Return parameters, surface [m] and extra numbers of the unknowns."""
        unscaled = x * scale
        return unscaled[: len(theta)], surface + float(unscaled[len(theta)]), unscaled[len(theta) + 1 :]

    def residual(x: Floats) -> Floats:
        """Return the residual (n,) [N] of the scaled unknowns, within +-1e6 N and finite."""
        try:
            error = (thinned.force - alternative.force(*numbers(x)))[rows]
        except ValueError:  # a memory that is too short for the samples
            return np.full(len(rows), _MAX_FORCE)
        if float(np.abs(error).max(initial=0.0)) <= _MAX_FORCE:  # false for NaN
            return error
        return np.clip(np.where(np.isfinite(error), error, _MAX_FORCE), -_MAX_FORCE, _MAX_FORCE)

    normal = normal_by_differences(residual, upper)
    minimum = least_squares(normal, start, lower, upper, most=_MAX_EVALUATIONS, gain=_MIN_GAIN)
    # The estimate's residual over all fitted samples.
    fitted_theta, fitted_surface, extra = numbers(minimum.x)
    whole = alternative if thinned is course else make(course)
    return Refit(
        reason=alternative.reason,
        theta=fitted_theta,
        surface=fitted_surface,
        candidates=whole.candidates(fitted_theta, fitted_surface, extra),
        residual=(course.force - whole.force(fitted_theta, fitted_surface, extra))[course.used],
        extra=len(extra),
        numbers=tuple(extra.tolist()),
    )


def _scaled_range(
    course: Course, theta: Floats, alternative: ModelAlternative
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return scale, start, lower and upper bound (p,) of a refit's unknowns, the last three over the scale.

    `theta` (k,) are the values of the course's model from which the refit starts. The unknowns are the parameters, the
    shift of the surface, and the alternative's extra numbers. The scale of a parameter is its value at the start, or 1
    for a value of 0; that of an extra number is the range of its bounds.
    """
    sizes = np.where(theta != 0, np.abs(theta), 1.0)
    ranges = np.subtract(alternative.upper, alternative.lower)
    scale = np.concatenate([sizes, [_SURFACE_SCALE], ranges])
    lowest = [parameter.lowest_estimate for parameter in course.model.parameters]
    highest = [parameter.upper for parameter in course.model.parameters]
    lower = np.array([*lowest, -_MAX_SURFACE_SHIFT, *alternative.lower]) / scale
    upper = np.array([*highest, _MAX_SURFACE_SHIFT, *alternative.upper]) / scale
    start = np.array([*theta, 0.0, *alternative.start]) / scale
    margin = _BOUND_MARGIN * np.maximum(1.0, np.abs(start))
    return scale, np.clip(start, lower + margin, upper - margin), lower, upper
