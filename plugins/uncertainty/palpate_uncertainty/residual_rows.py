"""The samples that a model is tested on, in contact and in the air, and what any fact or alternative adds to them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, TrackEvidence
from palpate_kit.numerics.local_cubic import cubic_weights, local_cubic
from palpate_kit.numerics.tip_travel import noise_of

from palpate_uncertainty.force_noise import rounding_noise
from palpate_uncertainty.refit import IN_AIR, Course, free_unknowns, zero_without_air
from palpate_uncertainty.residual_null import slopes_of

FIXED = "a fixed value"  # the cause that is tested by freeing what is fixed
_BIN_COUNTS = {
    "time": 24,
    "depth": 24,
    "speed": 12,
    "air": 12,
}  # over each variable, any pattern of which would show: a choice
_TIME_STEPS = 8  # bins of what moves in time
_LIMIT_SHARE = 0.95  # of the largest force, above which a sensor may give less
_COMMAND_DELAY = 0.01  # [s] of an arm behind its command; the part that eta does not take goes with acceleration
_DEPTH_STEP_NOISES = 20.0  # times the noise of a height, of depths that are distinguished
_MIN_ACCELERATION_NOISES = 10.0  # times the noise of an acceleration, from which on it is one
_FRICTION_SPEED_SHARE = 0.05  # of the largest speed, below which friction is not full
_MIN_DEPTH_SHARE = 0.04  # of the largest depth, above which a bin is not judged
_SECOND_CONTACTS = (0.5, 0.6, 0.7, 0.8, 0.9)  # of the largest depth, from which on something else bears as well
_RELAXATION_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0)  # [s] of what may relax
_SMALL_RADIUS = 0.5e-3  # [m] radius of a tip
_SLOPE_WINDOW, _MIN_SLOPE_SAMPLES = 0.08, 11  # [s] and samples of the window of slow accelerations
_OPEN_DELAY, _OPEN_MASS = 0.02, 0.5  # [s], [kg] of facts that nobody has stated, one standard uncertainty


@dataclass(frozen=True)
class JudgedRows:
    """Samples in contact, then those in the air before and after it, of which no model has a force."""

    track: TrackEvidence
    course: Course
    time: Floats  # (n,) [s]
    depth: Floats  # (n,) [m], negative in the air
    rate: Floats  # (n,) [m/s]
    acceleration: Floats  # (n,) [m/s^2] over a wide window
    force: Floats  # (n,) [N] of the model
    jacobian: Floats  # (n, k + 1) by parameters and surface
    by_depth: Floats  # (n,) [N/m]
    by_rate: Floats  # (n,) [N s/m]
    air_force: Floats  # (a,) [N] less the inertia
    count: int  # in contact
    free: NDArray[np.bool_]  # (k + 1,) parameters and surface that the fit determines

    @classmethod
    def of(cls, track: TrackEvidence, course: Course) -> JudgedRows:
        """Return the rows of a course, and the air of its track."""
        used = course.used
        force, jacobian, by_depth, by_rate = slopes_of(course, track.values, track.surface)
        time, depth, rate, bend, read = _air(track, float(np.max(course.depth(track.surface)[used])))

        def whole(inside: Floats, outside: Any = 0.0) -> Floats:
            return np.concatenate([inside, np.zeros((len(time), *inside.shape[1:])) + outside])

        return cls(
            track, course, whole(course.time[used], time), whole(course.depth(track.surface)[used], depth),
            whole(course.rate[used], rate), whole(slow_acceleration(course)[used], bend), whole(force), whole(jacobian),
            whole(by_depth), whole(by_rate), read - (track.tip_mass or 0.0) * bend, int(np.count_nonzero(used)),
            free_unknowns(track),
        )  # fmt: skip

    @property
    def change(self) -> Floats:
        """Slope (n,) [N/s] of the force in time."""
        return self.by_depth * self.rate + self.by_rate * self.acceleration

    @property
    def _given_way(self) -> Floats:
        """Derivative (n,) [N^2/m] of the force by the compliance of a mount, to first order."""
        return -self.by_depth * self.force - self.by_rate * self.change

    @property
    def contact(self) -> NDArray[np.bool_]:
        """(n,) whether a sample is in contact."""
        return np.arange(len(self.time)) < self.count

    @property
    def _is_small(self) -> bool:
        """True if the tip is not that of a robot, which has another zero and hardly a mass."""
        return bool(getattr(getattr(self.track.model, "indenter", None), "radius", _SMALL_RADIUS) < _SMALL_RADIUS)

    def _fixed(self) -> Iterator[tuple[str, Floats, float]]:
        """Name, derivative (n,) of the force, and stated standard uncertainty of each number that is held fixed."""
        unknowns = self.track.report.unknowns if self.track.report is not None else {}
        names = [*(parameter.name for parameter in self.track.model.parameters), "surface"]
        for name, column, free in zip(names, self.jacobian.T, self.free, strict=True):
            if not free and column.any():
                yield name, column, (unknowns[name].std or 0.0) if name in unknowns else 0.0

    def stated(self) -> Iterator[Floats]:
        """(n,) [N] of each quantity that is not exactly known, one standard uncertainty of it."""
        yield from (std * column for _, column, std in self._fixed() if std)
        end, mass = self.track.ending, self.track.tip_mass
        if end is None:
            return
        timing = end.settings.timing_uncertainty
        yield (_OPEN_DELAY if timing is None else timing) * self.change
        if (tare := end.report.tare) is not None and tare.offset_std is not None and not self._tells_zero:
            yield np.full(len(self.time), tare.offset_std)
        if (rounding := rounding_noise(self.track)) is not None:  # the air is one reading, which has one error
            yield np.where(self.contact, 0.0, rounding.std)
        if end.settings.tip_mass is None:
            yield _OPEN_MASS * self.acceleration
        elif mass:
            share = end.settings.tip_mass_uncertainty
            yield (0.05 * mass if share is None else share) * self.acceleration
        if end.settings.series_stiffness is not None:  # its way is an uncertainty, and is not taken off
            yield self._given_way / end.settings.series_stiffness
        if end.settings.drift != type(end.settings).model_fields["drift"].default:
            yield end.settings.drift * (self.time - self.course.begin)

    def open(self) -> Iterator[Floats]:
        """(n,) a zero that the air determines, or the fit without air: it is not judged."""
        if self._tells_zero or zero_without_air(self.track) is not None:
            yield np.ones(len(self.time))

    @property
    def _has_air(self) -> bool:
        return len(self.time) > self.count

    @property
    def _tells_zero(self) -> bool:
        """True if the zero of the force is that of the record's air, which is tested as well."""
        tare = self.track.ending.report.tare if self.track.ending is not None else None
        return self._has_air and tare is not None and tare.noise is not None

    def places(self) -> Iterator[tuple[str, Floats]]:
        """Indicators (n, m) of the bins over which any pattern would show."""
        deep = self.contact & (self.depth > _MIN_DEPTH_SHARE * float(np.max(self.depth)))
        for name, values, rows in (
            ("time", self.time, deep),
            ("depth", self._level, deep),
            ("speed", self.rate, deep),
            ("air", self.time, ~self.contact),
        ):
            if np.count_nonzero(rows) >= 2 * _BIN_COUNTS[name]:
                yield name, bins_of(np.where(rows, values, np.nan), _BIN_COUNTS[name])

    @property
    def _level(self) -> Floats:
        """(n,) depth in steps far above its noise: in a hold bins would sort by noise that the residual has as well.

        Steps are where the fewest samples are, and none where the tip is held.
        """
        step = _DEPTH_STEP_NOISES * noise_of(self.track.kept.position, self.track.kept.time)
        if not step > 0:
            return self.depth
        place = self.depth / step
        counts, edges = np.histogram(place[self.contact] % 1.0, 10, (0.0, 1.0))
        return np.asarray(np.floor(place - edges[int(np.argmin(counts))] - 0.05))

    def patterns(self) -> Iterator[tuple[str, Floats, float]]:
        """Cause, derivatives (n, m) of the force by an alternative, and the size of one that is typical."""
        freed = ((f"{FIXED} of {name}", math.inf, column) for name, column, _ in self._fixed())
        for cause, typical, *columns in (*freed, *self._of_the_material(), *self._of_the_rig(), *self._of_the_air()):
            yield cause, np.nan_to_num(np.column_stack(columns)), typical

    @cached_property
    def _elastic(self) -> Floats:
        """(n,) [N]"""
        return self._whole(self.course.elastic(*self._at)[0])

    @cached_property
    def _since(self) -> Floats:
        """(n,) time in parts of the record."""
        return np.asarray((self.time - self.time.min()) / max(float(np.ptp(self.time)), 1e-9))

    def _of_the_material(self) -> Iterator[tuple[Any, ...]]:
        elastic, deepest = self._elastic, float(np.max(self.depth))
        part = np.maximum(self.depth, 1e-12) / deepest
        yield "another tip", 0.5, elastic * np.log(np.maximum(part, 1e-6))
        yield "thickness", 0.5, elastic * part
        yield "stiffness that changes", 0.3, elastic * self._since
        yield "surface moved", 0.1 * deepest, self.by_depth * (self._since - 0.5)
        steps = bins_of(np.where(self.contact, self.time, np.nan), _TIME_STEPS)
        yield "surface moved in steps", math.inf, self.by_depth[:, None] * steps
        step, every = float(np.median(np.diff(self.course.time))), self.course.elastic(*self._at)[0]
        for tau in _RELAXATION_TIMES:
            yield f"memory of {tau:g} s", 0.3, self._whole(_relaxing(every, step, tau))
        back = self.rate < 0
        if (back & self.contact).any() and not back[: self.count].all():
            yield "unloading", 0.1 * deepest, self.by_depth * back
            yield "unloading that is softer", 0.3, -elastic * back

    def _of_the_rig(self) -> Iterator[tuple[Any, ...]]:
        end, most, deepest = self.track.ending, float(np.max(np.abs(self.force))), float(np.max(self.depth))
        if end is not None and end.settings.timing_uncertainty is not None:
            yield "timing", 5e-3, self.change
        if end is not None and end.settings.tip_mass is not None and not self._is_small:
            yield "mass", 0.1, self.acceleration
        if end is not None:  # a stated mount as well: it may give more
            yield "compliance", 1.0 / 5e3, self._given_way
        yield "force at its limit", 1.0, -np.maximum(self.force - _LIMIT_SHARE * most, 0.0)
        if self._bends:
            yield "command", _COMMAND_DELAY**2, self.by_depth * self.acceleration
        if self._tells_zero:  # zeroed in air: another zero in contact is one that the contact itself has
            yield "zero of the force", 0.05 * most, self.contact.astype(float)
        elif end is not None:  # a force that was zeroed in contact lacks what the tip already bore
            yield "zero of the force", (0.05 if self._has_air else 0.5) * most, np.ones(len(self.time))
        for part in _SECOND_CONTACTS:
            beyond = np.maximum(self.depth - part * deepest, 0.0)
            yield f"second contact of {part:g}", 0.3 * float(np.max(self._elastic)) / deepest, beyond
        yield "drift", 0.05 * most, self._since
        yield "drift in steps", math.inf, bins_of(self.time, _TIME_STEPS)

    def _of_the_air(self) -> Iterator[tuple[Any, ...]]:
        """What is in the air, and in contact as well."""
        most = 0.05 * float(np.max(np.abs(self.force)))
        if self._has_air:
            speed = self.rate / max(float(np.max(np.abs(self.rate))), 1e-300)
            yield "drag", most, speed
            yield "friction", most, np.tanh(speed / _FRICTION_SPEED_SHARE)
            yield "cable", most, self.depth / float(np.max(self.depth))
            yield "adhesion", most, -self.contact.astype(float)

    @property
    def _bends(self) -> bool:
        """True if the acceleration is one of the motion, and not noise of the heights, which the force has as well."""
        step = float(np.median(np.diff(self.course.time)))
        slope = cubic_weights(_width(step, len(self.course.time)), 1) / step
        noise = noise_of(self.track.kept.position, self.track.kept.time) * float(
            np.linalg.norm(np.convolve(slope, slope))
        )
        return float(np.sqrt(np.mean(self.acceleration[: self.count] ** 2))) > _MIN_ACCELERATION_NOISES * noise

    @property
    def _at(self) -> tuple[Floats, float]:
        return self.track.values, self.track.surface

    def _whole(self, values: Floats) -> Floats:
        """Values of the course's used samples, none in the air."""
        return np.concatenate([values[self.course.used], np.zeros(len(self.time) - self.count)])


