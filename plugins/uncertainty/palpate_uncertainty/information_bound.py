"""Bounds of a track: the Cramer-Rao bound of its parameters, its noise, and slopes by chance alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats, SampleStore, Tail
from palpate_engine import force_slopes, hesitations
from palpate_kit.numerics.normal_equations import scaled_inverse, standard_errors

from palpate_uncertainty.alternative_fit import Refit
from palpate_uncertainty.refit import Course

# They apply to filters; the fewest samples guard short records.
_MAX_SAMPLES = 3000  # that slopes are taken at: a choice of time
_DIFFERENCE = 1e-4  # of a value, for slopes by differences
_DEPTH_DIFFERENCE = 1e-6  # [m] of the surface, for a slope by differences
_SURFACE_UNIT = 1e-3  # [m] in which the slope in the surface is taken: of the size of relative changes of a value
_MIN_INNOVATIONS = 100  # innovations to estimate their autocorrelation; a choice
_MAX_LAG = 10  # samples of that autocorrelation; a choice
_MIN_TAIL = 10  # samples of a tail, for a slope; a choice
_THIRD_DIFFERENCE_VARIANCE = 20.0  # variance of third differences of white noise of variance 1: 1 + 9 + 9 + 1
_WALK_SLOPE_VARIANCE = 6 / 5  # of the slope of a line through a random walk, of the walk's own over the span squared
_FADING_RATIO = 0.96  # of the variance half a tail ago, above which an estimator does not learn: a choice


def bounds_at_best(tail: Tail, kept: SampleStore, model: ContactModel, noise: float, sample_count: int) -> Floats:
    """Return the least standard uncertainties (k,) by any estimator, for white noise [N] and an unknown surface.

    They are the roots of the diagonal of Cramer and Rao's bound noise^2 (J^T J)^-1, J the slopes of the force in
    parameters and depth along the kept samples, which stand for all of the track's samples. `tail` are the estimates at
    the end of the track, at the last of which J is taken. Infinite where no kept sample or no slope is a number, where
    the force does not depend on a parameter, and for a model with memory, whose force depends on the past.
    """
    unbounded = np.full(len(model.parameters), np.inf)
    theta, used = tail.values[-1], kept.used  # the tail's last estimate
    depth, rate = float(tail.surface[-1]) - kept.position[used], -kept.velocity[used]
    rows = np.isfinite(depth) & np.isfinite(rate) & (depth > 0)
    if model.memory or not rows.any() or not np.isfinite(theta).all():
        return unbounded
    _, by_parameter, by_depth, _ = force_slopes(model, depth[rows], rate[rows], theta.tolist())
    slopes = np.column_stack([by_parameter, by_depth])
    if not (np.isfinite(slopes).all() and slopes.any(axis=0).all()):
        return unbounded
    samples_each = sample_count / len(depth)  # that a kept sample stands for
    return np.asarray(noise * standard_errors(slopes) / np.sqrt(samples_each))[:-1]  # without the surface


def slope_by_chance(tail: Tail) -> Floats:
    """Return the standard deviation (k,) [1/s] of the slope of estimates that have already settled.

    An optimal estimate of a constant is a random walk whose variance grows by as much as its own std^2 falls. Where
    that does not fall, the filter forgets, and its walk shows in the steps of the values.
    """
    span = float(tail.time[-1] - tail.time[0])
    if len(tail.time) < _MIN_TAIL or span <= 0:
        return np.zeros(tail.std.shape[1])
    early, late = (half.mean(axis=0) for half in np.array_split(tail.std**2, 2))
    # The halves are half the span apart, so the variance of the walk over all of it is twice their difference; the
    # variance of the slope of a line through a walk is 6/5 of that over the span squared.
    walk_slope = np.sqrt(_WALK_SLOPE_VARIANCE * 2 * np.maximum(early - late, 0.0)) / span
    return np.asarray(np.where(late < _FADING_RATIO * early, walk_slope, tail.slope_of_a_walk(tail.values)))


def white_noise(tail: Tail) -> float:
    """Return the standard deviation [N] of white noise that would give the third differences of the measured force."""
    third = np.diff(tail.force, 3)
    third = third[np.isfinite(third)]
    return float(np.sqrt(np.mean(third**2) / _THIRD_DIFFERENCE_VARIANCE)) if len(third) else 0.0


def steady(tail: Tail) -> NDArray[np.bool_]:
    """Return True (n,) for the samples of a tail that are in no hesitation of the arm."""
    return ~hesitations(tail.time).hold(tail.time)


def correlation(tail: Tail) -> tuple[int, float]:
    """Return lag [samples] and value of the largest autocorrelation of the innovations; (0, 0) of too few.

    `tail` has the estimates and innovations at the end of a track.
    White innovations have none beyond 1/sqrt(n): they cannot be predicted from the samples before (Mehra 1970).
    """
    innovation = tail.innovation[np.isfinite(tail.innovation) & steady(tail)]
    if len(innovation) < _MIN_INNOVATIONS:
        return 0, 0.0
    power = float((innovation**2).sum())
    correlations = [0.0]
    if power > 0:
        lags = range(1, _MAX_LAG + 1)
        correlations = [float((innovation[lag:] * innovation[:-lag]).sum()) / power for lag in lags]
    largest = int(np.argmax(np.abs(correlations)))
    return largest + 1, correlations[largest]


def bounds_of_refit(course: Course, best: Refit) -> tuple[Floats, Floats, list[str]]:
    """Return the Cramer-Rao bound (k,) of each parameter, correlations (k + 1, k + 1), and names without an effect.

    `best` is the model fitted to the samples of `course`, the last of the correlations is of the surface. The bounds
    are noise times the roots of the diagonal of (J^T J)^-1, the noise that of the refit's residual. A parameter on
    which the force does not depend is without an effect; its bound, which is infinite, is written as 0.
    """
    reduced = course if course.model.memory else course.reduced(_MAX_SAMPLES)
    slopes = _slopes(reduced, best)[reduced.used]
    slopes = slopes[np.isfinite(slopes).all(axis=1)]
    has_effect = np.linalg.norm(slopes, axis=0) > 0
    inverse = scaled_inverse(slopes.T @ slopes)
    variance = np.maximum(np.diag(inverse), 0.0)
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))  # that makes a covariance a correlation

    # Noise of one sample, for as many as each of the reduced ones stands for.
    samples_each = max(int(np.count_nonzero(course.used)), 1) / max(len(slopes), 1)
    noise = float(np.std(best.residual)) / np.sqrt(samples_each)
    k = len(best.theta)
    # Slopes are in relative changes of a parameter, or in changes of 1 of one that is 0.
    change_unit = np.where(best.theta != 0, np.abs(best.theta), 1.0)
    bound = np.where(has_effect, noise * np.sqrt(variance), np.inf)[:k] * change_unit
    names = [parameter.name for parameter in course.model.parameters]
    without_effect = [name for name, has in zip(names, has_effect[:k].tolist(), strict=True) if not has]
    return np.where(np.isfinite(bound), bound, 0.0), inverse / np.outer(scale, scale), without_effect


def _slopes(course: Course, best: Refit) -> Floats:
    """Return slopes (n, k + 1) of the force in relative changes of the parameters, and in the surface [mm].

    By central differences.
    """
    columns = []
    for i, value in enumerate(best.theta):
        step = np.zeros_like(best.theta)
        step[i] = _DIFFERENCE * (abs(float(value)) or 1.0)
        above, below = (course.forces(best.theta + sign * step, best.surface) for sign in (1.0, -1.0))
        columns.append((above - below) / (2.0 * _DIFFERENCE))
    above, below = (course.forces(best.theta, best.surface + sign * _DEPTH_DIFFERENCE) for sign in (1.0, -1.0))
    columns.append((above - below) / (2.0 * _DEPTH_DIFFERENCE / _SURFACE_UNIT))
    return np.column_stack(columns)
