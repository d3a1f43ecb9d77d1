"""Identifiability: the test of an online estimate and its uncertainty by least squares on the samples that it used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Diagnosed, Flag, Floats, TrackEvidence
from palpate_engine import display_unit

from palpate_uncertainty.alternative_fit import refit
from palpate_uncertainty.information_bound import bounds_of_refit
from palpate_uncertainty.refit import APART, Course, make_course, possible, sweeps

# Choices of the samples that are judged. Stretches and lifts are those of a sweep by an estimator of one value.
_MIN_SAMPLES = 300  # in contact, for a judgement
_STRETCH_DURATION = 2.0  # [s] of a sweep
_MIN_LIFT = 0.1  # [s] between two samples in contact: the tip was in the air
# Choices: the distance of least squares, and the bound, that are part of the uncertainty, and those that are a flag.
_FLAGGED_DISTANCE = 3.0  # [combined uncertainties] between a value and its refit, beyond which it is doubted
_COUNTED_DISTANCE = 1.0  # [combined uncertainties] the same, beyond which it enters the uncertainty
_FLAGGED_BOUND_SHARE = 0.5  # of the bound, by a standard deviation; a filter that forgets is above it
_COUNTED_BOUND_SHARE = 0.9  # of the bound, by a standard deviation
_MAX_UNEVENNESS = 0.1  # of a value, between one stretch of a sweep and all of it
_INDISTINCT_CORRELATION = 0.998  # beyond which one of two could be 15 times better known if the other were
_MAX_BIAS_SHARE = 0.5  # of a predicted bias, up to which least squares shows that a value has none
_SMALLEST_VALUE = 1e-300  # in a quotient, in place of 0: near the smallest double
# What a filter went through, where least squares shows how far it has come out.
_BIAS = frozenset({"noise-bias"})
_SETTLED = frozenset({"depth-not-positive", "restarted", "too-stiff", "covariance-repaired"})


@dataclass(frozen=True)
class _RefitComparison:
    """Least squares on the samples of an estimator, against its values (k,)."""

    names: list[str]
    estimate: Floats  # (k,) by least squares
    distance: Floats  # (k,) of the estimator's values from it
    bound: Floats  # (k,) Cramer-Rao bound of a standard deviation
    correlation: Floats  # (k + 1, k + 1) of parameters and surface
    without_effect: list[str]  # names of parameters on which the force does not depend
    is_free: NDArray[np.bool_]  # (k,) True for values that were estimated

    @classmethod
    def of(cls, track: TrackEvidence, course: Course) -> _RefitComparison:
        """Fit a track's course by least squares, beginning at the estimate."""
        best = refit(course, track.values, track.surface)
        bound, correlation, without_effect = bounds_of_refit(course, best)
        names = [parameter.name for parameter in track.model.parameters]
        distance = np.abs(best.theta - track.values)
        is_free = np.isfinite(track.combined) & (track.std > 0)  # a value that is held fixed has no deviation
        return cls(
            names=names,
            estimate=best.theta,
            distance=distance,
            bound=bound,
            correlation=correlation,
            without_effect=without_effect,
            is_free=is_free,
        )


