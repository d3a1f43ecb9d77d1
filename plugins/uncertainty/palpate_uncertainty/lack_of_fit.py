"""Lack of fit: whether what a track leaves of its record is the noise of the channel, and what else it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from palpate import Condition, Diagnosed, Flag, TrackEvidence

from palpate_uncertainty.model_alternatives import refit
from palpate_uncertainty.refit import make_course, possible, sweeps
from palpate_uncertainty.refitted_model import (
    ENOUGH,
    SETTLED,
    RefittedModel,
    by_innovations,
    explained,
    judged_rows,
    misfit_sentence,
    misfit_table,
    refitted_model,
    with_noise,
)
from palpate_uncertainty.residual_null import air_readings
from palpate_uncertainty.residual_tests import LEVEL, ResidualTests, refit_tests, residual_tests

_IDENTIFIABLE = 10.0  # times one step to the alternative, beyond which a refit of it is not identifiable
_STRETCH = 4.0  # [s] of a sweep
_OF_A_SWEEP = 0.015  # of the variance of innovations; the most of 28 tracks of clean sweeps was 0.008
_UNTESTED = "the residual is noise alone, which was not tested"
_DEEP = 3e-3  # [m], where the surface is looked for first


def lack_of_fit(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Findings on all tracks; see docs/uncertainty.md."""
    known: dict[Any, RefittedModel] = {}
    found = {}
    for track in tracks:
        try:
            finding = _beside_open_noise(track, _judge(track, known))
        except (ValueError, ArithmeticError) as error:  # a model without a force at such numbers; the others are judged
            finding = Diagnosed((Flag("diagnosis-failed", f"lack-of-fit: {error}"),))
        if finding is not None:
            found[track.name] = finding
    return found


def _beside_open_noise(track: TrackEvidence, finding: Diagnosed | None) -> Diagnosed | None:
    """A finding, with the condition on the noise where no air shows that; None where nothing was tested and it does."""
    if track.ending is None or air_readings(track) is not None:
        return finding
    text = _UNTESTED if finding is None else "noise of the force as in its upper band"
    noise = Condition("noise", text, "record 0.2 s at rest in air first")
    return replace(finding or Diagnosed(), conditions=(noise,))


def _judge(track: TrackEvidence, known: dict[Any, RefittedModel]) -> Diagnosed | None:
    """By the residual along each alternative; by refits where the noise is open, or the model remembers."""
    if not possible(track):
        return None
    fitted = track.report is not None and bool(np.isfinite(track.kept.innovation).any())
    if not np.isfinite(track.kept.velocity).any():
        raise ValueError("no sample in contact has a known speed; is [alignment] gap below the interval of readings?")
    judged = judged_rows(track)
    if not make_course(track, judged).used.any():
        return None
    enough = np.count_nonzero(track.kept.used & ~track.kept.hesitating) >= ENOUGH
    if sweeps(track) and not fitted:
        return _along_a_sweep(track) if enough else None
    if fitted and getattr(track.estimator, "unloading", "following") == "ting":  # which no refit here does
        own = by_innovations(track)
        return explained(track, own, refitted_model(track, known)) if own.p < LEVEL else misfit_table(own)
    tests = (residual_tests if fitted else refit_tests)(track, judged)
    if tests is not None:
        return Diagnosed(table=tests.table(), settles=SETTLED) if tests.is_right else _named(track, tests, known)
    if not enough:
        return None
    base = refitted_model(track, known)
    found = base.test(base.fit.residual)
    if fitted and (own := by_innovations(track)).p < found.p:
        found = base.by_motion(own, float(np.var(base.fit.residual)))
    return explained(track, found, base) if min(found.p, base.p) < LEVEL else misfit_table(found)


def _named(track: TrackEvidence, own: ResidualTests, known: dict[Any, RefittedModel]) -> Diagnosed:
    """What a residual that is not that of a right model says: its causes, and by how much each value may be off.

    By one step to what explains at least half of it, and by a refit of that where it is identifiable; unknown where
    the residual is too large.
    """
    reasons = [cause.partition(" of ")[0] for cause in own.explaining()]
    far = refitted_model(track, known).shifts_to(reasons, track.values) if reasons else own.shifts
    shifts = np.where(far < _IDENTIFIABLE * own.shifts, np.maximum(far, own.shifts), own.shifts)
    terms = dict(zip((parameter.name for parameter in track.model.parameters), shifts.tolist(), strict=True))
    likely = f"; likely {' or '.join(own.causes)}" if own.causes else ""
    if own.left:
        likely += f"; no alternative explains all of its pattern over {own.left}"
    text = f"the residual is not the noise of the channel (p {max(own.p, 1e-99):.0e}){likely}"
    effects = dict.fromkeys(terms, math.inf) if own.floor else terms
    return Diagnosed((Flag("lack-of-fit", text, effects=effects),), terms, table=own.table())


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
    if base.test(fit.residual).p >= LEVEL:  # the stretch alone does not show what it is
        names = [parameter.name for parameter in track.model.parameters]
        flag = Flag(
            "lack-of-fit", misfit_sentence(found, [], False, found.null), effects=dict.fromkeys(names, math.inf)
        )
        return Diagnosed((flag,), {}, frozenset(names), misfit_table(found).table)
    return explained(replace(track, values=fit.theta, surface=fit.surface), found, base)
