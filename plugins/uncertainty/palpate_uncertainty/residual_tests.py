"""Whether the residual that a fit reports is that of a right model: over time, depth, speed, and along alternatives."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, Samples, TrackEvidence
from palpate_kit.numerics.tip_travel import zero_phase_motion

from palpate_uncertainty.causes import cause_of
from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.discrepancy import FARTHEST, NEARLY, Explanation, Misfit
from palpate_uncertainty.model_alternatives import refit
from palpate_uncertainty.prediction import Prediction, predict_other_half
from palpate_uncertainty.refit import Course, make_course, zero_without_air
from palpate_uncertainty.residual_null import ForceNoise, ResidualNull, motion_noise
from palpate_uncertainty.residual_rows import FIXED, JudgedRows, slow_acceleration
from palpate_uncertainty.whiteness import oscillation

LEVEL = 1e-3  # of a record
_NOTHING = 10.0 * LEVEL  # a chance from which on a test says nothing
_ENOUGH = 100  # samples
_SHOWS = 4.0  # standard deviations by which an alternative of its typical size must show
_RANK = 1e-6  # of the largest variance, below which a direction does not count
_INDEPENDENT = 1e-4  # of the largest singular value, below which a direction of an alternative is rounding
_OUTLIER = 6.0  # standard deviations, beyond which a reading counts as an outlier, which is flagged as such


@dataclass(frozen=True)
class ResidualTests:
    """What a residual says of its model."""

    p: float  # of all tests together
    bins: Mapping[str, Explanation]  # by what they are over
    scores: Mapping[str, Explanation]  # by cause
    ratio: float  # rms of the residual over that of the null
    misfit: Misfit  # what is made of it where the tests fail
    prediction: Prediction | None = None

    @property
    def is_right(self) -> bool:
        """Whether nothing counts against the model."""
        return self.p >= LEVEL

    @property
    def unexplained(self) -> str:
        """What the pattern is over that no alternative explains; empty where one does."""
        explained = max((score.gain for score in self.scores.values()), default=0.0)
        name = max(self.bins, key=lambda name: self.bins[name].evidence, default="")
        return name if name and NEARLY * (self.bins[name].gain - self.bins[name].numbers) > explained else ""

    def table(self) -> dict[str, object]:
        """As in ``result.json``."""
        bins, scores = ({name: test.p for name, test in tests.items()} for tests in (self.bins, self.scores))
        return {
            "p": self.p, "bins": bins, "scores": scores, "left": self.unexplained, "ratio": self.ratio, "null": "noise",
            **({"prediction": self.prediction.table()} if self.prediction else {}),
        }  # fmt: skip


def residual_tests(track: TrackEvidence, contact: NDArray[np.bool_]) -> ResidualTests | None:
    """The tests of a fit; None where its residual is not known, or the noise is open.

    What is tested is the residual that the fit reports, and in the rest of the `contact` (n,) that of its model.
    """
    report, kept = track.report, track.kept
    rows = contact & ~_disturbed(track)
    if report is None or track.model.memory or np.count_nonzero(rows) < _ENOUGH:
        return None
    if not report.rss > 0 or not np.isfinite(track.values).all():
        return None
    course = make_course(track, rows)
    free = sum(unknown.free for unknown in report.unknowns.values())
    scale = math.sqrt(report.rss / max(report.samples - free, 1))
    own = -scale * kept.innovation  # measured less model
    residual = np.where(kept.used & np.isfinite(own), own, _left(track, course))[course.used]
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
    """The tests of a filter's model, fitted to the `contact` (n,); None where the noise is open.

    Innovations of a filter are not white where its model is right. Rate and acceleration are derived as by a fit.
    """
    kept = track.kept
    if track.model.memory or not np.isfinite(track.values).all():
        return None
    interval, always = np.diff(kept.time, prepend=kept.time[0]), np.ones(len(kept.time), bool)
    stamp = np.rint(kept.time * 1e9).astype(np.int64)
    samples = Samples(stamp, kept.time, interval, kept.force, kept.position, kept.velocity, always, always)
    motion = zero_phase_motion(samples, None)
    course = make_course(track, contact & ~_disturbed(track))
    outer = kept.force - (track.tip_mass or 0.0) * motion.acceleration
    course = replace(course, rate=motion.rate, force=outer)
    if np.count_nonzero(course.used) < _ENOUGH:
        return None
    fit = refit(course, track.values, track.surface)
    force = ForceNoise.of(track, fit.residual)
    if force is None:
        return None
    return _tests(replace(track, values=fit.theta, surface=fit.surface), course, fit.residual, force)


def oscillates(course: Course) -> bool:
    """Return True for a motion of one frequency, whose halves see the same depths and speeds."""
    return oscillation(course.time[course.used], course.height[course.used]) is not None


def _disturbed(track: TrackEvidence) -> NDArray[np.bool_]:
    """(n,) samples whose acceleration is derived over a hesitation of the arm."""
    hesitating = track.kept.hesitating
    if not hesitating.any():
        return hesitating
    width = len(motion_noise(track)[2][2])
    return np.asarray(np.convolve(hesitating, np.ones(width), "full")[width // 2 :][: len(hesitating)] > 0.5)


def _left(track: TrackEvidence, course: Course) -> Floats:
    """What a track's values leave of the force (n,) [N]."""
    inertia, zero = (track.tip_mass or 0.0) * slow_acceleration(course), zero_without_air(track)
    force = track.kept.force - inertia - (zero.value if zero else 0.0)
    return np.asarray(force - course.forces(track.values, track.surface))


