"""Whether the residual that a fit reports is that of a right model: over time, depth, speed, and along alternatives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, TrackEvidence
from palpate_kit.numerics.local_cubic import local_cubic

from palpate_uncertainty.refit import Course, make_course
from palpate_uncertainty.residual_null import ForceNoise, ResidualNull, motion_noise, slopes_of

LEVEL = 1e-3  # of a record
_ENOUGH = 100  # samples
_BINS = {"time": 24, "depth": 24, "speed": 12}
_DEEP = 0.04  # of the largest depth, above which a bin is not judged
_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0)  # [s] of what may relax
_SMALL = 0.5e-3  # [m] radius of a tip
_SHOWS = 4.0  # standard deviations by which an alternative of its typical size must show
_LOUD = 2.0  # times the rms of the null, from which on a residual is no good one
_MATTERS = 0.5  # of the uncertainty of an elastic parameter
_WIDE, _NARROW = 0.08, 11  # [s] and samples of the window of slow accelerations
_OUTLIER = 6.0  # standard deviations, beyond which a reading counts as an outlier, which is flagged as such


@dataclass(frozen=True)
class ScoreTest:
    """An alternative that is tested along its derivative, without a refit."""

    p: float
    shifts: Floats  # (k,) of the parameters, of one step to the alternative


@dataclass(frozen=True)
class ResidualTests:
    """What a fit's own residual says of its model."""

    p: float  # of all tests together
    bins: Mapping[str, float]  # p by what it is over
    scores: Mapping[str, ScoreTest]  # by cause
    ratio: float  # rms of the residual over that of the null
    by_size: Floats  # (k,) shifts by a force of the size of what is too much, along each parameter's own slope

    @property
    def is_right(self) -> bool:
        """Whether nothing speaks against the model."""
        return self.p >= LEVEL

    @property
    def causes(self) -> list[str]:
        """Alternatives that a test names, the clearest first; those within a factor of e^10 of the clearest."""
        count = len(self.scores) + len(self.bins)
        found = sorted(self.scores, key=lambda name: self.scores[name].p)
        least = self.scores[found[0]].p if found else 1.0
        return [n for n in found if self.scores[n].p * count < LEVEL and self.scores[n].p <= least * math.exp(10)]

    @property
    def shifts(self) -> Floats:
        """(k,) by how much the parameters may be off: by one step to the causes, and at least by the size of it all."""
        return np.asarray(np.max([self.by_size, *(np.abs(self.scores[name].shifts) for name in self.causes)], axis=0))

    def table(self) -> dict[str, object]:
        """As in ``result.json``."""
        scores = {name: score.p for name, score in self.scores.items()}
        return {"p": self.p, "bins": dict(self.bins), "scores": scores, "ratio": self.ratio, "null": "noise"}


def residual_tests(track: TrackEvidence, contact: NDArray[np.bool_]) -> ResidualTests | None:
    """The tests of a fit; None where its residual is not known, or the noise is open.

    What is tested is the residual that the fit reports, and in the rest of the `contact` (n,) that of its model.
    """
    report, kept = track.report, track.kept
    rows = contact & ~kept.hesitating
    if report is None or track.model.memory or np.count_nonzero(rows) < _ENOUGH:
        return None
    if not report.rss > 0 or not np.isfinite(track.values).all():
        return None
    force = ForceNoise.of(track)
    if force is None:
        return None
    course = make_course(track, rows)
    free = sum(unknown.free for unknown in report.unknowns.values())
    scale = math.sqrt(report.rss / max(report.samples - free, 1))
    own = -scale * kept.innovation  # measured less model
    rest = _left(track, course)
    return _tests(track, course, np.where(kept.used & np.isfinite(own), own, rest)[course.used], force)


def refit_tests(track: TrackEvidence, course: Course, theta: Floats, surface: float) -> ResidualTests | None:
    """The tests of a model that is fitted again to what a filter used; None where the noise is open."""
    force = ForceNoise.of(track)
    if force is None or track.model.memory or not np.isfinite(theta).all():
        return None
    at = replace(track, values=theta, surface=surface)
    return _tests(at, course, _left(at, course)[course.used], force)


def _left(track: TrackEvidence, course: Course) -> Floats:
    """What a track's values leave of the force (n,) [N]."""
    inertia = (track.tip_mass or 0.0) * _slow_acceleration(course)
    return np.asarray(track.kept.force - inertia - course.forces(track.values, track.surface))


