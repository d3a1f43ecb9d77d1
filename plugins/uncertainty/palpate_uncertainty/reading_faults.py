"""What faults of the readings do to each value: a velocity that is late, and a force that is not zero in air."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from palpate import Diagnosed, Flag, Floats, TrackEnd, TrackEvidence

from palpate_uncertainty.delay.timing_shift import delay_shifts
from palpate_uncertainty.force_sensitivity import Along, along
from palpate_uncertainty.influence import answer
from palpate_uncertainty.uncertainty_budget import per_newton

_LATE = 1e-3  # [s] of the velocity against the position
_SURE = 5.0  # standard uncertainties of that
_AIR = 0.2  # of the force that counts as touch: 0.05 N where the sensor has the paper's noise


def reading_faults(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Findings on every track, each with what it does to the track's values by the model's derivatives."""
    found = {}
    for track in tracks:
        if (end := track.ending) is not None:
            course = along(track.model, end.tail, end.last, track.values)
            names = [parameter.name for parameter in track.model.parameters]
            flags = (*velocity_flags(track, end, course, names), *air_force_flags(end, course, names))
            if flags:
                found[track.name] = Diagnosed(flags)
    return found


def velocity_flags(track: TrackEvidence, end: TrackEnd, course: Along | None, names: Sequence[str]) -> Iterator[Flag]:
    """A velocity that lags the position, and what it moves by the way in which the estimator uses it.

    Where the velocity is all that it knows of the motion, the motion is late: theta shifts as with a delay of the force
    of the other sign. Where the position is used as well, only the rate is late: f = -dF/dd' d'' tau.
    """
    if end.report.velocity_delay is None or track.estimator.motion == "position":
        return
    late, uncertainty = end.report.velocity_delay
    if abs(late) <= max(_LATE, _SURE * uncertainty):
        return
    text = f"the velocity is {1e3 * late:.2g} ms late against the position: filtered, or of another clock"
    if course is None:
        yield Flag("velocity-late", text)
        return
    if track.estimator.motion == "velocity":
        shifts: Floats | None = np.abs(late * delay_shifts(track.model, course, track.values))
    else:
        moved = None if course.by_rate is None else answer(course.jacobian, late * course.by_rate * course.acceleration)
        shifts = np.abs(moved[:-1]) if moved is not None else None
    yield Flag("velocity-late", text, effects=_named(names, shifts))


def air_force_flags(end: TrackEnd, course: Along | None, names: Sequence[str]) -> Iterator[Flag]:
    """A force before the first touch, and what it moves where it is a wrong zero."""
    report = end.report
    if "tare" in end.included or report.air_force is None or abs(report.air_force) <= _AIR * report.touch_force:
        return
    text = f"before the first touch the force is {report.air_force:+.2g} N, where it should be none"
    shifts = per_newton(course)
    effects = _named(names, None if shifts is None else np.abs(report.air_force * shifts))
    yield Flag("untared", text, effects=effects)


def _named(names: Sequence[str], shifts: Floats | None) -> dict[str, float] | None:
    return None if shifts is None else dict(zip(names, shifts.tolist(), strict=True))
