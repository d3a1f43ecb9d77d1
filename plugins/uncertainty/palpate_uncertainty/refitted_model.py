"""A model fitted again to a record whose noise is open, or with a memory: what it leaves, and what explains that."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Diagnosed, Flag, Floats, TrackEvidence
from palpate_kit.numerics.force_limit import at_limit

from palpate_uncertainty import channel_noise
from palpate_uncertainty.channel_noise import WHITE, Null, null_of
from palpate_uncertainty.directed_scores import SUSPICIOUS, scores
from palpate_uncertainty.directed_tests import DirectedTest, directed_tests, near_best
from palpate_uncertainty.model_alternatives import Refit, alternatives, refit
from palpate_uncertainty.refit import Course, make_course, sweeps
from palpate_uncertainty.residual_null import standstill_count
from palpate_uncertainty.residual_rows import FIXED
from palpate_uncertainty.residual_tests import LEVEL
from palpate_uncertainty.whiteness import WhitenessTest, oscillation, whiteness_tests

ENOUGH = 300  # samples
_LEFT = 0.02  # of the misfit's power; an alternative that leaves less has explained it
_FAINT = 0.01  # the same, of the variance of the noise
_DRIFTS = 1.5  # times the drift that is allowed, as one of the record is known to some half of it
_NAMED = 0.2  # the same, for a reason that is worth naming though it does not explain it all
_SHALLOW = 0.05  # of the largest depth; nearer to the surface the slope of a viscous force has no bound
_WHOLE = ("active", "contact", "all")  # segments of a fit that leave no part of the contact out on purpose
# What innovations and residuals say where those of the model itself are noise: the noise given to a filter is then
# judged by the distance of its estimate from least squares.
SETTLED = frozenset({"misfit", "correlated-residuals", "coloured-innovations", "inconsistent"})


@dataclass(frozen=True)
class RefittedModel:
    """A model fitted to samples of a track, and how it is tested."""

    course: Course
    fit: Refit
    null: Null
    phase: Floats | None  # (n,) [rad] of the fitted samples
    frequency: float | None  # [Hz] of the oscillation

    def test(self, residual: Floats) -> WhitenessTest:
        """The tests of a residual (n,) [N] of the fitted samples, over time, depth, phase and from one to the next."""
        rows, course = self.course.used, self.course
        found = whiteness_tests(
            residual, course.runs[rows], course.time[rows], -course.height[rows], self.phase, self.null
        )
        return self.by_motion(found, float(np.var(residual)))

    @cached_property
    def _alternatives(self) -> dict[str, Callable[[], Refit]]:
        return alternatives(self.course, self.fit, self.frequency)

    @cached_property
    def _refits(self) -> dict[str, Refit]:
        """Those of the alternatives that were asked for."""
        return {}

    def _refitted(self, reasons: Sequence[str]) -> list[Refit]:
        for reason in reasons:
            if reason not in self._refits:
                self._refits[reason] = self._alternatives[reason]()
        return [self._refits[reason] for reason in reasons]

    def shifts_to(self, reasons: Iterable[str], values: Floats) -> Floats:
        """How far (k,) values are from those of the refits that there are for some reasons.

        That of the model itself has everything free that a fit held fixed.
        """
        names = dict.fromkeys(reasons)
        found = self._refitted([reason for reason in names if reason in self._alternatives])
        found += [self.fit] if FIXED in names else []
        away = [np.zeros(len(values)), *(np.max(np.abs(other.candidates - values), axis=0) for other in found)]
        return np.asarray(np.max(away, axis=0))

    @property
    def others(self) -> list[Refit]:
        """What else the record may be."""
        return self._refitted(list(self._alternatives))

    @cached_property
    def directed(self) -> dict[str, DirectedTest]:
        """By reason, what it explains that the model does not; nothing that the noise of the motion makes."""
        return {} if self.course.model.memory else self._directed(self.others)

    @cached_property
    def p(self) -> float:
        """Of the directed tests as a family, those first that their scores leave in doubt; 1 once the family is too
        large for the least p so far, so that the others need no refit."""
        if self.course.model.memory:
            return 1.0
        by_score = scores(self.course, self.fit, self.null, self.frequency)
        beyond = self.made_by_motion / max(float(np.var(self.fit.residual)), 1e-300)
        tests: dict[str, DirectedTest] = {}
        least = 1.0
        for reason, score in sorted(by_score.items(), key=lambda item: item[1].p):
            if not score.counts(beyond):
                continue
            if score.p >= SUSPICIOUS and max(len(tests), 1) * least >= LEVEL:
                return 1.0
            tests |= self._directed(self._refitted([reason]))
            least = min((1.0, *(test.p for test in tests.values())))
        return min(len(tests) * least, 1.0) if tests else 1.0

    def _directed(self, others: Sequence[Refit]) -> dict[str, DirectedTest]:
        runs, power = self.course.runs[self.course.used], float(np.var(self.fit.residual))
        found = directed_tests(self.fit, others, runs, self.null)
        return {reason: test for reason, test in found.items() if test.share * power > self.made_by_motion}

    def by_motion(self, found: WhitenessTest, power: float) -> WhitenessTest:
        """Findings on residuals of this power [N^2]: nothing where the noise of the motion makes such a pattern."""
        return replace(found, p=1.0) if found.misfit * power < self.made_by_motion else found

    @cached_property
    def made_by_motion(self) -> float:
        """Mean square [N^2] of the force that the noise of the motion makes."""
        return self.course.motion_noise(self.fit.theta, self.fit.surface)


def refitted_model(track: TrackEvidence, known: dict[Any, RefittedModel]) -> RefittedModel:
    """The model fitted to all samples in contact, whether the track used them or not; once for all tracks of a model.

    Of a fit that leaves a part of the contact out on purpose, or has unknowns besides the model's, what it used.
    """
    used = judged_rows(track)
    key = id(track.model), int(np.count_nonzero(used)), float(track.kept.time[used][0])
    if key not in known:
        course = make_course(track, used)
        fit = refit(course, track.values, track.surface)
        known[key] = with_noise(track, course, fit)
    return known[key]


def with_noise(track: TrackEvidence, course: Course, fit: Refit) -> RefittedModel:
    """A fit to a course, with the course's oscillation and the noise to test it against."""
    rhythm = oscillation(course.time[course.used], course.height[course.used])
    frequency, phase = rhythm or (None, None)
    return RefittedModel(course, fit, _null(track, fit.residual, phase), phase, frequency)


