"""The record of a palpation as the refits of the lack-of-fit test see it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from palpate import ContactModel, Floats, SampleStore, TrackEvidence, Unknown, contact_force, force_over_time
from palpate_kit.budget.force_sensitivity import free_columns
from palpate_kit.numerics.local_cubic import cubic_weights, local_cubic

from palpate_uncertainty.channel_noise import Runs

# Choices, unless a law is named.
_SLOPE_SAMPLES = 5  # velocity is differenced over so many samples to either side
_DEPTH_STEP, _RATE_STEP = 1e-6, 1e-5  # [m], [m/s]; for slopes
APART = 1e-3  # [m] sideways, from which on it is a sweep
IN_AIR = 0.05  # of the largest depth, above the surface by which a sample is in air
_WINDOWS = (5, 9, 15, 25, 41)  # samples of the local cubic for height and rate
_MAX_BEND_SHARE = 0.1  # of the noise that smoothing may take from the signal
_MEAN_VARIANCES = 2.0  # times the variance of a mean of white noise over the window, up to which a motion is straight
_MAX_CACHED_FORCES = 8  # that a course keeps
_CORNER_DEVIATIONS = 4.0  # standard deviations of a mean over the window
_MOTION_NOISE_SAMPLES = 500  # at which the noise of the motion is taken: a choice of time
_MIN_SPAN = 1e-9  # [s] of a course, so that a share of it is finite
_THIRD_DIFFERENCE_VARIANCE = 20.0  # variance of third differences of white noise of variance 1: 1 + 9 + 9 + 1

_T = TypeVar("_T")


@dataclass(frozen=True)
class Course:
    """Samples in contact, in their order, and those among them that are fitted."""

    model: ContactModel
    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N] without the inertia of the tip, and less a zero that was found without air
    height: Floats  # (n,) [m]
    rate: Floats  # (n,) [m/s] of the depth
    acceleration: Floats  # (n,) [m/s^2] of the depth
    runs: Runs  # (n,) number of the stretch without a gap
    used: NDArray[np.bool_]  # (n,) fitted
    begin: float  # [s] of the first sample
    span: float  # [s] to the last
    from_air: bool  # True if the record begins before the contact
    noise: tuple[float, float]  # [m], [m/s] standard deviations of the noise that remains in the smoothed motion

    def reduced(self, max_samples: int) -> Course:
        """Return at most so many of the fitted samples, evenly spread: for a force that does not depend on the past."""
        rows = np.flatnonzero(self.used)
        rows = rows[:: max(1, -(-len(rows) // max_samples))]
        names = ("time", "force", "height", "rate", "acceleration", "runs", "used")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def depth(self, surface: float) -> Floats:
        """Return the depth (n,) [m] below a surface [m]; negative above."""
        return np.asarray(surface - self.height)

    def forces(self, theta: Floats, surface: float) -> Floats:
        """Return the contact force (n,) [N] of the model."""
        return self._once("forces", theta, surface, lambda: self._force(self.depth(surface), self.rate, theta))

    def yielded(self, theta: Floats, surface: float, way: Floats, speed: Floats) -> Floats:
        """Return the contact force (n,) [N] if the mount takes a way (n,) [m] of the depth, and its rate (n,) [m/s]."""
        return self._force(self.depth(surface) - way, self.rate - speed, theta)

    def _force(self, depth: Floats, rate: Floats, theta: Floats) -> Floats:
        if self.model.memory:
            return np.asarray(force_over_time(self.model, self.time, depth, rate, theta.tolist()))
        return np.asarray(contact_force(self.model, depth, rate, theta.tolist()), dtype=float) + 0.0 * depth

    def elastic(self, theta: Floats, surface: float) -> tuple[Floats, Floats]:
        """Return the force (n,) [N] at the same depths at rest, and its slope (n,) [N/m]; for models without memory."""

        def at_rest() -> tuple[Floats, Floats]:
            depth, still = np.maximum(self.depth(surface), 0.0), np.zeros(len(self.time))
            low = self._force(depth, still, theta)
            return low, (self._force(depth + _DEPTH_STEP, still, theta) - low) / _DEPTH_STEP

        return self._once("elastic", theta, surface, at_rest)

    @cached_property
    def _latest(self) -> dict[Any, Any]:
        return {}

    def _once(self, quantity: str, theta: Floats, surface: float, evaluate: Callable[[], _T]) -> _T:
        """Return a quantity, evaluated once for the same numbers, of which a search varies one at a time."""
        key = quantity, theta.tobytes(), surface
        if key not in self._latest:
            if len(self._latest) >= _MAX_CACHED_FORCES:
                del self._latest[next(iter(self._latest))]
            self._latest[key] = evaluate()
        values: _T = self._latest[key]
        return values

    def motion_noise(self, theta: Floats, surface: float) -> float:
        """Return the mean square [N^2] of the force by the noise of the smoothed motion: slow, and no lack of fit."""
        small = self.reduced(_MOTION_NOISE_SAMPLES) if not self.model.memory else self
        depth, force = small.depth(surface), small.forces(theta, surface)
        by_depth = (small._force(depth + _DEPTH_STEP, small.rate, theta) - force) / _DEPTH_STEP
        by_rate = (small._force(depth, small.rate + _RATE_STEP, theta) - force) / _RATE_STEP
        return float(np.mean((by_depth * self.noise[0]) ** 2 + (by_rate * self.noise[1]) ** 2))

    def change(self, theta: Floats, surface: float) -> Floats:
        """Return the slope in time (n,) [N/s] of the model's force."""
        return self._once("change", theta, surface, lambda: self._change(theta, surface))

    def _change(self, theta: Floats, surface: float) -> Floats:
        depth, force = self.depth(surface), self.forces(theta, surface)
        if self.model.memory:
            return np.asarray(np.gradient(force, self.time))
        by_depth = (self._force(depth + _DEPTH_STEP, self.rate, theta) - force) / _DEPTH_STEP
        by_rate = (self._force(depth, self.rate + _RATE_STEP, theta) - force) / _RATE_STEP
        return np.asarray(by_depth * self.rate + by_rate * self.acceleration)


