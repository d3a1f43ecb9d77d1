"""The samples that a model is tested on, in contact and in air, and the derivatives of their force by alternatives."""

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
# Choices.
_BIN_COUNTS = {"time": 24, "depth": 24, "speed": 12, "air": 12}  # over each variable, any pattern of which would show
_TIME_STEPS = 8  # bins of what moves in time
_LIMIT_SHARE = 0.95  # of the largest force, above which a sensor may give less
_COMMAND_DELAY = 0.01  # [s] of an arm behind its command; the part that eta does not take goes with acceleration
_LEVEL_NOISES = 20.0  # times the noise of a height, of depths that are distinguished
_LEVEL_PARTS = 10  # of such a step, of which that with the fewest samples is the border
_MIN_ACCELERATION_NOISES = 10.0  # times the noise of an acceleration, from which on it is one
_FRICTION_SPEED_SHARE = 0.05  # of the largest speed, below which friction is not full
_MIN_DEPTH_SHARE = 0.04  # of the largest depth, above which a bin is not judged
_SECOND_CONTACTS = (0.5, 0.6, 0.7, 0.8, 0.9)  # of the largest depth, from which on something else bears as well
_RELAXATION_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0)  # [s] of what may relax
_SMALL_RADIUS = 0.5e-3  # [m] of a tip, below which it is not a robot's
_SLOPE_WINDOW, _MIN_SLOPE_SAMPLES = 0.08, 11  # [s] and samples of the window of slow accelerations
_OPEN_DELAY, _OPEN_MASS = 0.02, 0.5  # [s], [kg] of facts that nobody has stated, one standard uncertainty
_OPEN_MASS_SHARE = 0.05  # of a mass that is stated without an uncertainty, one standard uncertainty
# Typical sizes of alternatives, choices as well: one that would not show at this size is not tested. The size
# matters for a record in which an alternative hardly shows.
_TYPICAL_POWER = 0.5  # of the depth, by which the force of another tip grows otherwise
_TYPICAL_STIFFENING = 0.5  # of the elastic force at the deepest, by another thickness
_TYPICAL_FADING = 0.3  # of the elastic force, that changes in time, relaxes, or is lost on the way out
_TYPICAL_SHIFT = 0.1  # of the largest depth, by which the surface moves
_TYPICAL_DELAY = 5e-3  # [s] of the force against the motion
_TYPICAL_MASS = 0.1  # [kg] behind the sensor
_TYPICAL_COMPLIANCE = 1.0 / 5e3  # [m/N] of a mount
_TYPICAL_FORCE = 0.05  # of the largest force: a zero, a drift, a drag, friction, a cable, adhesion
_TYPICAL_ZERO_IN_CONTACT = 0.5  # of the largest force, which a force that was zeroed in contact lacks
_TYPICAL_SECOND_STIFFNESS = 0.3  # of the mean elastic stiffness, by a second contact
_TYPICAL_LOSS_AT_LIMIT = 1.0  # of the force above the limit
# Numbers that keep quotients and logarithms finite.
_MIN_SPAN = 1e-9  # [s] of a record
_MIN_DEPTH, _MIN_PART = 1e-12, 1e-6  # [m], and of the largest depth
_SMALLEST_SPEED = 1e-300  # [m/s], near the smallest double


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
        """Return the fitted samples of a course in contact, then those of its track in the air."""
        used = course.used
        force, jacobian, by_depth, by_rate = slopes_of(course, track.values, track.surface)
        # Of the air; `bend` is the acceleration, `read` the force as it was read.
        time, depth, rate, bend, read = _air(track, float(np.max(course.depth(track.surface)[used])))

        def whole(inside: Floats, outside: Any = 0.0) -> Floats:
            """Return the values in contact, then those in the air; a number holds for all of the air."""
            return np.concatenate([inside, np.zeros((len(time), *inside.shape[1:])) + outside])

        return cls(
            track=track,
            course=course,
            time=whole(course.time[used], time),
            depth=whole(course.depth(track.surface)[used], depth),
            rate=whole(course.rate[used], rate),
            acceleration=whole(slow_acceleration(course)[used], bend),
            force=whole(force),
            jacobian=whole(jacobian),
            by_depth=whole(by_depth),
            by_rate=whole(by_rate),
            air_force=read - (track.tip_mass or 0.0) * bend,
            count=int(np.count_nonzero(used)),
            free=free_unknowns(track),
        )

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
        """True (n,) for the samples in contact."""
        return np.arange(len(self.time)) < self.count

    @property
    def _is_small(self) -> bool:
        """True if the tip is not that of a robot, which has another zero and hardly a mass."""
        return bool(getattr(getattr(self.track.model, "indenter", None), "radius", _SMALL_RADIUS) < _SMALL_RADIUS)

    def _fixed(self) -> Iterator[tuple[str, Floats, float]]:
        """Yield name, derivative (n,) of the force, and stated uncertainty of each number that is held fixed."""
        unknowns = self.track.report.unknowns if self.track.report is not None else {}
        names = [*(parameter.name for parameter in self.track.model.parameters), "surface"]
        for name, column, free in zip(names, self.jacobian.T, self.free, strict=True):
            if not free and column.any():
                yield name, column, (unknowns[name].std or 0.0) if name in unknowns else 0.0

    def stated(self) -> Iterator[Floats]:
        """Yield the force (n,) [N] by one standard uncertainty of each quantity that is not exactly known.

        These are the numbers that are held fixed, delay, zero, rounding, mass, mount and drift.
        """
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
            yield (_OPEN_MASS_SHARE * mass if share is None else share) * self.acceleration
        if end.settings.series_stiffness is not None:  # the displacement of the mount is not subtracted
            yield self._given_way / end.settings.series_stiffness
        if end.settings.drift != type(end.settings).model_fields["drift"].default:
            yield end.settings.drift * (self.time - self.course.begin)

    def open(self) -> Iterator[Floats]:
        """Yield the derivative (n,) by a zero that the air determines, or the fit without air: it is not judged."""
        if self._tells_zero or zero_without_air(self.track) is not None:
            yield np.ones(len(self.time))

    @property
    def _has_air(self) -> bool:
        """True if there are samples in the air."""
        return len(self.time) > self.count

    @property
    def _tells_zero(self) -> bool:
        """True if the zero of the force is that of the record's air, which is tested as well."""
        tare = self.track.ending.report.tare if self.track.ending is not None else None
        return self._has_air and tare is not None and tare.noise is not None

    def places(self) -> Iterator[tuple[str, Floats]]:
        """Yield the indicators (n, m) of the bins over which any pattern would show."""
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
        """The depth (n,) in steps far above its noise: bins of a hold would sort by noise that is in the residual, too.

        The borders of the steps are where the fewest samples are, and none is where the tip is held.
        """
        step = _LEVEL_NOISES * noise_of(self.track.kept.position, self.track.kept.time)
        if not step > 0:
            return self.depth
        place = self.depth / step
        counts, edges = np.histogram(place[self.contact] % 1.0, _LEVEL_PARTS, (0.0, 1.0))
        half_part = 0.5 / _LEVEL_PARTS
        return np.asarray(np.floor(place - edges[int(np.argmin(counts))] - half_part))

    def patterns(self) -> Iterator[tuple[str, Floats, float]]:
        """Yield cause, derivatives (n, m) of the force by an alternative, and its typical size."""
        freed = ((f"{FIXED} of {name}", math.inf, column) for name, column, _ in self._fixed())
        for cause, typical, *columns in (*freed, *self._of_the_material(), *self._of_the_rig(), *self._of_the_air()):
            yield cause, np.nan_to_num(np.column_stack(columns)), typical

    @cached_property
    def _elastic(self) -> Floats:
        """The elastic force (n,) [N] of the model; 0 in the air."""
        return self._whole(self.course.elastic(*self._at)[0])

    @cached_property
    def _since(self) -> Floats:
        """The time (n,) in parts of the record."""
        return np.asarray((self.time - self.time.min()) / max(float(np.ptp(self.time)), _MIN_SPAN))

    def _of_the_material(self) -> Iterator[tuple[Any, ...]]:
        """Yield cause, typical size and derivative (n,) of what material or surface may do otherwise.

        The size times the derivative is a force [N]. An infinite size is one that is always tested; `_since` is the
        time in parts of the record.
        """
        elastic, deepest = self._elastic, float(np.max(self.depth))
        part = np.maximum(self.depth, _MIN_DEPTH) / deepest
        # d^(p + q) = d^p (1 + q ln d) for a small q.
        yield "another tip", _TYPICAL_POWER, elastic * np.log(np.maximum(part, _MIN_PART))
        yield "thickness", _TYPICAL_STIFFENING, elastic * part
        yield "stiffness that changes", _TYPICAL_FADING, elastic * self._since
        # Time in parts of the record, from its middle: the mean shift is in the surface that was fitted.
        yield "surface moved", _TYPICAL_SHIFT * deepest, self.by_depth * (self._since - 0.5)
        steps = bins_of(np.where(self.contact, self.time, np.nan), _TIME_STEPS)
        yield "surface moved in steps", math.inf, self.by_depth[:, None] * steps
        step, course_force = float(np.median(np.diff(self.course.time))), self.course.elastic(*self._at)[0]
        for tau in _RELAXATION_TIMES:
            yield f"memory of {tau:g} s", _TYPICAL_FADING, self._whole(_relaxing(course_force, step, tau))
        outward = self.rate < 0
        if (outward & self.contact).any() and not outward[: self.count].all():
            yield "unloading", _TYPICAL_SHIFT * deepest, self.by_depth * outward
            yield "unloading that is softer", _TYPICAL_FADING, -elastic * outward

    def _of_the_rig(self) -> Iterator[tuple[Any, ...]]:
        """Yield cause, typical size and derivative (n,) of what a wrong fact of the rig does.

        The size times the derivative is a force [N]; an infinite size is one that is always tested.
        """
        end = self.track.ending
        max_force, deepest = float(np.max(np.abs(self.force))), float(np.max(self.depth))
        if end is not None and end.settings.timing_uncertainty is not None:
            yield "timing", _TYPICAL_DELAY, self.change
        if end is not None and end.settings.tip_mass is not None and not self._is_small:
            yield "mass", _TYPICAL_MASS, self.acceleration
        if end is not None:  # a stated mount as well: it may give more
            yield "compliance", _TYPICAL_COMPLIANCE, self._given_way
        beyond_limit = np.maximum(self.force - _LIMIT_SHARE * max_force, 0.0)
        yield "force at its limit", _TYPICAL_LOSS_AT_LIMIT, -beyond_limit
        if self._bends:  # a lag tau of an arm changes the depth by tau d', which a viscosity takes, and by tau^2 d''
            yield "command", _COMMAND_DELAY**2, self.by_depth * self.acceleration
        if self._tells_zero:  # zeroed in air: another zero in contact is one that the contact itself has
            yield "zero of the force", _TYPICAL_FORCE * max_force, self.contact.astype(float)
        elif end is not None:  # a force that was zeroed in contact lacks what the tip already bore
            zero_share = _TYPICAL_FORCE if self._has_air else _TYPICAL_ZERO_IN_CONTACT
            yield "zero of the force", zero_share * max_force, np.ones(len(self.time))
        for part in _SECOND_CONTACTS:
            beyond = np.maximum(self.depth - part * deepest, 0.0)
            stiffness = _TYPICAL_SECOND_STIFFNESS * float(np.max(self._elastic)) / deepest
            yield f"second contact of {part:g}", stiffness, beyond
        yield "drift", _TYPICAL_FORCE * max_force, self._since
        yield "drift in steps", math.inf, bins_of(self.time, _TIME_STEPS)

    def _of_the_air(self) -> Iterator[tuple[Any, ...]]:
        """Yield cause, typical size and derivative (n,) of forces in the air that are in contact as well."""
        size = _TYPICAL_FORCE * float(np.max(np.abs(self.force)))
        if self._has_air:
            speed = self.rate / max(float(np.max(np.abs(self.rate))), _SMALLEST_SPEED)
            yield "drag", size, speed
            yield "friction", size, np.tanh(speed / _FRICTION_SPEED_SHARE)
            yield "cable", size, self.depth / float(np.max(self.depth))
            yield "adhesion", size, -self.contact.astype(float)

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
        """The parameters (k,) and the surface [m] of the track."""
        return self.track.values, self.track.surface

    def _whole(self, values: Floats) -> Floats:
        """Return values of the course's used samples, 0 in the air."""
        return np.concatenate([values[self.course.used], np.zeros(len(self.time) - self.count)])


