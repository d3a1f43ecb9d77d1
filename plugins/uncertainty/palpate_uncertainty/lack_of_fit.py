"""Lack of fit: whether the residual of a model on a record is the noise of its channel, and what else it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from palpate import Condition, Diagnosed, Flag, TrackEvidence
from palpate_engine import remedy_of

from palpate_uncertainty.discrepancy import Misfit, has_layer, judge_misfit
from palpate_uncertainty.model_alternatives import refit
from palpate_uncertainty.refit import free_unknowns, make_course, moves_along, possible
from palpate_uncertainty.refitted_model import (
    ENOUGH,
    SETTLED,
    RefittedModel,
    by_innovations,
    explained,
    judged_rows,
    judges_all,
    misfit_table,
    refitted_model,
    with_noise,
)
from palpate_uncertainty.residual_null import air_readings, rounding_noise
from palpate_uncertainty.residual_tests import refit_tests, residual_tests
from palpate_uncertainty.score_tests import LEVEL

_STRETCH = 4.0  # [s] of a sweep
_OF_A_SWEEP = 0.015  # of the variance of innovations; the most of 28 tracks of clean sweeps was 0.008
_UNTESTED = "the residual is noise alone, which was not tested"
_DEEP = 3e-3  # [m], where the surface is looked for first


def lack_of_fit(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Findings on all tracks; see docs/verdict.md.

    A judgement is of model, record and rig: all tracks of a model that is to hold for the whole record share one, of
    the fit where there is one. A fit of a part of the record, with unknowns of its own, and a sweep are judged alone.
    """
    judgements: dict[int, Diagnosed] = {}
    findings = {}
    for track in sorted(tracks, key=lambda track: not _is_fit(track)):
        key = id(track.model) if judges_all(track) else id(track)
        finding = judgements.get(key) or _with_open_noise(track, _judged(track))
        if finding is None:
            continue
        findings[track.name] = finding
        # A track that could not be judged, such as one that diverged, says nothing of the others.
        if finding.table:
            judgements[key] = finding
    return {track.name: findings[track.name] for track in tracks if track.name in findings}


def _is_fit(track: TrackEvidence) -> bool:
    """Return True for a fit that reports its residuals."""
    return track.report is not None and bool(np.isfinite(track.kept.innovation).any())


def _judged(track: TrackEvidence) -> Diagnosed | None:
    """Return the judgement of a track; a model without a force at such numbers is one that could not be judged."""
    try:
        return _judge(track)
    except (ValueError, ArithmeticError) as error:  # the others are judged
        return Diagnosed((Flag("diagnosis-failed", f"lack-of-fit: {error}"),))


def _with_open_noise(track: TrackEvidence, finding: Diagnosed | None) -> Diagnosed | None:
    """Return a finding, with the condition on the noise where neither air nor digit shows that; None without either."""
    if track.ending is None or air_readings(track) is not None or rounding_noise(track) is not None:
        return finding
    text = _UNTESTED if finding is None else "noise of the force taken from its fastest changes"
    noise = Condition("noise", text, remedy_of("noise"))
    return replace(finding or Diagnosed(), conditions=(noise,))


def _judge(track: TrackEvidence) -> Diagnosed | None:
    """By the residual along each alternative; by refits where the noise is open, or the model remembers."""
    if not possible(track):
        return None
    fitted = _is_fit(track)
    if not np.isfinite(track.kept.velocity).any():
        raise ValueError("no sample in contact has a known speed; is [alignment] gap below the interval of readings?")
    judged = judged_rows(track)
    if not make_course(track, judged).used.any():
        return None
    enough = np.count_nonzero(track.kept.used & ~track.kept.hesitating) >= ENOUGH
    if moves_along(track) and not fitted:
        return _along_a_sweep(track) if enough else None
    if fitted and getattr(track.estimator, "unloading", "following") == "ting":  # which no refit here does
        own = by_innovations(track)
        return explained(track, own, refitted_model(track)) if own.p < LEVEL else misfit_table(own)
    tests = (residual_tests if fitted else refit_tests)(track, judged)
    if tests is not None:
        if tests.is_right:
            return Diagnosed(table=tests.table(), settles=SETTLED)
        about = f"; no alternative explains all of its pattern over {tests.unexplained}" if tests.unexplained else ""
        finding = judge_misfit(tests.misfit, track.model.parameters, tests.table(), about, has_layer(track.model))
        return replace(finding, settles=SETTLED)
    base = refitted_model(track)
    if not enough:
        return _untested(track, base)
    found = base.test(base.fit.residual)
    if fitted and (own := by_innovations(track)).p < found.p:
        found = base.by_motion(own, float(np.var(base.fit.residual)))
    if min(found.p, base.p) < LEVEL:
        return explained(track, found, base)
    table = misfit_table(found)
    # The residual is noise as far as the tests show.
    prediction = base.prediction(free_unknowns(track), float(np.var(base.fit.residual)))
    return replace(table, table=dict(table.table) | {"prediction": prediction.table()}) if prediction else table


def _untested(track: TrackEvidence, base: RefittedModel) -> Diagnosed:
    """Return all of the residual as a discrepancy: too few readings, of a noise that is not known, test nothing."""
    excess = float(np.mean(base.fit.residual**2))
    misfit = Misfit(1.0, excess, math.inf, 0.0, base.slopes, free_unknowns(track).tolist(), {})
    names = [parameter.name for parameter in track.model.parameters]
    *uncertainties, surface = misfit.uncertainty(track.model.parameters).tolist()
    row = dict(zip(names, uncertainties, strict=True))
    return Diagnosed(terms=row, surface=surface, table={"discrepancy": math.sqrt(excess)})


def _along_a_sweep(track: TrackEvidence) -> Diagnosed | None:
    """The tests of what an estimator that follows the material leaves along the way, and the reason by a stretch of it.

    Nothing is said of an estimator that looks for one value (`identifiability` does), nor of one that does not know of
    the sweep and fades, whose innovations are never white. One that is leaves a pattern of up to 1 % of its innovations
    where nothing is wrong.
    """
    follows = track.estimator.follows_changes and getattr(track.estimator, "sweep_speed", 0.0) > 0
    if not follows or not np.isfinite(track.kept.innovation).any():
        return None
    found = by_innovations(track)
    if found.p >= LEVEL or found.misfit < _OF_A_SWEEP:
        return misfit_table(found)
    course = make_course(track, track.kept.used)
    rows = np.flatnonzero(course.used)
    middle = course.time[rows[len(rows) // 2]]
    here = course.used & (np.abs(course.time - middle) < _STRETCH / 2)
    if np.count_nonzero(here) < ENOUGH:
        return misfit_table(found)
    local = replace(course, used=here)
    fit = refit(local, track.values, float(np.median(course.height[here])) + _DEEP)
    base = with_noise(track, local, fit)
    return explained(replace(track, values=fit.theta, surface=fit.surface), found, base)
