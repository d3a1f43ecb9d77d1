"""Score tests: whether any respect in which a model may be wrong shows in its residual, before a refit of each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from palpate import Floats

from palpate_uncertainty.channel_noise import Null
from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.model_alternatives import (
    MEMORY,
    ModelAlternative,
    Refit,
    fastest_branch,
    makers,
    relaxing_parameter,
)
from palpate_uncertainty.refit import Course
from palpate_uncertainty.relaxation_alternatives import relaxation_columns, relaxation_times

_SUSPICIOUS = 1e-2  # p of one score, 80 times what a directed test of eight is significant from
_CLIPPED = 6.0  # standard deviations; what is beyond is an outlier
_STEP = 1e-6  # of a number's range, and of a parameter
_DEEPER = 1e-7  # [m]


def suspects(course: Course, base: Refit, null: Null, frequency: float | None) -> list[str]:
    """The reasons whose directed test may become significant, by the slopes of the force alone.

    The score of m numbers is chi square of m degrees of freedom where the model is right, and as the ratio of
    likelihoods near it (Rao 1948): the share of the whitened residual along the slopes of these numbers that the
    slopes of the model's own numbers leave, over its variance.
    """
    runs = course.runs[course.used]
    _, known = null.whitened(base.residual, runs)

    def white(columns: Floats) -> Floats:
        return np.column_stack([null.whitened(column, runs)[0][known] for column in columns.T])

    left = _without_outliers(white(base.residual[:, None])[:, 0])
    power = max(float(np.mean(left**2)), 1e-300)
    own = np.linalg.qr(white(_model_slopes(course, base)))[0]
    left = left - own @ (own.T @ left)
    found = []
    for reason, slopes in _added_slopes(course, base, frequency):
        added = white(slopes)
        directions = _directions(added - own @ (own.T @ added))
        score = float(np.sum((directions.T @ left) ** 2)) / power / null.excess
        if chance_of_more(slopes.shape[1], score) < _SUSPICIOUS:
            found.append(reason)
    return found


def _model_slopes(course: Course, base: Refit) -> Floats:
    """Slopes (n, k + 1) of the fitted samples' force by the model's parameters and the surface."""
    at, columns = course.forces(base.theta, base.surface), []
    for i, value in enumerate(base.theta.tolist()):
        there = base.theta.copy()
        there[i] += _STEP * (abs(value) or 1.0)
        columns.append((course.forces(there, base.surface) - at) / (there[i] - value))
    columns.append((course.forces(base.theta, base.surface + _DEEPER) - at) / _DEEPER)
    return np.asarray(np.nan_to_num(np.column_stack(columns))[course.used])


def _added_slopes(course: Course, base: Refit, frequency: float | None) -> Iterator[tuple[str, Floats]]:
    """By reason, slopes (n, m) of the fitted samples' force by the numbers that each alternative adds, where they
    change nothing."""
    for reason, make in makers(course, base).items():
        made = make(course)
        if made.start:
            yield reason, _slopes_of(made, course, base)
    if (relaxing := relaxing_parameter(course)) is not None:
        times = relaxation_times(course, fastest_branch(course, frequency))
        columns = relaxation_columns(course, base.theta, base.surface, relaxing, times)[:, len(base.theta) :]
        if columns.shape[1]:
            yield MEMORY, columns[course.used]


def _slopes_of(made: ModelAlternative, course: Course, base: Refit) -> Floats:
    at, columns = course.forces(base.theta, base.surface), []
    for i, (low, high) in enumerate(zip(made.lower, made.upper, strict=True)):
        there = np.zeros(len(made.start))
        there[i] = _STEP * (high - low)
        columns.append((made.force(base.theta, base.surface, there) - at) / there[i])
    return np.asarray(np.nan_to_num(np.column_stack(columns))[course.used])


def _directions(columns: Floats) -> Floats:
    """Orthonormal directions (n, r) that columns (n, m) of any size span."""
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    directions, strengths, _ = np.linalg.svd(columns / sizes, full_matrices=False)
    return np.asarray(directions[:, strengths > 1e-8 * strengths[:1]])


def _without_outliers(white: Floats) -> Floats:
    scale = float(np.median(np.abs(white - np.median(white)))) * 1.4826 if len(white) else 0.0
    return np.clip(white, -_CLIPPED * scale, _CLIPPED * scale) if scale else white
