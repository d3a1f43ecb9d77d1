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
from palpate_uncertainty.alternative_fit import Refit, refit
from palpate_uncertainty.channel_noise import WHITE, Null, null_of
from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.directed_scores import SUSPICIOUS, model_slopes, scores
from palpate_uncertainty.directed_tests import DirectedTest, directed_tests
from palpate_uncertainty.discrepancy import Explanation, Misfit, has_layer, judge_misfit
from palpate_uncertainty.force_noise import standstill_count
from palpate_uncertainty.model_alternatives import alternatives
from palpate_uncertainty.prediction import Prediction, predict_other_half
from palpate_uncertainty.refit import Course, free_unknowns, make_course, moves_along
from palpate_uncertainty.score_tests import LEVEL
from palpate_uncertainty.whiteness import PHASES, WhitenessTest, oscillation, whiteness_tests

MIN_REFIT_SAMPLES = 300  # in contact, to test a refit on
_MAX_EXPLAINED_SHARE = 0.999  # of a variance, that may be a pattern; the rest is noise, over which a gain is counted
_MIN_DEPTH_SHARE = 0.05  # of the largest depth; nearer to the surface the slope of a viscous force has no bound
_SMALLEST_VARIANCE = 1e-300  # in a quotient, in place of 0: near the smallest double
_WHOLE_SEGMENTS = ("active", "contact", "all")  # segments of a fit that leave no part of the contact out on purpose
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
        """Return the tests of a residual (n,) [N] of the fitted samples: memory, and means over time, depth, phase."""
        rows, course = self.course.used, self.course
        test = whiteness_tests(residual, course.runs[rows], -course.height[rows], self.phase, self.null)
        return self.by_motion(test, float(np.var(residual)))

    @cached_property
    def _alternatives(self) -> dict[str, Callable[[], Refit]]:
        return alternatives(self.course, self.fit, self.frequency)

    @cached_property
    def _refits(self) -> dict[str, Refit]:
        """Refits so far, by reason."""
        return {}

    def _refits_of(self, reasons: Sequence[str]) -> list[Refit]:
        for reason in reasons:
            if reason not in self._refits:
                self._refits[reason] = self._alternatives[reason]()
        return [self._refits[reason] for reason in reasons]

    @cached_property
    def slopes(self) -> Floats:
        """Derivatives (n, k + 1) of the fitted samples' force by the parameters and the surface."""
        return model_slopes(self.course, self.fit)

    def prediction(self, free: NDArray[np.bool_], noise_variance: float) -> Prediction | None:
        """Return the prediction of a half of the record by the other one, of the unknowns that are `free` (k + 1,)."""
        force = self.course.forces(self.fit.theta, self.fit.surface)[self.course.used]
        return predict_other_half(
            self.slopes[:, free], self.fit.residual, force, noise_variance, self.frequency is not None
        )

    @property
    def others(self) -> list[Refit]:
        """The refits of all alternatives."""
        return self._refits_of(list(self._alternatives))

    @cached_property
    def directed(self) -> dict[str, DirectedTest]:
        """By reason, the tests of what an alternative explains more than the noise of the motion makes."""
        return {} if self.course.model.memory else self._directed(self.others)

    @cached_property
    def p(self) -> float:
        """p of the directed tests together: the smallest, times their number (Holm 1979).

        The alternatives are refitted in the order of their scores, which need no refit. The search ends with 1 where
        the scores of all others are unsuspicious and the number of tests is too large for the smallest p so far.
        """
        if self.course.model.memory:
            return 1.0
        score_by_reason = scores(self.course, self.fit, self.null, self.frequency)
        motion_share = self.made_by_motion / max(float(np.var(self.fit.residual)), _SMALLEST_VARIANCE)
        tests: dict[str, DirectedTest] = {}
        smallest = 1.0
        for reason, score in sorted(score_by_reason.items(), key=lambda item: item[1].p):
            if not score.counts(motion_share):
                continue
            if score.p >= SUSPICIOUS and max(len(tests), 1) * smallest >= LEVEL:
                return 1.0
            tests |= self._directed(self._refits_of([reason]))
            smallest = min((1.0, *(test.p for test in tests.values())))
        return min(len(tests) * smallest, 1.0) if tests else 1.0

    def _directed(self, others: Sequence[Refit]) -> dict[str, DirectedTest]:
        runs, power = self.course.runs[self.course.used], float(np.var(self.fit.residual))
        tests = directed_tests(self.fit, others, runs, self.null)
        return {reason: test for reason, test in tests.items() if test.share * power > self.made_by_motion}

    def by_motion(self, test: WhitenessTest, power: float) -> WhitenessTest:
        """Return the test of values of a power [N^2], with p 1 where the noise of the motion makes such a pattern."""
        return replace(test, p=1.0) if test.misfit * power < self.made_by_motion else test

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
    frequency, phase = oscillation(course.time[course.used], course.height[course.used]) or (None, None)
    return RefittedModel(course, fit, _null(track, fit.residual, phase), phase, frequency)


def judged_rows(track: TrackEvidence) -> NDArray[np.bool_]:
    """Return the kept samples (n,) for which a track's model is to hold."""
    return _deep_rows(track) if judges_all(track) else track.kept.used


def _deep_rows(track: TrackEvidence) -> NDArray[np.bool_]:
    """Return the kept samples (n,) that are not just below the surface, and all that the track used.

    What stands at the limit of the sensor does not measure the force; a track that used it is judged by it.
    """
    kept, depth = track.kept, track.surface - track.kept.position
    deep = (depth > _MIN_DEPTH_SHARE * np.nanmax(depth)) & ~at_limit(kept.force, kept.position, np.isfinite(kept.force))
    return np.asarray(deep | kept.used)


