"""The alternative that a material relaxes: Maxwell branches in parallel with the elastic force."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats

from palpate_uncertainty.refit import Course

_RELAXATION_TIMES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # [s] of the branches
_MAX_SAMPLES = 3000  # samples that are fitted
_MAX_SURFACE_SHIFT = 3e-3  # [m] that the surface may move
_SURFACE_TOLERANCE = 1e-7  # [m] to which the surface is searched
_MIN_MEMORY = 1e-18  # of a change


def fit_relaxation(
    course: Course, theta: Floats, surface: float, place: int, fastest: float = 0.0
) -> tuple[Floats, float, Floats, Floats, int]:
    """Least squares of F = E A(d) + eta B(d, d') + sum of E g_i R_i[A], R_i what relaxes in a time, g_i >= 0.

    No R_i relaxes in less than `fastest` [s]: in an oscillation of angular frequency w, what relaxes within 1/w is
    a dashpot by another name, and would only take the viscosity's share.

    For models whose force is linear in their parameters, of which one, at `place`, is elastic. By variable projection
    over the surface (Golub and Pereyra 1973) and non-negative least squares (Lawson and Hanson 1974). Returns the
    parameters (k,), of which the elastic one is that of the force that stays, the surface [m], the parameters with all
    branches, as at the first moment, the residual (n,) [N] over the fitted samples, and how many numbers that adds.
    """
    from scipy.optimize import minimize_scalar, nnls

    rows, times = np.flatnonzero(course.used), relaxation_times(course, fastest)
    few = rows[:: max(1, -(-len(rows) // _MAX_SAMPLES))]

    def cost(height: float) -> float:
        columns = relaxation_columns(course, theta, height, place, times)[few]
        return float(nnls(_scaled(columns)[0], course.force[few])[1])

    span = min(_MAX_SURFACE_SHIFT, 0.8 * float(np.min(course.depth(surface)[rows]))) if rows.size else 0.0
    span = max(span, 1e-4)
    found: Any = minimize_scalar(
        cost,
        bounds=(surface - span, surface + _MAX_SURFACE_SHIFT),
        method="bounded",
        options={"xatol": _SURFACE_TOLERANCE},
    )
    columns = relaxation_columns(course, theta, float(found.x), place, times)
    scaled, sizes = _scaled(columns[few])
    weights = nnls(scaled, course.force[few])[0] / sizes
    k = len(theta)
    stays = theta * weights[:k]
    branches = weights[k : k + len(times)]
    at_first = stays.copy()
    at_first[place] += theta[place] * float(branches.sum())
    left = (course.force - columns @ weights)[course.used]
    return stays, float(found.x), at_first, left, len(times) * (1 if course.from_air else 2)


def relaxation_times(course: Course, fastest: float) -> list[float]:
    """Time constants [s] of the branches that a course can show."""
    fastest = max(fastest, 3 * float(np.median(np.diff(course.time))))
    return [time for time in _RELAXATION_TIMES if fastest < time < course.span]


def relaxation_columns(course: Course, theta: Floats, surface: float, place: int, times: list[float]) -> Floats:
    """Forces (n, m) [N] of each parameter, of each branch, and of what had not relaxed when the record began."""
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
            held = np.where(first, np.exp(-(course.time - course.begin) / time), 0.0)
            columns += [held, -held]
    return np.column_stack(columns)


def _scaled(columns: Floats) -> tuple[Floats, Floats]:
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return columns / sizes, sizes


def relaxing_share(force: Floats, ratio: float) -> Floats:
    """Return the remaining share of a force that dies away, by the ratio of step to time constant; exact for steady
    change."""
    keep, reach = float(np.exp(-ratio)), 1
    share = (1.0 - keep) / ratio * np.diff(force, prepend=force[0])
    while reach < len(share) and keep > _MIN_MEMORY:  # each turn doubles how far it remembers (Hillis and Steele 1986)
        share[reach:] = share[reach:] + keep * share[:-reach]
        keep, reach = keep * keep, 2 * reach
    return share