def _tests(track: TrackEvidence, course: Course, residual: Floats, noise: ForceNoise) -> ResidualTests:
    rows = JudgedRows.of(track, course)
    height, speed, kernels = motion_noise(track)
    null = ResidualNull(noise, rows.by_depth, rows.by_rate, track.tip_mass or 0.0, height, speed, kernels)
    space = _Space.of(null.std, rows.jacobian, rows.free, [*rows.open()], [*rows.stated()])
    null = replace(null, stated=space.stated * space.std[:, None])
    in_contact = residual
    residual = space.beside(np.concatenate([residual, rows.air_force]) / space.std) * space.std
    limit = _OUTLIER * np.maximum(null.std, 1.4826 * float(np.median(np.abs(residual))))
    tested = _Tested(space, null, np.clip(residual, -limit, limit), len(track.values))
    bins = {name: tested.test(tested.along(columns)) for name, columns in rows.places()}
    patterns = [*rows.patterns()]
    shown = {
        cause: (columns, typical, found)
        for (cause, columns, typical), found in zip(patterns, tested.along_each(patterns), strict=True)
        if tested.shows(found, typical)
    }
    scores = {cause: tested.test(found, cause_of(cause).one_sided) for cause, (_, _, found) in shown.items()}
    directions = [
        found.sharp[:, 0] for cause, (*_, found) in shown.items() if scores[cause].numbers == len(found.sums) == 1
    ]
    count_of_all = len(bins) + len(scores)
    significant = [cause for cause in shown if scores[cause].p * count_of_all < LEVEL]
    for cause in significant:  # by itself: the same digits whatever else is tested
        columns, typical, _ = shown[cause]
        scores[cause] = tested.step(columns, typical, cause_of(cause).one_sided, rows.count)
    every = [test.p for test in (*bins.values(), *scores.values())]
    p = min(1.0, (len(bins) + _count(directions)) * min(every, default=1.0))
    inside = slice(rows.count)
    usual, size = (float(np.sqrt(np.mean(values[inside] ** 2))) for values in (null.std, tested.residual))
    explanations = {cause: scores[cause] for cause in significant if scores[cause].times < FARTHEST}
    misfit = Misfit(
        p, tested.excess(rows.count, explanations.values()), float(np.std(course.force[course.used])),
        max((test.gain for test in (*bins.values(), *scores.values())), default=0.0), rows.jacobian[inside],
        rows.free.tolist(), explanations,
    )  # fmt: skip
    prediction = predict_other_half(
        rows.jacobian[inside][:, rows.free], in_contact, rows.force[inside], usual**2, oscillates(course)
    )
    return ResidualTests(p, bins, scores, size / usual, misfit, prediction)


