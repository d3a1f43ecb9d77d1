"""Tests that the residual of a fit is that of a right model: over time, depth, speed, and along alternatives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, Samples, TrackEvidence
from palpate_kit.numerics.tip_travel import zero_phase_motion

from palpate_uncertainty.alternative_fit import refit
from palpate_uncertainty.causes import cause_of
from palpate_uncertainty.channel_noise import MEDIAN_TO_STD
from palpate_uncertainty.discrepancy import FARTHEST, NEARLY, Explanation, Misfit
from palpate_uncertainty.force_noise import ForceNoise
from palpate_uncertainty.prediction import Prediction, predict_other_half
from palpate_uncertainty.refit import Course, make_course, zero_without_air
from palpate_uncertainty.residual_null import ResidualNull, motion_noise
from palpate_uncertainty.residual_rows import FIXED, JudgedRows, slow_acceleration
from palpate_uncertainty.score_tests import LEVEL, Directions, ResidualSpace, TestedResidual, effective_count
from palpate_uncertainty.whiteness import oscillation

MIN_RESIDUAL_SAMPLES = 100  # in contact, to test a residual (choice)
OUTLIER_SIGMAS = 6.0  # standard deviations (choice), beyond which a reading is an outlier, which is flagged as such


@dataclass(frozen=True)
class ResidualTests:
    """The tests of a residual, and the misfit where they fail."""

    p: float  # of all tests together
    bins: Mapping[str, Explanation]  # by what they are over
    scores: Mapping[str, Explanation]  # by cause
    ratio: float  # rms of the residual over that of the null
    misfit: Misfit  # for the judgement of failed tests
    prediction: Prediction | None = None

    @property
    def is_right(self) -> bool:
        """True if nothing counts against the model."""
        return self.p >= LEVEL

    @property
    def unexplained(self) -> str:
        """The variable of the pattern that no alternative explains; empty where one does."""
        explained = max((score.gain for score in self.scores.values()), default=0.0)
        name = max(self.bins, key=lambda axis: self.bins[axis].evidence, default="")
        return name if name and NEARLY * (self.bins[name].gain - self.bins[name].numbers) > explained else ""

    def table(self) -> dict[str, object]:
        """Return the tests as in ``result.json``."""
        over, scores = ({name: test.p for name, test in tests.items()} for tests in (self.bins, self.scores))
        return {
            "p": self.p, "tests": over, "scores": scores, "unexplained": self.unexplained, "ratio": self.ratio,
            "null": "noise",
            **({"prediction": self.prediction.table()} if self.prediction else {}),
        }  # fmt: skip


def residual_tests(track: TrackEvidence, contact: NDArray[np.bool_]) -> ResidualTests | None:
    """Return the tests of a fit; None where its residual is not known, or the noise is open.

    What is tested is the residual that the fit reports, and in the rest of the `contact` (n,) that of its model. Tests
    that fail are repeated with what the fit holds fixed set free.
    """
    report, kept = track.report, track.kept
    rows = contact & ~_disturbed(track)
    if report is None or track.model.memory or np.count_nonzero(rows) < MIN_RESIDUAL_SAMPLES:
        return None
    if not report.rss > 0 or not np.isfinite(track.values).all():
        return None
    course = make_course(track, rows)
    free = sum(unknown.free for unknown in report.unknowns.values())
    # A fit reports its residuals over their standard deviation, as model less measured force.
    scale = math.sqrt(report.rss / max(report.samples - free, 1))
    reported = -scale * kept.innovation  # measured less model
    residual = np.where(kept.used & np.isfinite(reported), reported, _residual(track, course))[course.used]
    force = ForceNoise.of(track, residual)
    if force is None:
        return None
    tests = _tests(track, course, residual, force)
    return tests if tests.is_right else _by_what_is_fixed(track, course, residual, force, tests)


def _by_what_is_fixed(
    track: TrackEvidence, course: Course, residual: Floats, force: ForceNoise, tests: ResidualTests
) -> ResidualTests:
    """Return failed tests with the fixed numbers as their only causes where the model is right once they are free."""
    fixed = {cause: test for cause, test in tests.misfit.explanations.items() if cause.startswith(FIXED)}
    if not fixed or track.ending is None:
        return tests
    free = replace(track, ending=replace(track.ending, held=frozenset()))
    if not _tests(free, course, residual, force).is_right:
        return tests
    return replace(tests, scores=fixed, misfit=replace(tests.misfit, explanations=fixed))


def refit_tests(track: TrackEvidence, contact: NDArray[np.bool_]) -> ResidualTests | None:
    """Return the tests of a filter's model, fitted to the `contact` (n,); None where the noise is open.

    Innovations of a filter are not white where its model is right. Rate and acceleration are derived as by a fit.
    """
    # The samples that the track has kept: time, force, position, velocity.
    kept = track.kept
    if track.model.memory or not np.isfinite(track.values).all():
        return None
    # Rate and acceleration without delay, and the force without the inertia.
    interval, always = np.diff(kept.time, prepend=kept.time[0]), np.ones(len(kept.time), bool)
    stamp = np.rint(kept.time * 1e9).astype(np.int64)  # [ns]
    samples = Samples(
        stamp=stamp,
        time=kept.time,
        interval=interval,
        force=kept.force,
        position=kept.position,
        velocity=kept.velocity,
        contact=always,
        active=always,
    )
    motion = zero_phase_motion(samples, None)  # over the window that it chooses itself
    course = make_course(track, contact & ~_disturbed(track))
    force_of_contact = kept.force - (track.tip_mass or 0.0) * motion.acceleration
    course = replace(course, rate=motion.rate, force=force_of_contact)
    if np.count_nonzero(course.used) < MIN_RESIDUAL_SAMPLES:
        return None
    # The model at the minimum of these samples, against the noise of the force.
    fit = refit(course, track.values, track.surface)
    force = ForceNoise.of(track, fit.residual)
    if force is None:
        return None
    return _tests(replace(track, values=fit.theta, surface=fit.surface), course, fit.residual, force)


def oscillates(course: Course) -> bool:
    """Return True for a motion of one frequency, whose halves see the same depths and speeds."""
    return oscillation(course.time[course.used], course.height[course.used]) is not None


def _disturbed(track: TrackEvidence) -> NDArray[np.bool_]:
    """Return True (n,) for the samples whose acceleration is derived over a hesitation of the arm."""
    hesitating = track.kept.hesitating
    if not hesitating.any():
        return hesitating
    width = len(motion_noise(track)[2][2])
    return np.asarray(np.convolve(hesitating, np.ones(width), "full")[width // 2 :][: len(hesitating)] > 0.5)


def _residual(track: TrackEvidence, course: Course) -> Floats:
    """Return the residual (n,) [N] of the force by a track's values."""
    inertia, zero = (track.tip_mass or 0.0) * slow_acceleration(course), zero_without_air(track)
    force = track.kept.force - inertia - (zero.value if zero else 0.0)
    return np.asarray(force - course.forces(track.values, track.surface))