def judges_all(track: TrackEvidence) -> bool:
    """Return True if a track's model is to hold for all samples in contact.

    Not of a fit with unknowns besides the model's parameters and the surface, or of a part of the contact, and not of a
    path along the surface.
    """
    names = {*(parameter.name for parameter in track.model.parameters), "surface"}
    unknowns = track.report.unknowns if track.report is not None else {}
    has_more_unknowns = any(unknown.free and name not in names for name, unknown in unknowns.items())
    return (
        not has_more_unknowns
        and not moves_along(track)
        and getattr(track.estimator, "segment", "active") in _WHOLE_SEGMENTS
    )


def left_by(track: TrackEvidence) -> Floats:
    """Return the residual (n,) [N] of the model that is fitted again to a track's samples."""
    return refitted_model(track).fit.residual


def standstill(track: TrackEvidence) -> Floats:
    """Return the force (n,) [N] before the tip began to move; empty where the record has none."""
    return track.air_force[: standstill_count(track.air_time, track.air_position)]


def _null(track: TrackEvidence, residual: Floats, phase: Floats | None) -> Null:
    """Return the noise at standstill; where none was recorded, the residual's own less its pattern over phase."""
    noise = standstill(track)
    if np.count_nonzero(np.isfinite(noise)) >= channel_noise.MIN_SAMPLES:
        return null_of(noise)
    if len(residual) < MIN_REFIT_SAMPLES:
        return WHITE
    without_pattern = residual.copy()
    if phase is not None:
        # Subtract the mean of each bin of the phase.
        bins = np.floor(phase / (2 * np.pi) * PHASES).astype(int) % PHASES
        numbers = np.maximum(np.bincount(bins, minlength=PHASES), 1)
        without_pattern -= (np.bincount(bins, weights=residual, minlength=PHASES) / numbers)[bins]
    return null_of(without_pattern, "residual")


def by_innovations(track: TrackEvidence) -> WhitenessTest:
    """Return the tests of the innovations of an estimator, or of the residuals that a fit reports."""
    kept = track.kept
    rows = kept.used & np.isfinite(kept.innovation) & np.isfinite(kept.position) & ~kept.hesitating
    height, innovation = kept.position[rows], kept.innovation[rows]
    _, phase = oscillation(kept.time[rows], height) or (None, None)
    return whiteness_tests(innovation, kept.runs[rows], -height, phase, _null(track, innovation, phase))


def misfit_table(test: WhitenessTest) -> Diagnosed:
    """Return the table of tests of whiteness that raise no flag, and the flags that they settle."""
    settled = SETTLED if test.p >= LEVEL else frozenset[str]()
    return Diagnosed(table={"p": test.p, "tests": dict(test.tests), "null": test.null}, settles=settled)


def explained(track: TrackEvidence, test: WhitenessTest, refitted: RefittedModel) -> Diagnosed:
    """Return the row, and the note or finding, of a misfit that a `test` shows in a refit or in innovations.

    The residual of the refit has n samples of variance v, a share s of which has a pattern: the largest share by a test
    of whiteness, or by a significant one along an alternative. The misfit is s v; the rest, (1 - s) v, is the variance
    of the noise, over which the pattern's sum of squares n s v is a chi square of n s/(1 - s). The judgement settles
    the flags in `SETTLED`, which say less of the same.
    """
    residual = refitted.fit.residual
    n, variance = len(residual), max(float(np.var(residual)), _SMALLEST_VARIANCE)
    # Tests along the alternatives, significant after Bonferroni's correction for their number.
    directed_tests_made = refitted.directed
    shares = [refitted.test(residual).misfit, test.misfit, 0.0]
    for directed_test in directed_tests_made.values():
        if directed_test.p * len(directed_tests_made) < LEVEL:
            shares.append(directed_test.share)
    share = min(max(shares), _MAX_EXPLAINED_SHARE)
    noise_variance = variance * (1.0 - share)
    is_free = free_unknowns(track)
    misfit = Misfit(
        p=min(test.p, refitted.p),
        excess=variance * share,
        variation=float(np.std(refitted.course.force[refitted.course.used])),
        pattern=n * share / (1.0 - share),
        jacobian=refitted.slopes,
        is_fitted=is_free.tolist(),
        explanations=_explanations(refitted, n, variance, noise_variance),
    )
    # A noise that no standstill shows is only named: the judgement is the same.
    remark = "" if refitted.null.source == "standstill" else "; no standstill gives the noise"
    table = dict(misfit_table(test).table)
    table["directed"] = {reason: directed_test.p for reason, directed_test in directed_tests_made.items()}
    prediction = refitted.prediction(is_free, noise_variance)
    if prediction is not None:
        table["prediction"] = prediction.table()
    finding = judge_misfit(misfit, track.model.parameters, table, remark, has_layer(track.model))
    return replace(finding, settles=SETTLED)


def _explanations(
    refitted: RefittedModel, count: int, variance: float, noise_variance: float
) -> dict[str, Explanation]:
    """Return, by reason, the alternatives whose refit lowers the residual's variance [N^2].

    The gain, a chi square of as many degrees of freedom as the alternative adds numbers, is the decrease of the sum of
    the `count` squares over the variance of the noise [N^2]. An alternative without numbers of its own counts as one.
    """
    explanations = {}
    for other in refitted.others:
        gain = count * max(variance - float(np.var(other.residual)), 0.0) / noise_variance
        # By the farthest of the values that the parameters may have under the alternative.
        shifts = np.max(np.abs(other.candidates - refitted.fit.theta), axis=0)
        if other.reason and gain > 0:
            chance = chance_of_more(max(other.extra, 1), gain)
            explanations[other.reason] = Explanation(
                gain=gain, numbers=other.extra, p=chance, samples=count, shifts=shifts
            )
    return explanations
