"""The alternative that a material relaxes: Maxwell branches in parallel with the elastic force."""

from __future__ import annotations

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


def fit_relaxation(
    course: Course, theta: Floats, surface: float, place: int, fastest: float = 0.0
) -> tuple[Floats, float, Floats, Floats, int]:
    """Fit F = E A(d) + eta B(d, d') + sum of E g_i R_i[A] by least squares, R_i the part that relaxes, g_i >= 0.

    No R_i relaxes in less than `fastest` [s]: in an oscillation of angular frequency w, a branch that relaxes within
    1/w is a dashpot by another name, and would only take the viscosity's share.

    For models whose force is linear in their parameters, of which one, at `place`, is elastic. By variable projection
    over the surface (Golub and Pereyra 1973) and non-negative least squares (Lawson and Hanson 1974). Return the
    relaxed parameters (k,), the surface [m], the instantaneous parameters (k,), with all branches, the residual (n,)
    [N] over the fitted samples, and the number of unknowns that the branches add.
    """
    from scipy.optimize import minimize_scalar, nnls

    rows, times = np.flatnonzero(course.used), relaxation_times(course, fastest)
    thinned = rows[:: max(1, -(-len(rows) // _MAX_SAMPLES))]

    def cost(height: float) -> float:
        columns = relaxation_columns(course, theta, height, place, times)[thinned]
        return float(nnls(_scaled(columns)[0], course.force[thinned])[1])

    shift = min(_MAX_SURFACE_SHIFT, _DEPTH_SHARE * float(np.min(course.depth(surface)[rows]))) if rows.size else 0.0
    minimum: Any = minimize_scalar(
        cost,
        bounds=(surface - max(shift, _MIN_SURFACE_SHIFT), surface + _MAX_SURFACE_SHIFT),
        method="bounded",
        options={"xatol": _SURFACE_TOLERANCE},
    )
    columns = relaxation_columns(course, theta, float(minimum.x), place, times)
    scaled, lengths = _scaled(columns[thinned])
    weights = nnls(scaled, course.force[thinned])[0] / lengths

    # The relaxed parameters, and those at the first moment, before any branch relaxes.
    k = len(theta)
    relaxed = theta * weights[:k]
    instantaneous = relaxed.copy()
    instantaneous[place] += theta[place] * float(weights[k : k + len(times)].sum())
    residual = (course.force - columns @ weights)[course.used]
    return relaxed, float(minimum.x), instantaneous, residual, len(times) * (1 if course.from_air else 2)


def relaxation_times(course: Course, fastest: float) -> list[float]:
    """Return the time constants [s] of the branches that a course can show, none below `fastest`."""
    fastest = max(fastest, _MIN_INTERVALS * float(np.median(np.diff(course.time))))
    return [time for time in _RELAXATION_TIMES if fastest < time < course.span]


def relaxation_columns(course: Course, theta: Floats, surface: float, place: int, times: list[float]) -> Floats:
    """Return the forces (n, m) [N] of each parameter, of each branch, and of those that began before the record."""
    columns = []
    for i in range(len(theta)):
        alone = np.zeros_like(theta)
        alone[i] = theta[i]
        columns.append(course.forces(alone, surface))
    step = float(np.median(np.diff(course.time)))
    columns += [relaxing_share(columns[place], step / time) for time in times]
    if not course.from_air:
        first = course.runs == course.runs[0]
        for time in times:
            past_force = np.where(first, np.exp(-(course.time - course.begin) / time), 0.0)
            columns += [past_force, -past_force]  # of either sign, for weights that are not negative
    return np.column_stack(columns)


def _scaled(columns: Floats) -> tuple[Floats, Floats]:
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