def _tests(track: TrackEvidence, course: Course, residual: Floats, noise: ForceNoise) -> ResidualTests:
    """Return the tests of a residual (n,) [N] in contact, and of the air around it, against a noise of the force.

    `course` has the samples in contact; the rows that are tested are these, then those in air.
    """
    rows = JudgedRows.of(track, course)
    tested = _projected_residual(track, rows, residual, noise)
    # Over bins of time, depth, speed and air any pattern would show.
    bins = {name: tested.score(tested.along(columns)) for name, columns in rows.places()}
    alternatives = _test_alternatives(tested, rows, len(bins))
    scores = alternatives.scores

    # The chance of all tests together: single directions overlap, bins do not.
    all_tests = [*bins.values(), *scores.values()]
    count = len(bins) + effective_count(alternatives.singles)
    p = min(1.0, count * min((test.p for test in all_tests), default=1.0))

    # What is left without an explanation, in contact alone. One that needs 10 times its typical size explains nothing.
    explanations = {cause: scores[cause] for cause in alternatives.significant if scores[cause].times < FARTHEST}
    inside = slice(rows.count)
    misfit = Misfit(
        p=p,
        excess=tested.excess(rows.count, explanations.values()),
        variation=float(np.std(course.force[course.used])),
        pattern=max((test.gain for test in all_tests), default=0.0),
        jacobian=rows.jacobian[inside],
        is_fitted=rows.free.tolist(),
        explanations=explanations,
    )
    # The residual over that of the force's noise alone, and the forecast of one half by the other.
    null_rms = float(np.sqrt(np.mean(tested.null.std[inside] ** 2)))
    rms = float(np.sqrt(np.mean(tested.residual[inside] ** 2)))
    prediction = predict_other_half(
        rows.jacobian[inside][:, rows.free], residual, rows.force[inside], null_rms**2, oscillates(course)
    )
    return ResidualTests(p=p, bins=bins, scores=scores, ratio=rms / null_rms, misfit=misfit, prediction=prediction)


