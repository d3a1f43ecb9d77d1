"""Bounds from the end of a track: the Cramer-Rao bound of its parameters, its noise, and slopes by chance alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats, SampleStore, Tail
from palpate_engine import force_slopes, hesitations
from palpate_kit.numerics.normal_equations import standard_errors

_MIN_INNOVATIONS = 100  # innovations to estimate their autocorrelation
_FADING_RATIO = 0.96  # of the variance that an estimator stated half a tail ago


def bounds_at_best(tail: Tail, kept: SampleStore, model: ContactModel, noise: float, samples: int) -> Floats:
    """Least standard uncertainties (k,) by any estimator, for white noise [N] and an unknown surface.

    The bound is noise^2 (J^T J)^-1, J the slopes of the force in parameters and depth along the kept samples, which
    stand for all. Not finite where they or the estimate at the tail say nothing, and for a model with memory.
    """
    nothing = np.full(len(model.parameters), np.inf)
    theta, used = tail.values[-1], kept.used
    depth, rate = float(tail.surface[-1]) - kept.position[used], -kept.velocity[used]
    rows = np.isfinite(depth) & np.isfinite(rate) & (depth > 0)
    if model.memory or not rows.any() or not np.isfinite(theta).all():
        return nothing
    _, by_parameter, by_depth, _ = force_slopes(model, depth[rows], rate[rows], theta.tolist())
    slopes = np.column_stack([by_parameter, by_depth])
    if not (np.isfinite(slopes).all() and slopes.any(axis=0).all()):
        return nothing
    return np.asarray(noise * standard_errors(slopes) / np.sqrt(samples / len(depth)))[:-1]


def slope_by_chance(tail: Tail) -> Floats:
    """Standard deviation (k,) [1/s] of the slope of estimates that have already settled.

    An optimal estimate of a constant is a random walk whose variance grows by as much as its own std^2 falls. Where
    that does not fall, the filter forgets, and its walk shows in the steps of the values.
    """
    span = float(tail.time[-1] - tail.time[0])
    if len(tail.time) < 10 or span <= 0:
        return np.zeros(tail.std.shape[1])
    early, late = (half.mean(axis=0) for half in np.array_split(tail.std**2, 2))
    learnt = np.sqrt(1.2 * 2 * np.maximum(early - late, 0.0)) / span  # halves are half the span apart
    return np.asarray(np.where(late < _FADING_RATIO * early, learnt, tail.slope_of_a_walk(tail.values)))


def white_noise(tail: Tail) -> float:
    """Standard deviation [N] of white noise that would give the third differences of the measured force."""
    third = np.diff(tail.force, 3)
    third = third[np.isfinite(third)]
    return float(np.sqrt(np.mean(third**2) / 20.0)) if len(third) else 0.0


def steady(tail: Tail) -> NDArray[np.bool_]:
    """(n,) True for the samples of a tail that are in no hesitation of the arm."""
    return ~hesitations(tail.time).hold(tail.time)


def correlation(tail: Tail) -> tuple[int, float]:
    """Lag [samples] and value of the largest autocorrelation of the innovations to lag 10; (0, 0): too few.

    White innovations have none beyond 1/sqrt(n): what could not be predicted from the sample before (Mehra 1970).
    """
    known = tail.innovation[np.isfinite(tail.innovation) & steady(tail)]
    if len(known) < _MIN_INNOVATIONS:
        return 0, 0.0
    power = float((known**2).sum())
    shares = [float((known[lag:] * known[:-lag]).sum()) / power for lag in range(1, 11)] if power > 0 else [0.0]
    lag = int(np.argmax(np.abs(shares)))
    return lag + 1, shares[lag]