def judged_rows(track: TrackEvidence) -> NDArray[np.bool_]:
    """(n,) kept samples for which a track's model is to hold."""
    return _deep(track) if _judges_all(track) else track.kept.used


def _deep(track: TrackEvidence) -> NDArray[np.bool_]:
    """(n,) kept samples that are not just below the surface, and all that the track used.

    What stands at the limit of the sensor does not measure the force; a track that used it is judged by it.
    """
    kept, depth = track.kept, track.surface - track.kept.position
    deep = (depth > _SHALLOW * np.nanmax(depth)) & ~at_limit(kept.force, np.isfinite(kept.force))
    return np.asarray(deep | kept.used)


def _judges_all(track: TrackEvidence) -> bool:
    """Whether a track's model is to hold for all samples in contact."""
    names = {*(parameter.name for parameter in track.model.parameters), "surface"}
    unknowns = track.report.unknowns if track.report is not None else {}
    beside = any(unknown.free and name not in names for name, unknown in unknowns.items())
    return not beside and not sweeps(track) and getattr(track.estimator, "segment", "active") in _WHOLE


def left_by(track: TrackEvidence) -> Floats:
    """What the model, fitted again to a track's samples, leaves of the force (n,) [N]."""
    return refitted_model(track, {}).fit.residual


def standstill(track: TrackEvidence) -> Floats:
    """Force (n,) [N] before the tip began to move; empty where the record has none."""
    return track.air_force[: standstill_count(track.air_time, track.air_position)]


