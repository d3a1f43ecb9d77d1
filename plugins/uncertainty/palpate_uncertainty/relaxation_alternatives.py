"""The alternative that a material relaxes: Maxwell branches in parallel with the elastic force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats

from palpate_uncertainty.refit import Course

# Choices. But for the times they are bounds and resolution of a search, whose result does not depend on them.
_RELAXATION_TIMES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # [s] of the branches
_MAX_SAMPLES = 3000  # samples that are fitted
_MAX_SURFACE_SHIFT = 3e-3  # [m] that the surface may move
_MIN_SURFACE_SHIFT = 1e-4  # [m] that it may move down at least
_DEPTH_SHARE = 0.8  # of the least depth, by which it may move down: the tip stays in contact
_SURFACE_TOLERANCE = 1e-7  # [m] to which the surface is searched
_MIN_INTERVALS = 3  # of the samples, in the time of the fastest branch
_MIN_MEMORY = 1e-18  # of a change, below which it is forgotten: less than a double resolves
_SMALLEST_LENGTH = 1e-300  # of a column in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class RelaxationFit:
    """The fit of a model whose elastic force relaxes in Maxwell branches."""

    relaxed: Floats  # (k,) parameters after the relaxation, when every branch has relaxed
    surface: float  # [m]
    instantaneous: Floats  # (k,) parameters before the relaxation, with all branches
    residual: Floats  # (n,) [N] of the fitted samples
    added_unknowns: int  # of the branches


def fit_relaxation(
    course: Course, theta: Floats, surface: float, elastic_index: int, fastest: float = 0.0
) -> RelaxationFit:
    """Fit F = E A(d) + eta B(d, d') + sum of E g_i R_i[A] by least squares, R_i the part that relaxes, g_i >= 0.

    `course` has the samples of the contact; `theta` (k,) and `surface` [m] are the estimate without relaxation, from
    which the search starts. The model is linear in its parameters, and E, at `elastic_index`, is the one that relaxes.
    No R_i relaxes in less than `fastest` [s]: in an oscillation of angular frequency w, a branch that relaxes within
    1/w is a dashpot by another name, and would only take the viscosity's share.

    By variable projection: the surface is the one unknown of the search (Golub and Pereyra 1973), and each trial takes
    the weights of the columns, all >= 0, by non-negative least squares (Lawson and Hanson 1974).
    """
    from scipy.optimize import minimize_scalar, nnls

    times = relaxation_times(course, fastest)
    fitted_rows = np.flatnonzero(course.used)
    thinned_rows = fitted_rows[:: max(1, math.ceil(len(fitted_rows) / _MAX_SAMPLES))]

    def residual_norm(trial_surface: float) -> float:
        """Return the norm [N] of the residual of the best weights for a surface [m]."""
        columns = relaxation_columns(course, theta, trial_surface, elastic_index, times)[thinned_rows]
        return float(nnls(_unit_columns(columns)[0], course.force[thinned_rows])[1])

    # The surface of the smallest residual, then the weights of the columns there.
    minimum: Any = minimize_scalar(
        residual_norm,
        bounds=_surface_bounds(course, surface),
        method="bounded",
        options={"xatol": _SURFACE_TOLERANCE},
    )
    columns = relaxation_columns(course, theta, float(minimum.x), elastic_index, times)
    scaled_columns, lengths = _unit_columns(columns[thinned_rows])
    weights = nnls(scaled_columns, course.force[thinned_rows])[0] / lengths

    # A weight of 1 is the parameter as in theta; before the relaxation the branches add their weights to that of E.
    k = len(theta)
    relaxed = theta * weights[:k]
    instantaneous = relaxed.copy()
    instantaneous[elastic_index] += theta[elastic_index] * float(weights[k : k + len(times)].sum())
    # Each branch has its weight g_i; in a record that begins in contact also the force that it had at the beginning.
    unknowns_of_branch = 1 if course.from_air else 2
    return RelaxationFit(
        relaxed=relaxed,
        surface=float(minimum.x),
        instantaneous=instantaneous,
        residual=(course.force - columns @ weights)[course.used],
        added_unknowns=len(times) * unknowns_of_branch,
    )


def _surface_bounds(course: Course, surface: float) -> tuple[float, float]:
    """Return the lowest and highest surface [m] of the search, about the estimated one.

    A lower surface makes every depth smaller: it stays so high that the shallowest fitted sample remains in contact. A
    higher one keeps all in contact, so that only `_MAX_SURFACE_SHIFT` limits it.
    """
    max_fall = 0.0
    if course.used.any():
        least_depth = float(np.min(course.depth(surface)[course.used]))
        max_fall = min(_MAX_SURFACE_SHIFT, _DEPTH_SHARE * least_depth)
    return surface - max(max_fall, _MIN_SURFACE_SHIFT), surface + _MAX_SURFACE_SHIFT


def relaxation_times(course: Course, fastest: float) -> list[float]:
    """Return the time constants [s] of the branches that a course can show, none below `fastest`."""
    fastest = max(fastest, _MIN_INTERVALS * float(np.median(np.diff(course.time))))
    return [time for time in _RELAXATION_TIMES if fastest < time < course.span]


def relaxation_columns(course: Course, theta: Floats, surface: float, elastic_index: int, times: list[float]) -> Floats:
    """Return the forces (n, m) [N] of which a model with branches of time constants `times` [s] is a weighted sum.

    One column for each parameter of theta (k,) alone, then one for each branch: the part of the force at
    `elastic_index` that still relaxes. In a record that begins in contact two more for each branch, the fading 1 N
    that it had at the beginning, of either sign.
    """
    columns = []
    for i in range(len(theta)):
        single_parameter = np.zeros_like(theta)
        single_parameter[i] = theta[i]
        columns.append(course.forces(single_parameter, surface))
    step = float(np.median(np.diff(course.time)))
    columns += [relaxing_share(columns[elastic_index], step / time) for time in times]
    if not course.from_air:
        first_stretch = course.runs == course.runs[0]
        for time in times:
            past_force = np.where(first_stretch, np.exp(-(course.time - course.begin) / time), 0.0)
            columns += [past_force, -past_force]  # weights are not negative
    return np.column_stack(columns)


def _unit_columns(columns: Floats) -> tuple[Floats, Floats]:
    """Return columns (n, m) of length 1, and the lengths (m,)."""
    lengths = np.maximum(np.linalg.norm(columns, axis=0), _SMALLEST_LENGTH)
    return columns / lengths, lengths


def relaxing_share(force: Floats, ratio: float) -> Floats:
    """Return the remaining share (n,) of a force that dies away, by the ratio of step to time constant.

    Exact for a steady change within each step. Each turn doubles the past that the sum remembers (Hillis and Steele
    1986).
    """
    keep, reach = float(np.exp(-ratio)), 1
    share = (1.0 - keep) / ratio * np.diff(force, prepend=force[0])
    while reach < len(share) and keep > _MIN_MEMORY:
        share[reach:] = share[reach:] + keep * share[:-reach]
        keep, reach = keep * keep, 2 * reach
    return share
