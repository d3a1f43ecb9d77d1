"""The samples that a model is tested on, in contact and in the air, and what any fact or alternative adds to them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, TrackEvidence
from palpate_kit.numerics.local_cubic import local_cubic

from palpate_uncertainty.refit import Course
from palpate_uncertainty.residual_null import slopes_of

_BINS = {"time": 24, "depth": 24, "speed": 12, "air": 12}
_DEEP = 0.04  # of the largest depth, above which a bin is not judged
_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0)  # [s] of what may relax
_SMALL = 0.5e-3  # [m] radius of a tip
_WIDE, _NARROW = 0.08, 11  # [s] and samples of the window of slow accelerations
_NEAR = 0.05  # of the way in contact, below which it is no air


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

    @classmethod
    def of(cls, track: TrackEvidence, course: Course) -> JudgedRows:
        """The rows of a course, and the air of its track."""
        used = course.used
        force, jacobian, by_depth, by_rate = slopes_of(course, track.values, track.surface)
        time, depth, rate, bend, read = _air(track, float(np.max(course.depth(track.surface)[used])))

        def whole(inside: Floats, outside: Any = 0.0) -> Floats:
            return np.concatenate([inside, np.zeros((len(time), *inside.shape[1:])) + outside])

        return cls(
            track, course, whole(course.time[used], time), whole(course.depth(track.surface)[used], depth),
            whole(course.rate[used], rate), whole(slow_acceleration(course)[used], bend), whole(force), whole(jacobian),
            whole(by_depth), whole(by_rate), read - (track.tip_mass or 0.0) * bend, int(np.count_nonzero(used)),
        )  # fmt: skip

    @property
    def change(self) -> Floats:
        """Slope (n,) [N/s] of the force in time."""
        return self.by_depth * self.rate + self.by_rate * self.acceleration

    @property
    def contact(self) -> NDArray[np.bool_]:
        """(n,) whether a sample is in contact."""
        return np.arange(len(self.time)) < self.count

    @property
    def _is_small(self) -> bool:
        """Whether the tip is none of a robot, which has another zero and hardly a mass."""
        return bool(getattr(getattr(self.track.model, "indenter", None), "radius", _SMALL) < _SMALL)

    def stated(self) -> Iterator[Floats]:
        """(n,) [N] of each stated quantity, one standard uncertainty of it."""
        end, mass = self.track.ending, self.track.tip_mass
        if end is None:
            return
        if (timing := end.settings.timing_uncertainty) is not None:
            yield timing * self.change
        if (tare := end.report.tare) is not None and tare.offset_std is not None:
            yield np.full(len(self.time), tare.offset_std)
        if mass:
            share = end.settings.tip_mass_uncertainty
            yield (0.05 * mass if share is None else share) * self.acceleration
        usual = type(end.settings).model_fields["drift"].default  # of a robot's sensor
        if not self._is_small or end.settings.drift != usual:
            yield end.settings.drift * (self.time - self.course.begin)

    def open(self) -> Iterator[Floats]:
        """(n,) what facts that nobody has stated may add to the force: of these the residual says nothing."""
        end = self.track.ending
        if end is not None and end.settings.timing_uncertainty is None:
            yield self.change
        if end is not None and end.settings.tip_mass is None:
            yield self.acceleration

    def places(self) -> Iterator[tuple[str, Floats, int]]:
        """What the residual is averaged over: values (n,), NaN where they do not count, and how many bins."""
        deep = self.contact & (self.depth > _DEEP * float(np.max(self.depth)))
        for name, values, rows in (
            ("time", self.time, deep),
            ("depth", self.depth, deep),
            ("speed", self.rate, deep),
            ("air", self.time, ~self.contact),
        ):
            yield name, np.where(rows, values, np.nan), _BINS[name]

    def patterns(self) -> Iterator[tuple[str, Floats, float]]:
        """Cause, derivative (n,) of the force by an alternative, and the size of one that is typical."""
        end, most, deepest = self.track.ending, float(np.max(np.abs(self.force))), float(np.max(self.depth))
        every = self.course.elastic(self.track.values, self.track.surface)[0]
        elastic, part = self._whole(every), np.maximum(self.depth, 1e-12) / deepest
        yield "wrong-tip", elastic * np.log(np.maximum(part, 1e-6)), 0.5
        yield "thickness", elastic * part, 0.5
        since = (self.time - self.time.min()) / max(float(np.ptp(self.time)), 1e-9)
        yield "drift", since, 0.05 * most
        yield "surface moved", self.by_depth * (since - 0.5), 0.1 * deepest
        step = float(np.median(np.diff(self.course.time)))
        for tau in _TIMES:
            yield f"memory of {tau:g} s", self._whole(_relaxing(every, step, tau)), 0.3
        if end is not None and end.settings.timing_uncertainty is not None:
            yield "timing", self.change, 5e-3
        if end is not None and end.settings.tip_mass is not None and not self._is_small:
            yield "mass", self.acceleration, 0.1
        if end is not None and end.settings.series_stiffness is None:
            yield "compliance", self.by_depth * self.force + self.by_rate * self.change, 1.0 / 20e3
        back = self.rate < 0
        if (back & self.contact).any() and not back[: self.count].all():
            yield "unloading", self.by_depth * back, 0.1 * deepest
        if len(self.time) > self.count:  # in the air, and in contact as well
            yield "drag", self.rate / max(float(np.max(np.abs(self.rate))), 1e-300), 0.05 * most
            yield "cable", self.depth / deepest, 0.05 * most

    def _whole(self, values: Floats) -> Floats:
        """Values of the course's used samples, none in the air."""
        return np.concatenate([values[self.course.used], np.zeros(len(self.time) - self.count)])


def _air(track: TrackEvidence, deepest: float) -> Floats:
    """Time, depth, rate, slow acceleration, and force (5, a) of the air before the contact and after it."""
    found = [np.zeros((5, 0))]
    for time, force, place in ((track.air_time, track.air_force, track.air_position), tuple(track.air_after)):
        known = np.isfinite(force) & np.isfinite(place)
        time, force, depth = time[known], force[known], track.surface - place[known]
        if len(time) <= 4 * _NARROW or not np.all(np.diff(time) > 0):
            continue
        rate = _slope(time, depth)
        rows = depth < -_NEAR * deepest
        rows[:_NARROW] = rows[-_NARROW:] = False  # where a local cubic has one side only
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
    return min(max(round(_WIDE / step) // 2 * 2 + 1, _NARROW), (count - 1) // 2 * 2 + 1)


def _relaxing(elastic: Floats, step: float, tau: float) -> Floats:
    """The part (n,) of a force that dies away with a time constant [s]."""
    keep, found, left = math.exp(-step / tau), [], 0.0
    for change in np.diff(elastic, prepend=0.0).tolist():
        left = left * keep + change
        found.append(left)
    return np.array(found)