def identifiability(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return what least squares shows of each track of a filter or smoother; a fit judges itself.

    Least squares begins at the estimate and takes the samples that the estimator used. Two things are compared with
    its minimum, at which J (n, k + 1) are the slopes of the force in parameters and surface and sigma is the standard
    deviation of the residual:

    - the distance of the estimate from the minimum, which joins the uncertainty if it exceeds one combined
      uncertainty, and is flagged if it exceeds three;
    - the Cramer-Rao bound sigma^2 (J^T J)^-1, below which no variance can be. What a standard deviation lacks of it
      joins the uncertainty if it is below 0.9 of the bound, and is flagged if it is below half.

    On a sweep an estimator of one value is compared on each stretch of 2 s with the minimum of that stretch.
    """
    findings = {}
    for track in tracks:
        if track.report is not None or not possible(track) or track.estimator.follows_changes:
            continue
        # Too few samples whose motion is known, as where the arm hesitates all the time, show nothing.
        course = make_course(track, track.kept.used)
        if np.count_nonzero(course.used) >= _MIN_SAMPLES:
            try:
                findings[track.name] = _judge_sweep(track, course) if sweeps(track) else _judge_point(track, course)
            except ValueError:  # the model has no force at values that are so far off, which other flags report
                continue
    return findings


def _judge_point(track: TrackEvidence, course: Course) -> Diagnosed:
    """Return what least squares and the Cramer-Rao bound add to the uncertainty of one value for each parameter.

    `course` has the samples that the track used. Indexed by parameter (k,) are the distance of the track's value from
    least squares, the bound of its standard deviation, and what is made of them.
    """
    comparison = _RefitComparison.of(track, course)
    names, is_free = comparison.names, comparison.is_free
    distance, bound = comparison.distance, comparison.bound

    # The distance of least squares, from one combined uncertainty on. One that is flagged is also beyond the chance of
    # least squares itself: three times the bound.
    is_elsewhere = is_free & (distance > _FLAGGED_DISTANCE * track.combined)
    is_elsewhere &= distance > _FLAGGED_DISTANCE * np.minimum(bound, distance)
    is_counted = is_elsewhere | (is_free & (distance > _COUNTED_DISTANCE * track.combined))
    distance_term = np.where(is_counted, distance, 0.0)

    # The part of the bound that a standard deviation lacks.
    is_short = is_free & (track.std < _FLAGGED_BOUND_SHARE * bound)
    missing_variance = np.maximum(bound**2 - track.std**2, 0.0)
    lack = np.sqrt(np.where(is_free & (track.std < _COUNTED_BOUND_SHARE * bound), missing_variance, 0.0))

    # Flags from one uncertainty on; smaller distances and lacks add to the uncertainty without a word.
    flags = []
    if is_elsewhere.any():
        flags.append(_elsewhere_flag(track, comparison, is_elsewhere))
    if is_short.any() or comparison.without_effect:
        flags.append(_overconfident_flag(track, comparison, is_short, lack))
    terms = dict(zip(names, np.hypot(distance_term, lack).tolist(), strict=True))
    # The same of the values that are corrected for a filter's bias.
    remainders: dict[str, float] = {}
    for i, name in enumerate(names):
        corrected_distance = _corrected_distance(track, name, comparison.estimate[i])
        remainders[name] = float(np.hypot(corrected_distance, lack[i]))
    is_unbiased = all(_is_unbiased(track, name, comparison.estimate[i]) for i, name in enumerate(names))
    table: dict[str, Any] = {
        "least_squares": dict(zip(names, comparison.estimate.tolist(), strict=True)),
        "bound": dict(zip(names, bound.tolist(), strict=True)),
        "pairs": _indistinct_pairs(comparison),
        "without_effect": comparison.without_effect,
    }
    settles = _SETTLED | _BIAS if is_unbiased else _SETTLED
    return Diagnosed(tuple(flags), terms, left=remainders, table=table, settles=settles)


def _elsewhere_flag(track: TrackEvidence, comparison: _RefitComparison, is_elsewhere: NDArray[np.bool_]) -> Flag:
    """Return the flag of values that least squares contradicts."""
    places: list[str] = []
    for i in np.flatnonzero(is_elsewhere):
        unit, scale = display_unit(track.model.parameters[i].unit)
        estimate, value = scale * float(comparison.estimate[i]), scale * track.values[i]
        places.append(f"{comparison.names[i]} {estimate:.4g} {unit} where it gives {value:.4g}")
    effects = np.where(is_elsewhere, comparison.distance, 0.0).tolist()
    text = f"least squares on the same samples finds {', '.join(places)}"
    return Flag("elsewhere", text, effects=dict(zip(comparison.names, effects, strict=True)))


def _overconfident_flag(
    track: TrackEvidence, comparison: _RefitComparison, is_short: NDArray[np.bool_], lack: Floats
) -> Flag:
    """Return the flag of standard deviations below the bound, and of parameters that the force does not depend on.

    `is_short` (k,) are the deviations below half of the bound, `lack` (k,) is what they lack of it, as a root of
    variances.
    """
    claims: list[str] = []
    for i in np.flatnonzero(is_short):
        scale = 100.0 / max(abs(float(track.values[i])), _SMALLEST_VALUE)  # per cent of the value
        std, bound = scale * float(track.std[i]), scale * float(comparison.bound[i])
        claims.append(f"{comparison.names[i]} to {std:.2g} % where {bound:.2g} % is the bound")
    claims += [f"{name} has no effect on the force" for name in comparison.without_effect]
    pairs = _indistinct_pairs(comparison)
    indistinct = f"; hard to distinguish: {', '.join(pairs)}" if pairs else ""
    effects = dict(zip(comparison.names, np.where(is_short, lack, 0.0).tolist(), strict=True))
    effects |= dict.fromkeys(comparison.without_effect, np.inf)
    text = f"the estimator claims more than the record determines: {', '.join(claims)}{indistinct}"
    return Flag("overconfident", text, effects=effects)


def _is_unbiased(track: TrackEvidence, name: str, estimate: float) -> bool:
    """Return True if least squares is nearer to a value than to the place by the predicted bias of a filter."""
    value = track.found.get(name)
    if value is None or value.bias is None:
        return True
    return abs(estimate - value.value) < _MAX_BIAS_SHARE * abs(value.bias.shift)


def _corrected_distance(track: TrackEvidence, name: str, estimate: float) -> float:
    """Return the distance of a corrected value from least squares; 0 within one of its uncertainties."""
    value = track.found.get(name)
    if value is None or value.corrected is None or value.bias is None:
        return 0.0
    distance = abs(estimate - value.bias.shift * value.bias.shared - value.corrected.value)
    return distance if distance > _COUNTED_DISTANCE * value.corrected.combined else 0.0


def _slides(track: TrackEvidence) -> bool:
    """Return True if the tip went sideways in contact, and not from site to site through the air."""
    time, place = track.kept.time[track.kept.used], track.kept.lateral[track.kept.used]
    contacts = np.split(place, np.flatnonzero(np.diff(time) > _MIN_LIFT) + 1)
    return any(bool(np.max(np.ptp(contact, axis=0)) > APART) for contact in contacts if len(contact))


def _judge_sweep(track: TrackEvidence, course: Course) -> Diagnosed:
    """Return the flag where the one value of an estimator fails on a stretch of a sweep; `course` has all of it."""
    if not _slides(track):
        return Diagnosed()
    distance, bound = _stretches(track, course)
    if not len(distance):
        return Diagnosed()
    parameters = track.model.parameters
    lowest, highest = track.values + distance.min(axis=0), track.values + distance.max(axis=0)
    ranges = {}
    for i, parameter in enumerate(parameters):
        ranges[parameter.name] = [float(lowest[i]), float(highest[i])]
    table = {"stretches": ranges}

    # Elastic values that differ on a stretch by more than both uncertainties, and by a tenth.
    is_wrong = np.isfinite(track.combined) & (track.std > 0)
    is_wrong = is_wrong & (np.abs(distance) > _FLAGGED_DISTANCE * np.hypot(bound, track.combined))
    is_wrong &= np.abs(distance) > _MAX_UNEVENNESS * np.abs(track.values)
    is_elastic = np.array([parameter.role == "elastic" for parameter in parameters])
    is_uneven = is_wrong.any(axis=0) & is_elastic
    if not is_uneven.any():
        return Diagnosed(table=table)
    # Their effects are the root mean squares over the stretches.
    terms = np.where(is_uneven, np.sqrt(np.mean(distance**2, axis=0)), 0.0)
    effects = dict(zip(ranges, terms.tolist(), strict=True))
    text = f"least squares on stretches of the path finds {_range_text(track, is_uneven, ranges)}"
    return Diagnosed((Flag("elsewhere", text, effects=effects),), dict(effects), table=table)


def _range_text(track: TrackEvidence, is_uneven: NDArray[np.bool_], ranges: Mapping[str, list[float]]) -> str:
    """Return the ranges [SI] over the stretches of the parameters (k,) that are uneven, next to their one value."""
    texts: list[str] = []
    for i in np.flatnonzero(is_uneven):
        parameter = track.model.parameters[i]
        unit, scale = display_unit(parameter.unit)
        lowest, highest = ranges[parameter.name]
        range_text = f"{parameter.name} of {scale * lowest:.4g} to {scale * highest:.4g} {unit}"
        texts.append(f"{range_text} where its one value is {scale * track.values[i]:.4g}")
    return ", ".join(texts)


def _stretches(track: TrackEvidence, course: Course) -> tuple[Floats, Floats]:
    """Return least squares less the track's values (m, k), and its Cramer-Rao bounds (m, k), on m stretches of 2 s."""
    rows = np.flatnonzero(course.used)
    elapsed = course.time[rows] - course.time[rows[0]]
    last = max(int(elapsed[-1] / _STRETCH_DURATION) - 1, 0)  # takes what remains of the time
    stretches = np.minimum((elapsed / _STRETCH_DURATION).astype(int), last)
    distances, bounds = [], []
    for number in np.unique(stretches):
        used = np.zeros(len(course.used), bool)
        used[rows[stretches == number]] = True
        if np.count_nonzero(used) < _MIN_SAMPLES:
            continue
        stretch = replace(course, used=used)
        best = refit(stretch, track.values, track.surface)
        distances.append(best.theta - track.values)
        bounds.append(bounds_of_refit(stretch, best)[0])
    return np.array(distances), np.array(bounds)


def _indistinct_pairs(comparison: _RefitComparison) -> list[str]:
    """Return the pairs of parameters, or of one and the surface, that nearly move the force alike."""
    names = [*comparison.names, "surface"]
    pairs = []
    for i, j in combinations(range(len(names)), 2):
        correlation = comparison.correlation[i, j]
        if abs(correlation) > _INDISTINCT_CORRELATION:
            pairs.append(f"{names[i]} and {names[j]} ({correlation:+.4f})")
    return pairs