@dataclass(frozen=True)
class _Alternative:
    """Derivatives of an alternative, each of length 1 over the standard deviation, and a residual along them."""

    scaled: Floats  # (n, m)
    lengths: Floats  # (m,)
    sharp: Floats  # (n, m) in which they stand out most
    overlap: Floats  # (m, m) of these with what the fit leaves of the derivatives
    covariance: Floats  # (m, m) of the sums by noise
    sums: Floats  # (m,) of the residual

    def one(self, k: int) -> _Alternative:
        """One of several alternatives of one derivative each."""
        at = slice(k, k + 1)
        columns = self.scaled[:, at], self.lengths[at], self.sharp[:, at]
        return _Alternative(*columns, self.overlap[at, at], self.covariance[at, at], self.sums[at])


@dataclass(frozen=True)
class _Tested:
    """A residual that is tested along directions."""

    space: _Space
    null: ResidualNull
    residual: Floats  # (n,) [N]
    count: int  # of parameters

    def along(self, columns: Floats) -> _Alternative:
        """What the residual is along the derivatives (n, m) of an alternative, or of several of one each."""
        scaled = columns / self.space.std[:, None]
        lengths = np.maximum(np.linalg.norm(scaled, axis=0), 1e-300)
        scaled = scaled / lengths
        own = self.space.beside(scaled)
        sharp = self.space.sharpest(own)
        weights = sharp / self.space.std[:, None]
        covariance, sums = self.null.covariance(weights), weights.T @ self.residual
        return _Alternative(scaled, lengths, sharp, sharp.T @ own, covariance, sums)

    def along_each(self, patterns: list[tuple[str, Floats, float]]) -> Iterator[_Alternative]:
        """The same of every alternative; those of one derivative are worked out together."""
        single = [columns for _, columns, _ in patterns if columns.shape[1] == 1]
        together, places = self.along(np.column_stack(single)), count()
        for _, columns, _ in patterns:
            yield together.one(next(places)) if columns.shape[1] == 1 else self.along(columns)

    def shows(self, found: _Alternative, typical: float) -> bool:
        """Whether an alternative of a typical size would stand out by four standard deviations."""
        if math.isinf(typical):
            return True
        sizes = typical * found.lengths
        spread = math.sqrt(max(float(sizes @ found.covariance @ sizes), 1e-300))
        return float(sizes @ found.overlap @ sizes) >= _SHOWS * spread

    def test(self, found: _Alternative, one_sided: bool = False) -> Explanation:
        """The test along an alternative."""
        powers, axes = self._axes(found)
        freedom, value = axes.shape[1], axes.T @ found.sums
        gain = 0.0 if one_sided and found.sums[0] < 0 else float(np.sum(value**2 / powers))
        p = _tail(freedom, gain, self.null.force.readings) if freedom else 1.0
        return Explanation(gain, freedom, p, len(self.residual))

    def step(self, columns: Floats, typical: float, one_sided: bool, inside: int) -> Explanation:
        """The test along the derivatives (n, m) of an alternative, with one step to it; `inside`: rows in contact."""
        alternative = self.along(columns)
        test, axes = self.test(alternative, one_sided), self._axes(alternative)[1]
        sizes = np.linalg.lstsq(axes.T @ alternative.overlap, axes.T @ alternative.sums, rcond=_RANK)[0]
        moved = -self.space.taken_by(alternative.scaled @ sizes)[: self.count]
        times = float(np.max(np.abs(sizes) / alternative.lengths)) / typical
        return replace(test, shifts=moved, times=times, power=self._power(alternative, test, inside))

    def _power(self, alternative: _Alternative, test: Explanation, inside: int) -> float:
        """Mean square [N^2] in contact of the residual along an alternative, less what chance has there."""
        directions, sizes, _ = np.linalg.svd(self.space.beside(alternative.scaled), full_matrices=False)
        directions = directions[:, sizes > _INDEPENDENT * sizes[0]]
        along = directions @ (directions.T @ (self.residual / self.space.std)) * self.space.std
        beyond_chance = max(1.0 - test.numbers / test.gain, 0.0) if test.gain > 0 else 0.0
        return beyond_chance * float(np.mean(along[:inside] ** 2))

    def excess(self, inside: int, explanations: Iterable[Explanation]) -> float:
        """Mean square [N^2] in contact of what neither noise nor declared inputs within their uncertainty explain.

        At least that along the best alternative: a pattern far below the noise of single readings is seen there alone.
        """
        undeclared = self.space.sharpest(self.residual / self.space.std) * self.space.std
        noise = float(np.mean(self.null.std[:inside] ** 2))
        visible = float(np.mean(undeclared[:inside] ** 2)) - noise
        return max(visible, 0.0, *(explanation.power for explanation in explanations))

    @staticmethod
    def _axes(found: _Alternative) -> tuple[Floats, Floats]:
        """Variances (d,) of an alternative's independent sums, and their directions (m, d)."""
        powers, axes = np.linalg.eigh(found.covariance)
        there = powers > _RANK * max(float(powers[-1]), 1e-300)
        return powers[there], axes[:, there]


