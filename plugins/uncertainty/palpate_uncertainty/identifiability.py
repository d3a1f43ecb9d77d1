"""Identifiability: the test of an online estimate and its uncertainty by least squares on the samples that it used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from palpate import Diagnosed, Flag, Floats, TrackEvidence
from palpate_engine import display_unit
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_uncertainty.model_alternatives import Refit, refit
from palpate_uncertainty.refit import APART, Course, make_course, possible, sweeps

# Choices of the samples that are judged.
_MIN_SAMPLES = 300  # in contact, for a judgement
_MAX_SAMPLES = 3000  # that slopes are taken at: a choice of time
_STRETCH_DURATION = 2.0  # [s] of a sweep
_MIN_LIFT = 0.1  # [s] between two samples in contact: the tip was in the air
# Choices: the distance of least squares, and the bound, that are part of the uncertainty, and those that are a flag.
_FLAGGED_DISTANCE = 3.0  # [combined uncertainties] between a value and its refit, beyond which it is doubted
_COUNTED_DISTANCE = 1.0  # [combined uncertainties] the same, beyond which it enters the uncertainty
_FLAGGED_BOUND_SHARE = 0.5  # of the bound, by a standard deviation; a filter that forgets is above it
_COUNTED_BOUND_SHARE = 0.9  # of the bound, by a standard deviation
_MAX_UNEVENNESS = 0.1  # of a value, between one stretch of the way and all of it
_INDISTINCT_CORRELATION = 0.998  # beyond which one of two could be 15 times better known if the other were
_DIFFERENCE = 1e-4  # of a value, for slopes by differences
# What a filter went through, where least squares shows how far it has come out.
_BIAS = frozenset({"noise-bias"})
_SETTLED = frozenset({"depth-not-positive", "restarted", "too-stiff", "covariance-repaired"})


def identifiability(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Findings on all tracks that were estimated as they came, or smoothed; a fit judges itself.

    Least squares from the estimate, over the samples that the estimator used, must lead to a place within its
    uncertainty; and no standard deviation can be below the Cramer-Rao bound sigma^2 (J^T J)^-1 there, J the slopes of
    the force in parameters and surface, sigma the residual's standard deviation. Where either fails, the distance, or
    the bound, joins the uncertainty, and does so before that is worth a flag: a distance from one uncertainty on, the
    bound for what is below 0.9 of it. On a sweep this holds for every stretch of the way, of an estimator that looks
    for one value.
    """
    found = {}
    for track in tracks:
        enough = np.count_nonzero(track.kept.used) >= _MIN_SAMPLES
        if track.report is None and enough and possible(track) and not track.estimator.follows_changes:
            try:
                found[track.name] = _along_the_way(track) if sweeps(track) else _judge(track)
            except ValueError:  # the model has no force at numbers that far off, which other flags say
                continue
    return found


