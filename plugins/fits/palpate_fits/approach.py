"""The first approach of a record, and where the surface may be by the paper's constraint."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from palpate import Samples
from palpate_engine import change_point
from palpate_kit.numerics.contact_point import CONTACT_METHODS, Approach, ContactPoint, bin_force, contact_point
from palpate_kit.numerics.tip_travel import median, third_differences

from palpate_fits.segments import RecordCourse

# Choices.
_MIN_AIR_SAMPLES = 20
_MIN_CONTACT_SAMPLES = 5
_NEAR_NOISE = 15.0  # [standard deviations of the force], up to which the change point is looked for
_BEYOND_SAMPLES = 3  # of a force beyond that; one alone may be by chance
_AIR_TRAVELS = 2.0  # travels in contact of air above the touch that belong to the approach
_MIN_TRAVEL = 1e-12  # [m] in contact, in place of 0: below any resolution
_THIRD_DIFFERENCE_GAIN = 20.0  # 1 + 9 + 9 + 1: variance of third differences over that of white noise


@dataclass(frozen=True)
class SurfaceByForce:
    """The surface by methods that use the force alone, computed when it is first asked for."""

    samples: Samples
    course: RecordCourse
    threshold: float | None  # [N]

    @cached_property
    def approach(self) -> Approach | None:
        """See `first_approach`."""
        return first_approach(self.samples, self.course)

    @cached_property
    def points(self) -> dict[str, ContactPoint]:
        """The contact points by method, of those that find one."""
        if self.approach is None:
            return {}
        points = {method: contact_point(method, self.approach, self.threshold) for method in CONTACT_METHODS}
        return {method: point for method, point in points.items() if point is not None}


def first_approach(samples: Samples, course: RecordCourse) -> Approach | None:
    """Return the samples from the air above the surface to the deepest point of the first cycle.

    `course` has the height of the first touch, the travel in contact, and the cycle of each sample. None where there
    are less than 20 samples in air or 5 in contact.
    """
    in_approach = np.isfinite(samples.force) & (course.cycle <= 1)
    touch = int(np.argmax(samples.contact))
    in_contact = in_approach[touch:] & samples.contact[touch:]
    deepest = touch + int(np.where(in_contact, samples.position[touch:], np.inf).argmin())
    in_approach[deepest + 1 :] = False
    is_near = samples.position < course.touch + max(_AIR_TRAVELS * course.travel, _MIN_TRAVEL)
    rows = np.flatnonzero(in_approach & is_near)
    air = int(np.count_nonzero(rows < touch))
    if air < _MIN_AIR_SAMPLES or len(rows) - air < _MIN_CONTACT_SAMPLES:
        return None
    interval = median(np.diff(samples.time[rows]))
    return _up_to_contact(Approach(samples.position[rows], samples.force[rows], air, interval))


def _up_to_contact(approach: Approach) -> Approach:
    """Return the approach with its air ending where contact begins, which a threshold passes later.

    `approach.air` is the number of its first samples that are in air, before the force has passed the threshold.
    A slow ramp is in contact long before its force shows in a single sample; contact is looked for where the force is
    still near its noise, as only there the law of a change point is good for every tip.
    """
    # Up to the third sample whose force is far beyond the noise.
    noise = float(np.sqrt(np.mean(third_differences(approach.force) ** 2) / _THIRD_DIFFERENCE_GAIN))
    rise = approach.force[approach.air :] - median(approach.force[: approach.air])
    beyond = np.flatnonzero(rise > _NEAR_NOISE * noise)
    is_seen = len(beyond) >= _BEYOND_SAMPLES
    end = approach.air + (int(beyond[_BEYOND_SAMPLES - 1]) if is_seen else len(approach.force))
    change = change_point(approach.height[:end], approach.force[:end])
    if change is None:
        return approach
    # Of the air without its last stretch, which is below that surface.
    is_below = approach.height[: approach.air] < change.surface
    air = approach.air - (int(np.argmin(is_below[::-1])) if not is_below.all() else 0)
    return replace(approach, air=air) if air >= _MIN_AIR_SAMPLES else approach


def constrained_surface(approach: Approach, force_uncertainty: float) -> float:
    """Return the lowest height [m] at which the measured force on the way down is within the sensor's uncertainty.

    The paper's constraint -F_unc <= F(z_surf) <= F_unc (eq. minprob): as F is measured, it depends on z_surf alone, and
    what it allows is an interval of heights from here upwards.
    """
    edges, means = bin_force(approach)
    is_beyond = np.abs(means) > force_uncertainty
    # From the bottom up: the contact is the last stretch of heights that are all beyond.
    first_bin = len(is_beyond) - int(np.argmin(is_beyond[::-1])) if not is_beyond.all() else 0
    return float(edges[min(first_bin, len(edges) - 1)])