def _null(track: TrackEvidence, residual: Floats, phase: Floats | None) -> Null:
    """Noise at standstill; where none was recorded, the residual's own less its pattern over phase."""
    noise = standstill(track)
    if np.count_nonzero(np.isfinite(noise)) >= channel_noise.ENOUGH:
        return null_of(noise)
    if len(residual) < ENOUGH:
        return WHITE
    rest = residual.copy()
    if phase is not None:
        bins = np.floor(phase / (2 * np.pi) * 32).astype(int) % 32
        number = np.maximum(np.bincount(bins, minlength=32), 1)
        rest -= (np.bincount(bins, weights=residual, minlength=32) / number)[bins]
    return null_of(rest, "residual")


def by_innovations(track: TrackEvidence) -> WhitenessTest:
    """The tests of what the estimator itself left."""
    kept = track.kept
    rows = kept.used & np.isfinite(kept.innovation) & np.isfinite(kept.position) & ~kept.hesitating
    time, height, values = kept.time[rows], kept.position[rows], kept.innovation[rows]
    rhythm = oscillation(time, height)
    phase = rhythm[1] if rhythm else None
    return whiteness_tests(values, kept.runs[rows], time, -height, phase, _null(track, values, phase))


def misfit_table(found: WhitenessTest) -> Diagnosed:
    """What tests of whiteness say where they raise no flag."""
    settled = SETTLED if found.p >= LEVEL else frozenset[str]()
    return Diagnosed(table={"p": found.p, "tests": dict(found.tests), "null": found.null}, settles=settled)


def explained(track: TrackEvidence, found: WhitenessTest, base: RefittedModel) -> Diagnosed:
    """The reason shown by the pattern, and by how much each parameter may be off for it.

    A drift of the sensor's zero that the alignment allows is not a reason for a doubt, and a row of the budget.
    """
    names = [parameter.name for parameter in track.model.parameters]
    first = base.test(base.fit.residual)
    others = _others(base, first)
    left = _left(others, first)
    removing = [other for other, test in others if _removes(test, first)]
    if first.p >= LEVEL and base.p < LEVEL:  # too faint for any test but one that knows where to look
        near = near_best(base.directed)
        removing += [other for other in base.others if other.reason in near]
    if slow := [other for other in removing if _is_allowed_drift(track, base, other)]:
        terms = dict(zip(names, _shifts(track, slow).tolist(), strict=True))
        return replace(misfit_table(found), terms=terms, settles=SETTLED)
    naming = [other for other, _ in others if left.get(other.reason, 1.0) < _NAMED]
    shifts = _shifts(track, removing or naming or [base.fit])
    if not removing:
        shifts = np.maximum(shifts, _by_size(base, first.misfit))
    named = dict.fromkeys(
        other.reason for other in removing or naming if other.reason
    )  # in one order where all leave 1
    reasons = sorted(named, key=lambda name: left.get(name, 1.0))
    effects = shifts / np.maximum(np.abs(track.values), 1e-300)
    table = dict(misfit_table(found).table) | {
        "directed": {reason: test.p for reason, test in base.directed.items()},
        "effect": dict(zip(names, (100.0 * effects).tolist(), strict=True)),  # per cent
        "reasons": reasons,
        "explained": bool(removing),
        "left": left,
        "alternatives": _values(names, [other for other, _ in others]),
    }
    text = misfit_sentence(replace(found, p=min(found.p, base.p)), reasons, bool(removing), base.null.source)
    terms = dict(zip(names, shifts.tolist(), strict=True))
    unknown = frozenset(name for name, shift in terms.items() if not np.isfinite(shift))
    known = {name: shift for name, shift in terms.items() if name not in unknown}
    # What stands against a measured noise and is not explained has no bound.
    hidden = not removing and base.null.source == "standstill"
    bounds = {name: math.inf if hidden or name in unknown else shift for name, shift in terms.items()}
    return Diagnosed((Flag("lack-of-fit", text, effects=bounds),), known, unknown, table)