def _judge(track: TrackEvidence) -> Diagnosed:
    names = [parameter.name for parameter in track.model.parameters]
    course = make_course(track, track.kept.used)
    best = refit(course, track.values, track.surface)
    bound, correlation, blind = _bounds(course, best)
    away = np.abs(best.theta - track.values)
    free = np.isfinite(track.combined) & (track.std > 0)
    elsewhere = (
        free & (away > _FLAGGED_DISTANCE * track.combined) & (away > _FLAGGED_DISTANCE * np.minimum(bound, away))
    )
    short = free & (track.std < _FLAGGED_BOUND_SHARE * bound)
    terms = np.where(elsewhere | (free & (away > _COUNTED_DISTANCE * track.combined)), away, 0.0)
    lacks = np.where(free & (track.std < _COUNTED_BOUND_SHARE * bound), np.maximum(bound**2 - track.std**2, 0.0), 0.0)
    terms = np.hypot(terms, np.sqrt(lacks))
    left = {
        name: float(np.hypot(_apart(track, name, best.theta[i]), np.sqrt(lacks[i]))) for i, name in enumerate(names)
    }
    flags = []
    if elsewhere.any():
        said = [_said(track, names, int(i), float(best.theta[i])) for i in np.flatnonzero(elsewhere)]
        text = f"least squares on the same samples finds {', '.join(said)}"
        effects = dict(zip(names, np.where(elsewhere, away, 0.0).tolist(), strict=True))
        flags.append(Flag("elsewhere", text, effects=effects))
    if short.any() or blind:
        said = [
            _percent(names[i], float(track.values[i]), float(track.std[i]), float(bound[i]))
            for i in np.flatnonzero(short)
        ]
        said += [f"{name} has no effect on the force" for name in blind]
        pairs = _pairs(names, correlation)
        alike = f"; hard to distinguish: {', '.join(pairs)}" if pairs else ""
        text = f"the estimator claims more than the record determines: {', '.join(said)}{alike}"
        effects = dict(zip(names, np.where(short, np.sqrt(lacks), 0.0).tolist(), strict=True))
        flags.append(Flag("overconfident", text, effects=effects | dict.fromkeys(blind, np.inf)))
    table: dict[str, Any] = {
        "least_squares": dict(zip(names, best.theta.tolist(), strict=True)),
        "bound": dict(zip(names, bound.tolist(), strict=True)),
        "pairs": _pairs(names, correlation),
        "without_effect": blind,
    }
    found = dict(zip(names, terms.tolist(), strict=True))
    settled = _SETTLED | _BIAS if all(_unbiased(track, n, best.theta[i]) for i, n in enumerate(names)) else _SETTLED
    return Diagnosed(tuple(flags), found, left=left, table=table, settles=settled)


def _unbiased(track: TrackEvidence, name: str, best: float) -> bool:
    """True where least squares is nearer to a value than to the place by the predicted bias of a filter."""
    found = track.found.get(name)
    return found is None or found.bias is None or abs(best - found.value) < 0.5 * abs(found.bias.shift)


def _apart(track: TrackEvidence, name: str, best: float) -> float:
    """Distance of a corrected value from least squares, where that is more than one of its uncertainties; else 0."""
    found = track.found.get(name)
    corrected = found.corrected if found is not None else None
    if found is None or corrected is None or found.bias is None:
        return 0.0
    away = abs(best - found.bias.shift * found.bias.shared - corrected.value)
    return away if away > _COUNTED_DISTANCE * corrected.combined else 0.0


def _slid(track: TrackEvidence) -> bool:
    """True where the tip went sideways in contact, and not from site to site through the air."""
    time, place = track.kept.time[track.kept.used], track.kept.lateral[track.kept.used]
    stays = np.split(place, np.flatnonzero(np.diff(time) > _MIN_LIFT) + 1)
    return any(bool(np.max(np.ptp(stay, axis=0)) > APART) for stay in stays if len(stay))


def _along_the_way(track: TrackEvidence) -> Diagnosed:
    """Return the flag where the one value of an estimator that does not follow changes fails on a stretch of a
    sweep."""
    if not _slid(track):
        return Diagnosed()
    course = make_course(track, track.kept.used)
    rows = np.flatnonzero(course.used)
    since = course.time[rows] - course.time[rows[0]]
    places = np.minimum((since / _STRETCH_DURATION).astype(int), max(int(since[-1] / _STRETCH_DURATION) - 1, 0))
    away, bounds = [], []
    for place in np.unique(places):
        here = np.zeros(len(course.used), bool)
        here[rows[places == place]] = True
        if np.count_nonzero(here) < _MIN_SAMPLES:
            continue
        local = refit(replace(course, used=here), track.values, track.surface)
        away.append(local.theta - track.values)
        bounds.append(_bounds(replace(course, used=here), local)[0])
    if not away:
        return Diagnosed()
    names = [parameter.name for parameter in track.model.parameters]
    found, unsure = np.array(away), np.hypot(np.array(bounds), track.combined)
    sure = np.isfinite(track.combined) & (track.std > 0) & (np.abs(found) > _FLAGGED_DISTANCE * unsure)
    sure &= np.abs(found) > _MAX_UNEVENNESS * np.abs(track.values)
    elastic = np.array([parameter.role == "elastic" for parameter in track.model.parameters])
    wrong = sure.any(axis=0) & elastic
    low, high = (track.values + end(found, axis=0) for end in (np.min, np.max))
    table = {name: [float(low[i]), float(high[i])] for i, name in enumerate(names)}
    if not wrong.any():
        return Diagnosed(table={"stretches": table})
    said = [
        f"{names[i]} of {scale * low[i]:.4g} to {scale * high[i]:.4g} {unit} where its one value is "
        f"{scale * track.values[i]:.4g}"
        for i in np.flatnonzero(wrong)
        for unit, scale in [display_unit(track.model.parameters[i].unit)]
    ]
    terms = np.where(wrong, np.sqrt(np.mean(found**2, axis=0)), 0.0)
    effects = dict(zip(names, terms.tolist(), strict=True))
    flag = Flag("elsewhere", f"least squares on stretches of the path finds {', '.join(said)}", effects=effects)
    return Diagnosed((flag,), dict(zip(names, terms.tolist(), strict=True)), table={"stretches": table})


