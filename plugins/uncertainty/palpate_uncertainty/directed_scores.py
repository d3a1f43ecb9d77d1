"""Score tests: the alternatives that a residual may show, by the slopes of the force, before a refit of each."""

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

# They leave out refits whose gain a score already excludes: what they cost is time, and no verdict.
SUSPICIOUS = 1e-2  # p of one score (choice), 80 times what a directed test of eight is significant from
_MAX_SHORTFALL = 4.0  # times the share that a score promises (choice), which a refit may take
# Choices: steps of differences, far above rounding and far below the curvature of the force.
_DIFFERENCE = 1e-6  # of a number's range, and of a parameter
_DEPTH_STEP = 1e-7  # [m] of the surface
_ROUNDING_SHARE = 1e-12  # of the square of a column of length 1 (choice), below which its remainder is rounding
_SMALLEST_LENGTH = 1e-300  # of a column in a quotient, in place of 0: near the smallest double


class Score(NamedTuple):
    """The score of an alternative, by the slopes of the force alone."""

    p: float  # where the model is right
    share: float  # of the variance of the whitened residual

    def counts(self, beyond: float) -> bool:
        """Return True if its refit may take a share of the variance that it leaves of more than `beyond`."""
        return _MAX_SHORTFALL * self.share > beyond * (1.0 - self.share)


def scores(course: Course, base: Refit, null: Null, frequency: float | None) -> dict[str, Score]:
    """Return, by reason, the score of each alternative that adds numbers.

    `course` has the samples in contact, `base` is the model fitted to them as it is, `null` the noise of the channel,
    `frequency` [Hz] that of an oscillation. The score of m numbers is chi square of m degrees of freedom where the
    model is right, and as the ratio of likelihoods near it (Rao 1948): the share of the whitened residual along the
    slopes of these numbers, less the slopes of the model's own numbers, over its variance. It is divided by
    `null.excess`, by which slow means may vary more than those of white noise, since the null is itself an estimate.
    """
    runs = course.runs[course.used]
    own_slopes, added_slopes = model_slopes(course, base), dict(_added_slopes(course, base, frequency))

    # All columns and the residual, whitened and of length 1.
    columns = np.column_stack([own_slopes, *added_slopes.values()]).T
    white_columns = np.array([null.whitened(column, runs)[0] for column in columns])
    residual, has_past = null.whitened(base.residual, runs)
    residual = without_outliers(residual[has_past])
    white = np.vstack([white_columns[:, has_past], residual])
    white /= np.maximum(np.linalg.norm(white, axis=1), _SMALLEST_LENGTH)[:, None]

    # Less the slopes of the model's own numbers; the last row and column are the residual's.
    products = _without_first(white @ white.T, own_slopes.shape[1])
    by_reason: dict[str, Score] = {}
    begin = 0
    for reason, slopes in added_slopes.items():
        count = slopes.shape[1]
        rows = slice(begin, begin + count)
        share = _explained_share(products[rows, rows], products[rows, -1])
        by_reason[reason] = Score(chance_of_more(count, len(residual) * share / null.excess), share)
        begin += count
    return by_reason


def _without_first(products: Floats, count: int) -> Floats:
    """Return products of columns with one another, less the part of them along the first `count` columns."""
    first, mixed = products[:count, :count], products[:count, count:]
    inverse = np.linalg.pinv(first, _ROUNDING_SHARE, hermitian=True)
    return np.asarray(products[count:, count:] - mixed.T @ inverse @ mixed)


def _explained_share(square: Floats, product: Floats) -> float:
    """Return the share of a square that columns explain, by their products with one another (m, m) and with it (m,)."""
    powers, directions = np.linalg.eigh(square)
    shares = (product @ directions) ** 2
    is_independent = powers > _ROUNDING_SHARE
    return float(np.sum(shares[is_independent] / powers[is_independent]))


def model_slopes(course: Course, base: Refit) -> Floats:
    """Return the slopes (n, k + 1) of the fitted samples' force by the model's parameters and the surface."""
    force = course.forces(base.theta, base.surface)
    columns = []
    for i, value in enumerate(base.theta.tolist()):
        moved = base.theta.copy()
        moved[i] += _DIFFERENCE * (abs(value) or 1.0)
        columns.append((course.forces(moved, base.surface) - force) / (moved[i] - value))
    columns.append((course.forces(base.theta, base.surface + _DEPTH_STEP) - force) / _DEPTH_STEP)
    return np.asarray(np.nan_to_num(np.column_stack(columns))[course.used])


def _added_slopes(course: Course, base: Refit, frequency: float | None) -> Iterator[tuple[str, Floats]]:
    """Yield, by reason, the slopes (n, m) of the fitted samples' force by the numbers that each alternative adds.

    They are taken at the numbers by which the alternative is the model itself.
    """
    for reason, make in makers(course, base).items():
        alternative = make(course)
        if alternative.start:
            yield reason, _slopes_of(alternative, course, base)
    if (relaxing := relaxing_parameter(course)) is not None:
        times = relaxation_times(course, fastest_branch(course, frequency))
        columns = relaxation_columns(course, base.theta, base.surface, relaxing, times)[:, len(base.theta) :]
        if columns.shape[1]:
            yield MEMORY, columns[course.used]


def _slopes_of(alternative: ModelAlternative, course: Course, base: Refit) -> Floats:
    """Return the slopes (n, m) of the fitted samples' force by the numbers of one alternative."""
    force = course.forces(base.theta, base.surface)
    columns = []
    for i, (low, high) in enumerate(zip(alternative.lower, alternative.upper, strict=True)):
        numbers = np.zeros(len(alternative.start))
        numbers[i] = _DIFFERENCE * (high - low)
        columns.append((alternative.force(base.theta, base.surface, numbers) - force) / numbers[i])
    return np.asarray(np.nan_to_num(np.column_stack(columns))[course.used])