def _is_allowed_drift(track: TrackEvidence, base: RefittedModel, other: Refit) -> bool:
    """Whether a refit is a drift of the force within what the alignment allows."""
    if other.reason != "drift" or not other.numbers or track.ending is None:
        return False
    tare = track.ending.report.tare
    drift = track.ending.settings.drift if tare is None or tare.air is None else tare.air.slope_std
    return abs(other.numbers[0]) <= _DRIFTS * drift * base.course.span


def _left(others: Sequence[tuple[Refit, WhitenessTest]], first: WhitenessTest) -> dict[str, float]:
    """What share of the misfit each reason leaves."""
    return {other.reason: _ratio(test.misfit, first.misfit) for other, test in others if other.reason}


def _others(base: RefittedModel, first: WhitenessTest) -> list[tuple[Refit, WhitenessTest]]:
    """What else the record may be, tested; the model as it is where that is right and the track is far from it."""
    if first.p >= LEVEL:
        return [(base.fit, first)]
    return [(other, base.test(other.residual)) for other in base.others]


def _shifts(track: TrackEvidence, others: Sequence[Refit]) -> Floats:
    """How far (k,) the parameters may be from those of some refits."""
    return np.asarray(np.max([np.max(np.abs(other.candidates - track.values), axis=0) for other in others], 0))


def _values(names: Sequence[str], others: Sequence[Refit]) -> dict[str, dict[str, list[float]]]:
    """Every value of each parameter by the reason that makes it."""
    named = [other for other in others if other.reason]
    return {other.reason: {name: other.candidates[:, i].tolist() for i, name in enumerate(names)} for other in named}


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else 1.0


def _removes(test: WhitenessTest, first: WhitenessTest) -> bool:
    """Whether an alternative takes the pattern away, which more than a p just beyond the level is needed for."""
    if test.misfit > _NAMED * first.misfit + test.chance:
        return first.p >= LEVEL
    return test.p >= LEVEL or test.misfit < max(_LEFT * first.misfit, _FAINT)


def misfit_sentence(found: WhitenessTest, reasons: list[str], is_explained: bool, null: str) -> str:
    """The sentence on residuals that failed the tests of whiteness: p value, likely reasons, what is unexplained."""
    level = f"p {found.p:.0e}" if found.p > 1e-99 else "p < 1e-99"
    likely = f"; likely {' or '.join(reasons)}" if reasons else ""
    unknown = "" if is_explained else "; no alternative explains all of it"
    if not is_explained and null != "standstill":
        unknown += ", and no standstill gives the noise"
    return f"the residual is not the noise of the channel ({level}){likely}{unknown}"


def _by_size(base: RefittedModel, misfit: float) -> Floats:
    """Shift (k,) of each parameter by a force as large as the pattern, along the parameter's own slope.

    The slope is what is left of it when the other parameters and the surface have taken their share: what a residual
    that a fit has left could have moved, had it not been at right angles to the fit.
    """
    course, fit = base.course.reduced(3000), base.fit
    columns = []
    for i, value in enumerate(fit.theta):
        step = np.zeros_like(fit.theta)
        step[i] = 1e-4 * (abs(value) or 1.0)
        columns.append((course.forces(fit.theta + step, fit.surface) - course.forces(fit.theta, fit.surface)) / step[i])
    columns.append((course.forces(fit.theta, fit.surface + 1e-6) - course.forces(fit.theta, fit.surface)) / 1e-6)
    slopes = np.column_stack(columns)
    size, shifts = float(np.std(base.fit.residual)) * float(np.sqrt(misfit)), []
    for i in range(len(fit.theta)):
        others = np.delete(slopes, i, axis=1)
        others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
        own = slopes[:, i] - others @ np.linalg.lstsq(others, slopes[:, i], rcond=None)[0]
        shifts.append(size / max(float(np.sqrt(np.mean(own**2))), 1e-300))
    return np.array(shifts)