def _tests(track: TrackEvidence, course: Course, residual: Floats, noise: ForceNoise) -> ResidualTests:
    force, jacobian, by_depth, by_rate = slopes_of(course, track.values, track.surface)
    height, speed, kernels = motion_noise(track)
    null = ResidualNull(noise, by_depth, by_rate, track.tip_mass or 0.0, height, speed, kernels)
    space = _Space.of(
        null.std,
        np.column_stack([jacobian, *_open(track, course, by_depth, by_rate)]),
        [*_stated(track, course, by_depth, by_rate)],
    )
    null = replace(null, stated=space.stated * space.std[:, None])
    residual = space.beside(residual / space.std) * space.std
    limit = _OUTLIER * np.maximum(null.std, 1.4826 * float(np.median(np.abs(residual))))
    residual = np.clip(residual, -limit, limit)
    bins = {
        name: _over(places, count, residual, null, noise.readings) for name, places, count in _places(track, course)
    }
    scores, directions = {}, []
    for cause, pattern, typical in _patterns(track, course, force, by_depth, by_rate):
        own = space.beside(np.nan_to_num(pattern) / space.std)
        direction = space.sharpest(own)
        square, weights = float(direction @ own), direction / space.std
        spread = math.sqrt(max(null.variance(weights), 1e-300))
        if typical * square < _SHOWS * spread:
            continue
        value = float(weights @ residual)
        moved = -value / square * space.taken_by(np.nan_to_num(pattern) / space.std)
        scores[cause] = ScoreTest(_tail(1, (value / spread) ** 2, noise.readings), moved[: len(track.values)])
        directions.append(direction / np.linalg.norm(direction))
    every = [*bins.values(), *(score.p for score in scores.values())]
    p = min(1.0, (len(bins) + _count(directions)) * min(every, default=1.0))
    ratio = float(np.sqrt(np.mean(residual**2))) / null.rms
    by_size = _by_size(jacobian, residual, null.rms)[: len(track.values)]
    return ResidualTests(p, bins, scores, ratio, by_size)


@dataclass(frozen=True)
class _Space:
    """Residuals over their standard deviation, beside what the fit and open facts take of them."""

    std: Floats  # (n,) [N]
    basis: Floats  # (n, b) orthonormal
    columns: Floats  # (n, b) that it is made of
    stated: Floats  # (n, s) of each stated quantity, beside that

    @classmethod
    def of(cls, std: Floats, taken: Floats, stated: list[Floats]) -> _Space:
        columns = taken / std[:, None]
        basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
        alone = cls(std, basis, columns, np.zeros((len(std), 0)))
        return replace(alone, stated=np.column_stack([np.zeros(len(std)), *(alone.beside(s / std) for s in stated)]))

    def beside(self, values: Floats) -> Floats:
        """Values (n,) less what is taken of them."""
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    def taken_by(self, values: Floats) -> Floats:
        """Shifts (b,) of what takes a part of values (n,)."""
        return np.asarray(np.linalg.lstsq(self.columns, values, rcond=None)[0])

    def sharpest(self, values: Floats) -> Floats:
        """Direction (n,) in which values stand out most from the noise and what is stated."""
        both = np.eye(self.stated.shape[1]) + self.stated.T @ self.stated
        return np.asarray(values - self.stated @ np.linalg.solve(both, self.stated.T @ values))


def _count(directions: list[Floats]) -> float:
    """How many tests along correlated directions amount to (Nyholt 2004)."""
    if len(directions) < 2:
        return float(len(directions))
    powers = np.linalg.eigvalsh(np.array(directions) @ np.array(directions).T)
    return 1.0 + (len(directions) - 1.0) * (1.0 - float(np.var(powers, ddof=1)) / len(directions))


def _stated(track: TrackEvidence, course: Course, by_depth: Floats, by_rate: Floats) -> Iterator[Floats]:
    """(n,) [N] of each stated quantity, one standard uncertainty of it."""
    end = track.ending
    if end is None:
        return
    rows = course.used
    change, acceleration = _slow(course, by_depth, by_rate)
    if (timing := end.settings.timing_uncertainty) is not None:
        yield timing * change
    if (tare := end.report.tare) is not None and tare.offset_std is not None:
        yield np.full(int(np.count_nonzero(rows)), tare.offset_std)
    if track.tip_mass:
        share = end.settings.tip_mass_uncertainty
        yield (0.05 * track.tip_mass if share is None else share) * acceleration
    radius = getattr(getattr(track.model, "indenter", None), "radius", _SMALL)
    usual = type(end.settings).model_fields["drift"].default  # of a robot's sensor
    if radius >= _SMALL or end.settings.drift != usual:
        yield end.settings.drift * (course.time[rows] - course.begin)


def _open(track: TrackEvidence, course: Course, by_depth: Floats, by_rate: Floats) -> Iterator[Floats]:
    """(n,) what facts that nobody has stated may add to the force: of these the residual says nothing."""
    end = track.ending
    if end is not None:
        change, acceleration = _slow(course, by_depth, by_rate)
        if end.settings.timing_uncertainty is None:
            yield change
        if end.settings.tip_mass is None:
            yield acceleration