@dataclass(frozen=True)
class _Space:
    """Residuals over their standard deviation, and what the fit and open facts take of them."""

    std: Floats  # (n,) [N]
    basis: Floats  # (n, b) orthonormal
    fitted: Floats  # (n, f) what the fit takes
    free: NDArray[np.bool_]  # (k + 1,) parameters and surface that it determines
    stated: Floats  # (n, s) what each stated quantity takes in addition

    @classmethod
    def of(
        cls,
        std: Floats,
        jacobian: Floats,
        free: NDArray[np.bool_],
        open_facts: list[Floats],
        stated: list[Floats],
    ) -> _Space:
        fitted = jacobian[:, free]
        columns = np.column_stack([fitted, *open_facts]) / std[:, None]
        basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
        alone = cls(std, basis, fitted / std[:, None], free, np.zeros((len(std), 0)))
        return replace(alone, stated=np.column_stack([np.zeros(len(std)), *(alone.beside(s / std) for s in stated)]))

    def beside(self, values: Floats) -> Floats:
        """Values (n, ...) less what is taken of them."""
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    def taken_by(self, values: Floats) -> Floats:
        """Shifts (k + 1,) of parameters and surface by which a fit follows values (n,); none of what is fixed."""
        sizes = np.maximum(np.linalg.norm(self.fitted, axis=0), 1e-300)
        moved = np.zeros(len(self.free))
        moved[self.free] = np.linalg.lstsq(self.fitted / sizes, values, rcond=None)[0] / sizes
        return moved

    def sharpest(self, values: Floats) -> Floats:
        """Direction (n, ...) in which values stand out most from the noise and what is stated."""
        both = np.eye(self.stated.shape[1]) + self.stated.T @ self.stated
        return np.asarray(values - self.stated @ np.linalg.solve(both, self.stated.T @ values))


def _count(directions: list[Floats]) -> float:
    """How many tests along correlated directions (n,) amount to (Nyholt 2004)."""
    if len(directions) < 2:
        return float(len(directions))
    rows = np.array([direction / np.linalg.norm(direction) for direction in directions])
    powers = np.linalg.eigvalsh(rows @ rows.T)
    return 1.0 + (len(directions) - 1.0) * (1.0 - float(np.var(powers, ddof=1)) / len(directions))


def _tail(freedom: int, value: float, readings: int) -> float:
    """Chance of more than a chi square whose variance n readings determine: F with n - 1 degrees of freedom.

    F has the longer tail: where that of chi square says nothing, it is the answer, without the import of scipy.
    """
    if (chance := chance_of_more(freedom, value)) > _NOTHING:
        return chance
    from scipy.special import fdtrc

    return float(fdtrc(freedom, max(readings - 1, 1), value / freedom))
