"""Lack of fit: the test that the residual of a model on a record is the noise of its channel, and causes if not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from palpate import Condition, Diagnosed, Flag, TrackEvidence
from palpate_engine import remedy_of

from palpate_uncertainty.alternative_fit import refit
from palpate_uncertainty.discrepancy import Misfit, has_layer, judge_misfit
from palpate_uncertainty.force_noise import air_readings, rounding_noise
from palpate_uncertainty.refit import Course, free_unknowns, make_course, moves_along, possible
from palpate_uncertainty.refitted_model import (
    MIN_REFIT_SAMPLES,
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
from palpate_uncertainty.residual_tests import ResidualTests, refit_tests, residual_tests
from palpate_uncertainty.score_tests import LEVEL

_STRETCH_DURATION = 4.0  # [s] in the middle of a sweep, refitted for the cause of its misfit, a choice (decision 0110)
_SWEEP_MISFIT = 0.015  # of the variance of innovations; at most 0.010 of 68 tracks of clean sweeps (decision 0110)
_INITIAL_DEPTH = 3e-3  # [m] of the middle of the stretch, from which the search for its surface starts, a choice
_UNTESTED = "the residual is noise alone, which was not tested"


def lack_of_fit(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the findings on all tracks; see docs/verdict.md.

    A judgement is of model, record and rig: all tracks of a model that is to hold for the whole record share one, of
    the fit where there is one. A fit of a part of the record, with unknowns of its own, and a sweep are judged alone.
    """
    judgements: dict[int, Diagnosed] = {}
    findings = {}
    # Fits first, so that their judgement is shared by the filters of the same model.
    for track in sorted(tracks, key=_is_fit, reverse=True):
        key = id(track.model) if judges_all(track) else id(track)  # tracks of one model have the same object
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
    """Return the judgement of a track by the way that its record permits; None where none does.

    A sweep is judged by its innovations, and a fit of Ting's unloading by its residual, since no refit has that law.
    All others are tested along each alternative (`residual_tests`), for which the noise of the force must be known and
    the model have no memory; else model and alternatives are fitted again and compared. Raises ValueError where no
    sample has a known speed.
    """
    if not possible(track):
        return None
    if not np.isfinite(track.kept.velocity).any():
        raise ValueError("no sample in contact has a known speed; is [alignment] gap below the interval of readings?")
    contact_rows = judged_rows(track)
    course = make_course(track, contact_rows)
    if not course.used.any():
        return None
    # The way of the judgement, by motion, estimator and noise.
    is_fit = _is_fit(track)
    has_enough_samples = np.count_nonzero(track.kept.used & ~track.kept.hesitating) >= MIN_REFIT_SAMPLES
    if moves_along(track) and not is_fit:
        return _judge_sweep(track, course) if has_enough_samples else None
    if is_fit and getattr(track.estimator, "unloading", "following") == "ting":
        test = by_innovations(track)
        return explained(track, test, refitted_model(track)) if test.p < LEVEL else misfit_table(test)
    tests = (residual_tests if is_fit else refit_tests)(track, contact_rows)
    if tests is not None:
        return _residual_judgement(track, tests)
    base = refitted_model(track)
    return _refit_judgement(track, base) if has_enough_samples else _untested(track, base)


def _residual_judgement(track: TrackEvidence, tests: ResidualTests) -> Diagnosed:
    """Return what the tests along each alternative say of a track: the misfit with its causes, where they fail."""
    if tests.is_right:
        return Diagnosed(table=tests.table(), settles=SETTLED)
    remark = f"; no alternative explains all of its pattern over {tests.unexplained}" if tests.unexplained else ""
    finding = judge_misfit(tests.misfit, track.model.parameters, tests.table(), remark, has_layer(track.model))
    return replace(finding, settles=SETTLED)


def _refit_judgement(track: TrackEvidence, base: RefittedModel) -> Diagnosed:
    """Return the judgement by the model fitted again, `base`, and for a fit by its own residual if that has less p."""
    variance = float(np.var(base.fit.residual))
    test = base.test(base.fit.residual)
    if _is_fit(track):
        innovation_test = by_innovations(track)
        if innovation_test.p < test.p:
            test = base.by_motion(innovation_test, variance)
    if min(test.p, base.p) < LEVEL:
        return explained(track, test, base)
    # No test sees more than noise in the residual.
    finding = misfit_table(test)
    prediction = base.prediction(free_unknowns(track), variance)
    if prediction is None:
        return finding
    return replace(finding, table=dict(finding.table) | {"prediction": prediction.table()})


def _untested(track: TrackEvidence, base: RefittedModel) -> Diagnosed:
    """Return all of the residual as a discrepancy: too few readings, of a noise that is not known, test nothing."""
    excess = float(np.mean(base.fit.residual**2))
    misfit = Misfit(
        p=1.0, excess=excess, variation=math.inf, pattern=0.0, jacobian=base.slopes,
        is_fitted=free_unknowns(track).tolist(), explanations={},
    )  # fmt: skip
    names = [parameter.name for parameter in track.model.parameters]
    *uncertainties, surface = misfit.uncertainty(track.model.parameters).tolist()
    terms = dict(zip(names, uncertainties, strict=True))
    return Diagnosed(terms=terms, surface=surface, table={"discrepancy": math.sqrt(excess)})


def _judge_sweep(track: TrackEvidence, course: Course) -> Diagnosed | None:
    """Return the tests of an estimator's innovations along a sweep, and the causes of a misfit by a refit of a stretch.

    `course` has the samples that the track used, at least one. None for an estimator that looks for one value
    (`identifiability` judges it), for one with adaptive fading, whose innovations are never white since it does not
    know of the sweep, and for one that reports no innovations. One that knows of the sweep leaves a pattern of up to
    1 % of the variance of its innovations where nothing is wrong (measured, see `_SWEEP_MISFIT`).
    """
    knows_of_sweep = track.estimator.follows_changes and getattr(track.estimator, "sweep_speed", 0.0) > 0
    if not knows_of_sweep or not np.isfinite(track.kept.innovation).any():
        return None
    test = by_innovations(track)
    if test.p >= LEVEL or test.misfit < _SWEEP_MISFIT:
        return misfit_table(test)
    # The causes are sought on a stretch in the middle, short enough for one value to hold.
    rows = np.flatnonzero(course.used)
    middle_time = course.time[rows[len(rows) // 2]]
    in_stretch = course.used & (np.abs(course.time - middle_time) < _STRETCH_DURATION / 2)
    if np.count_nonzero(in_stretch) < MIN_REFIT_SAMPLES:
        return misfit_table(test)
    stretch = replace(course, used=in_stretch)
    initial_surface = float(np.median(course.height[in_stretch])) + _INITIAL_DEPTH
    fit = refit(stretch, track.values, initial_surface)
    refitted = with_noise(track, stretch, fit)
    return explained(replace(track, values=fit.theta, surface=fit.surface), test, refitted)