@dataclass(frozen=True)
class _AlternativeTests:
    """The tests of a residual along alternatives."""

    scores: Mapping[str, Explanation]  # by cause, of those that would show at their typical size
    significant: Sequence[str]  # causes
    singles: list[Floats]  # (n,) directions of those of one number


def _test_alternatives(tested: TestedResidual, rows: JudgedRows, bin_tests: int) -> _AlternativeTests:
    """Return the tests along each alternative that would show at its typical size, next to so many tests over bins.

    `rows` has, for the samples of the tested residual, the derivatives of the force by each alternative.
    """
    patterns = [*rows.patterns()]
    visible: dict[str, tuple[Floats, float, Directions]] = {}
    for (cause, columns, typical), directions in zip(patterns, tested.along_each(patterns), strict=True):
        if tested.shows(directions, typical):
            visible[cause] = (columns, typical, directions)
    scores = {}
    for cause, (_, _, directions) in visible.items():
        scores[cause] = tested.score(directions, cause_of(cause).one_sided)

    # One Gauss-Newton step to those that are significant, each by itself: the same digits whatever else is tested.
    count = bin_tests + len(scores)
    significant = [cause for cause in visible if scores[cause].p * count < LEVEL]
    for cause in significant:
        columns, typical, _ = visible[cause]
        scores[cause] = tested.step(columns, typical, cause_of(cause).one_sided, rows.count)
    # The directions of those of one number; their correlation says how many independent tests they are.
    singles = []
    for cause, (_, _, directions) in visible.items():
        if scores[cause].numbers == len(directions.sums) == 1:
            singles.append(directions.sharp[:, 0])
    return _AlternativeTests(scores, significant, singles)


def _projected_residual(track: TrackEvidence, rows: JudgedRows, residual: Floats, noise: ForceNoise) -> TestedResidual:
    """Return the residual without what the fit and open facts take of it, in contact and in air; outliers clipped.

    Its variance where the model is right joins the `noise` of the force, that of heights and speeds, and the errors of
    stated quantities.
    """
    height, speed, kernels = motion_noise(track)
    null = ResidualNull(
        force=noise,
        by_depth=rows.by_depth,
        by_rate=rows.by_rate,
        mass=track.tip_mass or 0.0,
        height=height,
        speed=speed,
        kernels=kernels,
    )
    space = ResidualSpace.of(null.std, rows.jacobian, rows.free, [*rows.open()], [*rows.stated()])
    null = replace(null, stated=space.stated * space.std[:, None])
    projected = space.beside(np.concatenate([residual, rows.air_force]) / space.std) * space.std
    scatter = MEDIAN_TO_STD * float(np.median(np.abs(projected)))
    limit = OUTLIER_SIGMAS * np.maximum(null.std, scatter)
    return TestedResidual(space, null, np.clip(projected, -limit, limit), len(track.values))