def _said(track: TrackEvidence, names: list[str], i: int, value: float) -> str:
    unit, scale = display_unit(track.model.parameters[i].unit)
    return f"{names[i]} {scale * value:.4g} {unit} where it gives {scale * track.values[i]:.4g}"


def _percent(name: str, value: float, std: float, bound: float) -> str:
    scale = 100.0 / max(abs(value), 1e-300)
    return f"{name} to {scale * std:.2g} % where {scale * bound:.2g} % is the bound"


def _pairs(names: list[str], correlation: Floats) -> list[str]:
    known = [*names, "surface"]
    found = []
    for i, j in combinations(range(len(known)), 2):
        if abs(correlation[i, j]) > _INDISTINCT_CORRELATION:
            found.append(f"{known[i]} and {known[j]} ({correlation[i, j]:+.4f})")
    return found


def _bounds(course: Course, best: Refit) -> tuple[Floats, Floats, list[str]]:
    """Cramer-Rao bound (k,) of each parameter, correlations (k + 1, k + 1), and what has no effect on the force."""
    small = course if course.model.memory else course.reduced(_MAX_SAMPLES)
    slopes = _slopes(small, best)[small.used]
    slopes = slopes[np.isfinite(slopes).all(axis=1)]
    has_effect = np.linalg.norm(slopes, axis=0) > 0
    inverse = scaled_inverse(slopes.T @ slopes)
    variance = np.maximum(np.diag(inverse), 0.0)
    spread = np.sqrt(np.where(variance > 0, variance, 1.0))
    count = max(int(np.count_nonzero(course.used)), 1) / max(len(slopes), 1)  # samples that each of these stands for
    noise = float(np.std(best.residual)) / np.sqrt(count)
    k = len(best.theta)
    sizes = np.where(best.theta != 0, np.abs(best.theta), 1.0)
    bound = np.where(has_effect, noise * np.sqrt(variance), np.inf)[:k] * sizes
    names = [parameter.name for parameter in course.model.parameters]
    blind = [name for name, shows in zip(names, has_effect[:k].tolist(), strict=True) if not shows]
    return np.where(np.isfinite(bound), bound, 0.0), inverse / np.outer(spread, spread), blind


def _slopes(course: Course, best: Refit) -> Floats:
    """Slopes (n, k + 1) of the force in relative changes of the parameters, and in the surface [mm]."""
    columns = []
    for i, value in enumerate(best.theta):
        step = np.zeros_like(best.theta)
        step[i] = _DIFFERENCE * (abs(float(value)) or 1.0)
        ahead, back = (course.forces(best.theta + sign * step, best.surface) for sign in (1.0, -1.0))
        columns.append((ahead - back) / (2.0 * _DIFFERENCE))
    ahead, back = (course.forces(best.theta, best.surface + sign * 1e-6) for sign in (1.0, -1.0))
    columns.append((ahead - back) / 2e-3)
    return np.column_stack(columns)