def bins_of(values: Floats, count: int) -> Floats:
    """Indicators (n, count) of bins of equal numbers of samples; none of NaN."""
    rows, found = np.flatnonzero(np.isfinite(values)), np.zeros((len(values), count))
    for column, part in enumerate(np.array_split(rows[np.argsort(values[rows], kind="stable")], count)):
        found[part, column] = 1.0
    return found


def _air(track: TrackEvidence, deepest: float) -> Floats:
    """Time, depth, rate, slow acceleration, and force (5, a) of the air before the contact and after it."""
    found = [np.zeros((5, 0))]
    for time, force, place in ((track.air_time, track.air_force, track.air_position), tuple(track.air_after)):
        known = np.isfinite(force) & np.isfinite(place)
        time, force, depth = time[known], force[known], track.surface - place[known]
        if len(time) <= 4 * _MIN_SLOPE_SAMPLES or not np.all(np.diff(time) > 0):
            continue
        rate = _slope(time, depth)
        rows = depth < -IN_AIR * deepest
        rows[:_MIN_SLOPE_SAMPLES] = rows[-_MIN_SLOPE_SAMPLES:] = False  # where a local cubic has one side only
        found.append(np.array([time, depth, rate, _slope(time, rate), force])[:, rows])
    return np.concatenate(found, axis=1)