def bins_of(values: Floats, count: int) -> Floats:
    """Return the indicators (n, count) of bins of equal numbers of samples; NaN is in none."""
    rows, indicators = np.flatnonzero(np.isfinite(values)), np.zeros((len(values), count))
    for column, part in enumerate(np.array_split(rows[np.argsort(values[rows], kind="stable")], count)):
        indicators[part, column] = 1.0
    return indicators


def _air(track: TrackEvidence, deepest: float) -> Floats:
    """Return time, depth, rate, slow acceleration, and force (5, a) of the air before the contact and after it."""
    parts = [np.zeros((5, 0))]
    for time, force, place in ((track.air_time, track.air_force, track.air_position), tuple(track.air_after)):
        is_finite = np.isfinite(force) & np.isfinite(place)
        time, force, depth = time[is_finite], force[is_finite], track.surface - place[is_finite]
        # Too short a stretch leaves hardly anything between its ends (choice).
        if len(time) <= 4 * _MIN_SLOPE_SAMPLES or not np.all(np.diff(time) > 0):
            continue
        rate = _slope(time, depth)
        rows = depth < -IN_AIR * deepest
        rows[:_MIN_SLOPE_SAMPLES] = rows[-_MIN_SLOPE_SAMPLES:] = False  # where a local cubic has one side only
        parts.append(np.array([time, depth, rate, _slope(time, rate), force])[:, rows])
    return np.concatenate(parts, axis=1)


def _slope(time: Floats, values: Floats) -> Floats:
    """Return the slope (n,) in time over a wide window."""
    step = float(np.median(np.diff(time)))
    return local_cubic(values, _width(step, len(time)), 1) / step


def slow_acceleration(course: Course) -> Floats:
    """Return the acceleration (n,) [m/s^2] of the depth over a wide window.

    That of the fit has the same noise as the residual, which would look like a delay or a mass.
    """
    step = float(np.median(np.diff(course.time)))
    return local_cubic(course.rate, _width(step, len(course.time)), 1) / step


def _width(step: float, count: int) -> int:
    """Return the samples of the window of slow slopes, an odd number."""
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