def moves_along(track: TrackEvidence) -> bool:
    """Return True where the tip went along the surface, so that one value is not valid for the whole record."""
    place = track.kept.lateral[track.kept.used]
    place = place[np.isfinite(place).all(axis=1)]
    return len(place) > 0 and bool(np.max(np.ptp(place, axis=0)) > APART)


def sweeps(track: TrackEvidence) -> bool:
    """Return True where no value holds for the whole record: of a path along the surface, or as the filter takes it."""
    return track.estimator.follows_changes or moves_along(track)


def free_unknowns(track: TrackEvidence) -> NDArray[np.bool_]:
    """Return True (k + 1,) for the parameters and the surface that a track determines: all that are not held fixed."""
    return free_columns(track.model, track.ending.held if track.ending is not None else ())


def depths_in_contact(track: TrackEvidence) -> Floats:
    """Return the depths (n,) [m], by its surface, of the samples that a track used: those that are positive."""
    depth = track.surface - track.kept.position[track.kept.used]
    return np.asarray(depth[np.isfinite(depth) & (depth > 0)])


def zero_without_air(track: TrackEvidence) -> Unknown | None:
    """Return the zero of the force where a fit found it from contact alone, without samples in air; None elsewhere."""
    zero = track.report.unknowns.get("bias") if track.report is not None else None
    depth = track.surface - track.kept.position[track.kept.used]
    if zero is None or not zero.free or not len(depth):
        return None
    return zero if float(np.min(depth)) > -IN_AIR * float(np.max(depth)) else None


def possible(track: TrackEvidence) -> bool:
    """Return True if all of a track's numbers are possible, so that its model has a force."""
    pairs = zip(track.model.parameters, track.values.tolist(), strict=True)
    return all(parameter.lowest_estimate <= value <= parameter.upper for parameter, value in pairs)


def make_course(track: TrackEvidence, used: NDArray[np.bool_]) -> Course:
    """Return the course of a track's kept samples; those at the ends of runs and in hesitations are not fitted."""
    kept, motion = track.kept, _motion(track.kept)
    # The contact force: without the tip's inertia, and the zero that a record without air has as an unknown.
    zero = zero_without_air(track)
    force = kept.force - (track.tip_mass or 0.0) * np.nan_to_num(motion.acceleration) - (zero.value if zero else 0.0)
    first, last = (float(kept.time[0]), float(kept.time[-1])) if len(kept.time) else (0.0, 0.0)
    return Course(
        model=track.model,
        time=kept.time,
        force=force,
        height=motion.height,
        rate=motion.rate,
        acceleration=motion.smooth_acceleration,
        runs=kept.runs,
        used=used & motion.is_usable & np.isfinite(force),
        begin=first,
        span=max(last - first, _MIN_SPAN),
        from_air=len(track.air_time) > 0,
        noise=motion.noise,
    )