def _slope(time: Floats, values: Floats) -> Floats:
    """Slope (n,) in time over a wide window."""
    step = float(np.median(np.diff(time)))
    return local_cubic(values, _width(step, len(time)), 1) / step


def slow_acceleration(course: Course) -> Floats:
    """Acceleration (n,) [m/s^2] of the depth over a wide window.

    That of the fit has the same noise as the residual, which would look like a delay or a mass.
    """
    step = float(np.median(np.diff(course.time)))
    return local_cubic(course.rate, _width(step, len(course.time)), 1) / step


def _width(step: float, count: int) -> int:
    """Samples of the window of slow slopes."""
    return min(max(round(_SLOPE_WINDOW / step) // 2 * 2 + 1, _MIN_SLOPE_SAMPLES), (count - 1) // 2 * 2 + 1)


def _relaxing(elastic: Floats, step: float, tau: float) -> Floats:
    """Return the part (n,) of a force that dies away with a time constant [s].

    It is y_i = sum_j x_(i-j) k^j of the changes x of the force, with k = exp(-step/tau). The sum of the latest 2 s
    changes is that of the latest s, and k^s times that of the s before these.
    """
    relaxing, span = np.diff(elastic, prepend=0.0), 1
    while span < len(relaxing):
        relaxing[span:] += math.exp(-span * step / tau) * relaxing[:-span]
        span *= 2
    return relaxing