def _places(track: TrackEvidence, course: Course) -> Iterator[tuple[str, Floats, int]]:
    """What the residual is averaged over: values (n,), NaN where they do not count, and how many bins."""
    depth = course.depth(track.surface)[course.used]
    deep = depth > _DEEP * float(np.max(depth))
    for name, values in (("time", course.time[course.used]), ("depth", depth), ("speed", course.rate[course.used])):
        yield name, np.where(deep, values, np.nan), _BINS[name]


def _over(values: Floats, count: int, residual: Floats, null: ResidualNull, readings: int) -> float:
    """p of the means over bins of equal numbers of samples."""
    rows = np.flatnonzero(np.isfinite(values))
    total, bins = 0.0, np.array_split(rows[np.argsort(values[rows], kind="stable")], count)
    if len(rows) < 2 * count:
        return 1.0
    for rows_of_bin in bins:
        weights = np.zeros(len(residual))
        weights[rows_of_bin] = 1.0 / len(rows_of_bin)
        total += float(weights @ residual) ** 2 / null.variance(weights)
    return _tail(count - 3, total, readings)


def _patterns(
    track: TrackEvidence, course: Course, force: Floats, by_depth: Floats, by_rate: Floats
) -> Iterator[tuple[str, Floats, float]]:
    """Cause, derivative (n,) of the force by an alternative, and the size of one that is typical."""
    rows, end = course.used, track.ending
    every = course.elastic(track.values, track.surface)[0]
    elastic, depth = every[rows], np.maximum(course.depth(track.surface)[rows], 1e-12)
    part = depth / float(np.max(depth))
    yield "wrong-tip", elastic * np.log(np.maximum(part, 1e-6)), 0.5
    yield "thickness", elastic * part, 0.5
    time = course.time[rows]
    yield "drift", (time - time[0]) / max(float(time[-1] - time[0]), 1e-9), 0.05 * float(np.max(np.abs(force)))
    yield "surface moved", by_depth * (time - time.mean()) / max(float(np.ptp(time)), 1e-9), 0.1 * float(np.max(depth))
    step = float(np.median(np.diff(course.time)))
    for tau in _TIMES:
        yield f"memory of {tau:g} s", _relaxing(every, step, tau)[rows], 0.3
    change, acceleration = _slow(course, by_depth, by_rate)
    if end is not None and end.settings.timing_uncertainty is not None:
        yield "timing", change, 5e-3
    if end is not None and end.settings.tip_mass is not None:
        yield "mass", acceleration, 0.1
    if end is not None and end.settings.series_stiffness is None:
        yield "compliance", by_depth * force + by_rate * change, 1.0 / 20e3
    back = course.rate[rows] < 0
    if back.any() and not back.all():
        yield "unloading", by_depth * back, 0.1 * float(np.max(depth))


def _slow(course: Course, by_depth: Floats, by_rate: Floats) -> tuple[Floats, Floats]:
    """Slope (n,) [N/s] of the force in time, and acceleration (n,) [m/s^2] of the depth, over a wide window.

    That of the fit has the same noise as the residual, which would look like a delay or a mass.
    """
    acceleration = _slow_acceleration(course)[course.used]
    return by_depth * course.rate[course.used] + by_rate * acceleration, acceleration


def _slow_acceleration(course: Course) -> Floats:
    """Acceleration (n,) [m/s^2] of the depth over a wide window."""
    step = float(np.median(np.diff(course.time)))
    width = min(max(round(_WIDE / step) // 2 * 2 + 1, _NARROW), (len(course.time) - 1) // 2 * 2 + 1)
    return local_cubic(course.rate, width, 1) / step


def _relaxing(elastic: Floats, step: float, tau: float) -> Floats:
    """The part (n,) of a force that dies away with a time constant [s]."""
    keep, found, left = math.exp(-step / tau), [], 0.0
    for change in np.diff(elastic, prepend=0.0).tolist():
        left = left * keep + change
        found.append(left)
    return np.array(found)


def _by_size(jacobian: Floats, residual: Floats, rms: float) -> Floats:
    """Shift (k,) of each unknown by a force as large as the residual is too large, along its own slope."""
    excess = math.sqrt(max(float(np.mean(residual**2)) - rms**2, (0.1 * rms) ** 2))
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    inverse = np.linalg.pinv((jacobian / size).T @ (jacobian / size), hermitian=True)
    own = size / np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    return np.asarray(excess * math.sqrt(len(residual)) / own)


def _tail(freedom: int, value: float, readings: int) -> float:
    """Chance of more than a chi square whose variance n readings tell: F with n - 1 degrees of freedom."""
    from scipy.special import fdtrc

    return float(fdtrc(freedom, max(readings - 1, 1), value / freedom))