class _SmoothMotion(NamedTuple):
    """The motion of kept samples, and where it is known well enough to be fitted."""

    acceleration: Floats  # (n,) [m/s^2] of the depth, over some samples; NaN at the ends of runs
    height: Floats  # (n,) [m]
    rate: Floats  # (n,) [m/s] of the depth
    smooth_acceleration: Floats  # (n,) [m/s^2] of the depth
    is_usable: NDArray[np.bool_]  # (n,)
    noise: tuple[float, float]  # [m], [m/s] that remains after smoothing


@lru_cache(maxsize=2)  # several diagnoses of a track ask
def _motion(kept: SampleStore) -> _SmoothMotion:
    """Return the smoothed motion of kept samples, and True for those that are neither at an end nor at a corner.

    `runs` numbers the stretches without a gap; differences and windows never reach beyond one.
    """
    runs, acceleration = kept.runs, np.full(len(kept.time), np.nan)
    k = _SLOPE_SAMPLES
    if len(kept.time) > 2 * k:
        change = kept.velocity[: -2 * k] - kept.velocity[2 * k :]  # depth counts down, height up
        whole = (runs[2 * k :] == runs[: -2 * k]) & (kept.time[2 * k :] > kept.time[: -2 * k])
        span = np.where(whole, kept.time[2 * k :] - kept.time[: -2 * k], np.nan)
        acceleration[k:-k] = change / span
    # `corners` and `jerks` are the samples near a sudden change of the height's, and of the rate's slope.
    height, height_noise, corners = _quiet(kept.position, runs)
    rate, rate_noise, jerks = _quiet(-kept.velocity, runs)
    # A slope of its own, of the smoothed rate: with the noise of the acceleration that gives the inertia, the force
    # would look late.
    smooth = _slopes(rate, kept.time, runs)
    is_usable = np.isfinite(kept.position) & np.isfinite(kept.velocity) & np.isfinite(acceleration)
    is_usable &= ~kept.hesitating & ~corners & ~jerks
    noise = height_noise, rate_noise
    return _SmoothMotion(
        acceleration=acceleration,
        height=height,
        rate=np.nan_to_num(rate),
        smooth_acceleration=np.nan_to_num(smooth),
        is_usable=is_usable,
        noise=noise,
    )


def _slopes(values: Floats, time: Floats, runs: Runs) -> Floats:
    """Return the slopes (n,) in time within the runs; 0 within a run of one sample."""
    pieces = np.split(np.arange(len(values)), np.flatnonzero(np.diff(runs)) + 1)
    slopes = [
        np.gradient(values[p], time[p]) if len(p) > 1 and np.all(np.diff(time[p]) > 0) else np.zeros(len(p))
        for p in pieces
    ]
    return np.concatenate(slopes) if len(values) else values


def _quiet(values: Floats, runs: Runs) -> tuple[Floats, float, NDArray[np.bool_]]:
    """Return heights or rates (n,) smoothed by local cubics, their remaining noise, and True (n,) near a corner.

    A noisy regressor takes from what it multiplies (a viscosity by the noise of the rate over its mean square), and the
    residual shows that as a pattern over phase. The window is symmetric, and the longest, of at most 41 samples, that
    takes less from the signal than a tenth of the noise. At a corner of the motion it takes more.
    """
    # The noise by third differences, in which a smooth motion hardly shows.
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    noise = float(np.sqrt(np.mean(third**2) / _THIRD_DIFFERENCE_VARIANCE)) if len(third) else 0.0
    if noise == 0.0 or not np.isfinite(values).all():
        return values, 0.0, np.zeros(len(values), bool)
    pieces = np.split(values, np.flatnonzero(np.diff(runs)) + 1)
    smooth, longest = values, 0
    for width in _WINDOWS:
        if width > len(values):
            continue
        smoothed = np.concatenate([local_cubic(p, width) if len(p) >= width else p for p in pieces])
        # The slow part of the difference was signal; a mean of white noise over the window has 1/width of its variance.
        bend = np.convolve(values - smoothed, np.ones(width) / width, "valid")
        if float(np.mean(bend**2)) > (_MAX_BEND_SHARE**2 + _MEAN_VARIANCES / width) * noise**2:
            break
        smooth, longest = smoothed, width
    if not longest:
        return values, 0.0, np.zeros(len(values), bool)
    bend = np.convolve(values - smooth, np.full(longest, 1.0 / longest), "same")
    is_corner = np.abs(bend) > _CORNER_DEVIATIONS * noise / np.sqrt(longest)
    is_near_corner = np.convolve(is_corner, np.ones(longest), "same") > 0.5  # of a count: any within the window
    return np.asarray(smooth), noise * float(np.linalg.norm(cubic_weights(longest))), np.asarray(is_near_corner)
