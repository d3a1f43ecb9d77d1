"""A model fitted again to a record whose noise is open, or with a memory: what it leaves, and what explains that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from palpate import Diagnosed, Floats, TrackEvidence
from palpate_kit.numerics.force_limit import at_limit

from palpate_uncertainty import channel_noise
from palpate_uncertainty.channel_noise import WHITE, Null, null_of
from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.directed_scores import SUSPICIOUS, model_slopes, scores
from palpate_uncertainty.directed_tests import DirectedTest, directed_tests
from palpate_uncertainty.discrepancy import Explanation, Misfit, has_layer, judge_misfit
from palpate_uncertainty.model_alternatives import Refit, alternatives, refit
from palpate_uncertainty.prediction import Prediction, predict_other_half
from palpate_uncertainty.refit import Course, free_unknowns, make_course, moves_along
from palpate_uncertainty.residual_null import standstill_count
from palpate_uncertainty.score_tests import LEVEL
from palpate_uncertainty.whiteness import WhitenessTest, oscillation, whiteness_tests

ENOUGH = 300  # samples in contact, to test a refit on
_MAX_EXPLAINED_SHARE = 0.999  # of a variance, that may be a pattern; the rest is noise, over which a gain is counted
_MIN_DEPTH_SHARE = 0.05  # of the largest depth; nearer to the surface the slope of a viscous force has no bound
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
        """Return the tests of a residual (n,) [N] of the fitted samples, over time, depth, phase and from one to the
        next."""
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

    @cached_property
    def slopes(self) -> Floats:
        """Derivatives (n, k + 1) of the fitted samples' force by the parameters and the surface."""
        return model_slopes(self.course, self.fit)

    def prediction(self, free: NDArray[np.bool_], noise_variance: float) -> Prediction | None:
        """How well a half of the record predicts the other one, by what is `free` (k + 1,)."""
        force = self.course.forces(self.fit.theta, self.fit.surface)[self.course.used]
        return predict_other_half(
            self.slopes[:, free], self.fit.residual, force, noise_variance, self.frequency is not None
        )

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


def refitted_model(track: TrackEvidence) -> RefittedModel:
    """Return the model fitted to all samples in contact, whether the track used them or not.

    Of a fit that leaves a part of the contact out on purpose, or has unknowns besides the model's, what it used.
    """
    course = make_course(track, judged_rows(track))
    return with_noise(track, course, refit(course, track.values, track.surface))


def with_noise(track: TrackEvidence, course: Course, fit: Refit) -> RefittedModel:
    """Return a fit to a course, with the course's oscillation and the noise to test it against."""
    rhythm = oscillation(course.time[course.used], course.height[course.used])
    frequency, phase = rhythm or (None, None)
    return RefittedModel(course, fit, _null(track, fit.residual, phase), phase, frequency)


def judged_rows(track: TrackEvidence) -> NDArray[np.bool_]:
    """(n,) kept samples for which a track's model is to hold."""
    return _deep(track) if judges_all(track) else track.kept.used


def _deep(track: TrackEvidence) -> NDArray[np.bool_]:
    """(n,) kept samples that are not just below the surface, and all that the track used.

    What stands at the limit of the sensor does not measure the force; a track that used it is judged by it.
    """
    kept, depth = track.kept, track.surface - track.kept.position
    deep = (depth > _MIN_DEPTH_SHARE * np.nanmax(depth)) & ~at_limit(kept.force, kept.position, np.isfinite(kept.force))
    return np.asarray(deep | kept.used)


def judges_all(track: TrackEvidence) -> bool:
    """Return True if a track's model is to hold for all samples in contact."""
    names = {*(parameter.name for parameter in track.model.parameters), "surface"}
    unknowns = track.report.unknowns if track.report is not None else {}
    beside = any(unknown.free and name not in names for name, unknown in unknowns.items())
    return not beside and not moves_along(track) and getattr(track.estimator, "segment", "active") in _WHOLE


def left_by(track: TrackEvidence) -> Floats:
    """What the model, fitted again to a track's samples, leaves of the force (n,) [N]."""
    return refitted_model(track).fit.residual


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
    """Return the tests of what the estimator itself left."""
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
    """Return the row, and the note or finding, of a misfit that `found` shows in a refit or in what an estimator left.

    Without a noise that is known, the misfit is the share of the variance that has a pattern, and an alternative
    explains as much as its refit takes of the variance.
    """
    residual = base.fit.residual
    n, variance = len(residual), max(float(np.var(residual)), 1e-300)
    directed = [test.share for test in base.directed.values() if test.p * len(base.directed) < LEVEL]
    share = min(max(base.test(residual).misfit, found.misfit, *directed, 0.0), _MAX_EXPLAINED_SHARE)
    noise = variance * (1.0 - share)
    explanations = {}
    for other in base.others:
        gain = n * max(variance - float(np.var(other.residual)), 0.0) / noise
        shifts = np.max(np.abs(other.candidates - base.fit.theta), axis=0)
        if other.reason and gain > 0:
            chance = chance_of_more(max(other.extra, 1), gain)
            explanations[other.reason] = Explanation(gain, other.extra, chance, n, shifts)
    force = base.course.force[base.course.used]
    misfit = Misfit(
        min(found.p, base.p), variance * share, float(np.std(force)), n * share / (1.0 - share), base.slopes,
        free_unknowns(track).tolist(), explanations,
    )  # fmt: skip
    about = "" if base.null.source == "standstill" else "; no standstill gives the noise"
    prediction = base.prediction(free_unknowns(track), noise)
    table = dict(misfit_table(found).table) | {"directed": {name: test.p for name, test in base.directed.items()}}
    table |= {"prediction": prediction.table()} if prediction else {}
    return replace(judge_misfit(misfit, track.model.parameters, table, about, has_layer(track.model)), settles=SETTLED)
