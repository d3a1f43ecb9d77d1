"""Score tests: whether any respect in which a model may be wrong shows in its residual, before a refit of each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from palpate import Floats

from palpate_uncertainty.alternative_fit import ModelAlternative, Refit
from palpate_uncertainty.channel_noise import Null, without_outliers
from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.model_alternatives import MEMORY, fastest_branch, makers, relaxing_parameter
from palpate_uncertainty.refit import Course
from palpate_uncertainty.relaxation_alternatives import relaxation_columns, relaxation_times

SUSPICIOUS = 1e-2  # p of one score, 80 times what a directed test of eight is significant from
_MAX_SHORTFALL = 4.0  # times the share that a score promises, which a refit may take
_DIFFERENCE = 1e-6  # of a number's range, and of a parameter
_DEPTH_STEP = 1e-7  # [m] of the surface, for a slope by differences
_ROUNDING_SHARE = 1e-12  # of the square of a column of length 1, below which nothing of it is left


class Score(NamedTuple):
    """The score of an alternative, by the slopes of the force alone."""

    p: float  # where the model is right
    share: float  # of the variance of the whitened residual

    def counts(self, beyond: float) -> bool:
        """True where its refit may take a share of the variance, of what it leaves, `beyond` another one."""
        return _MAX_SHORTFALL * self.share > beyond * (1.0 - self.share)


def scores(course: Course, base: Refit, null: Null, frequency: float | None) -> dict[str, Score]:
    """By reason, the score of each alternative that adds numbers.

    The score of m numbers is chi square of m degrees of freedom where the model is right, and as the ratio of
    likelihoods near it (Rao 1948): the share of the whitened residual along the slopes of these numbers that the
    slopes of the model's own numbers leave, over its variance.
    """
    runs = course.runs[course.used]
    own, added = model_slopes(course, base), dict(_added_slopes(course, base, frequency))
    columns = np.column_stack([own, *added.values()]).T
    white = np.array([null.whitened(column, runs)[0] for column in columns])
    left, known = null.whitened(base.residual, runs)
    left = without_outliers(left[known])
    white = np.vstack([white[:, known], left])
    white /= np.maximum(np.linalg.norm(white, axis=1), 1e-300)[:, None]
    square = _beside(white @ white.T, own.shape[1])
    found, place = {}, 0
    for reason, slopes in added.items():
        rows = slice(place, place := place + slopes.shape[1])
        share = _explained(square[rows, rows], square[rows, -1])
        found[reason] = Score(chance_of_more(slopes.shape[1], len(left) * share / null.excess), share)
    return found


def _beside(square: Floats, count: int) -> Floats:
    """Products of the columns that follow the first ones with one another, less what these explain of them."""
    own, mixed = square[:count, :count], square[:count, count:]
    return np.asarray(square[count:, count:] - mixed.T @ np.linalg.pinv(own, _ROUNDING_SHARE, hermitian=True) @ mixed)


def _explained(square: Floats, product: Floats) -> float:
    """Share of a square that columns explain, by their products with one another (m, m) and with it (m,)."""
    powers, directions = np.linalg.eigh(square)
    shares = (product @ directions) ** 2
    return float(np.sum(shares[powers > _ROUNDING_SHARE] / powers[powers > _ROUNDING_SHARE]))


def model_slopes(course: Course, base: Refit) -> Floats:
    """Slopes (n, k + 1) of the fitted samples' force by the model's parameters and the surface."""
    at, columns = course.forces(base.theta, base.surface), []
    for i, value in enumerate(base.theta.tolist()):
        there = base.theta.copy()
        there[i] += _DIFFERENCE * (abs(value) or 1.0)
        columns.append((course.forces(there, base.surface) - at) / (there[i] - value))
    columns.append((course.forces(base.theta, base.surface + _DEPTH_STEP) - at) / _DEPTH_STEP)
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
        there[i] = _DIFFERENCE * (high - low)
        columns.append((made.force(base.theta, base.surface, there) - at) / there[i])
    return np.asarray(np.nan_to_num(np.column_stack(columns))[course.used])
