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

_LEAST_AIR = 20  # samples
_NEAR = 15.0  # standard deviations of the force
_IN_ALL = 3  # samples beyond, which one alone may be by chance


@dataclass(frozen=True)
class SurfaceByForce:
    """Where methods that look at the force alone see the surface, worked out where it is needed."""

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
        found = {method: contact_point(method, self.approach, self.threshold) for method in CONTACT_METHODS}
        return {method: point for method, point in found.items() if point is not None}


def first_approach(samples: Samples, course: RecordCourse) -> Approach | None:
    """Return the first approach with enough air before it; None where the record has no such thing."""
    known = np.isfinite(samples.force) & (course.cycle <= 1)
    touched = int(np.argmax(samples.contact))
    deepest = np.where(known[touched:] & samples.contact[touched:], samples.position[touched:], np.inf).argmin()
    known[touched + int(deepest) + 1 :] = False
    near = samples.position < course.touch + max(2.0 * course.travel, 1e-12)
    rows = np.flatnonzero(known & near)
    air = int(np.count_nonzero(rows < touched))
    if air < _LEAST_AIR or len(rows) - air < 5:
        return None
    interval = median(np.diff(samples.time[rows]))
    return _ended(Approach(samples.position[rows], samples.force[rows], air, interval))


def _ended(approach: Approach) -> Approach:
    """Return the approach with its air ending where contact begins, which a threshold passes later.

    A slow ramp is in contact long before its force shows in a single sample; contact is looked for where the force is
    still near its noise, as only there the law of a change point is good for every tip.
    """
    noise = float(np.sqrt(np.mean(third_differences(approach.force) ** 2) / 20.0))
    beyond = np.flatnonzero(approach.force[approach.air :] - median(approach.force[: approach.air]) > _NEAR * noise)
    end = approach.air + (int(beyond[_IN_ALL - 1]) if len(beyond) >= _IN_ALL else len(approach.force))
    found = change_point(approach.height[:end], approach.force[:end])
    if found is None:
        return approach
    below = approach.height[: approach.air] < found.surface
    air = approach.air - (int(np.argmin(below[::-1])) if not below.all() else 0)
    return replace(approach, air=air) if air >= _LEAST_AIR else approach


def constrained_surface(approach: Approach, force_uncertainty: float) -> float:
    """The lowest height [m] at which the measured force on the way down is still within the sensor's uncertainty.

    The paper's constraint -F_unc <= F(z_surf) <= F_unc (eq. minprob): as F is measured, it depends on z_surf alone, and
    what it allows is an interval of heights from here upwards.
    """
    edges, means = bin_force(approach)
    beyond = np.abs(means) > force_uncertainty
    # From the bottom up: the contact is the last stretch of heights that are all beyond.
    last = len(beyond) - int(np.argmin(beyond[::-1])) if not beyond.all() else 0
    return float(edges[min(last, len(edges) - 1)])
