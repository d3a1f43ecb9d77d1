"""Effects of faulty readings on each value: a velocity that is late, and a force that is not zero in air."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from palpate import ContactModel, Diagnosed, Flag, Floats, TrackEnd, TrackEvidence
from palpate_kit.budget.force_sensitivity import Along, along
from palpate_kit.budget.influence import effects_by_name
from palpate_kit.budget.systematic_terms import per_newton

from palpate_uncertainty.delay.timing_shift import delay_shifts

# Choices: a fault is reported where it is larger than noise and sampling make it.
_MIN_LATENESS = 1e-3  # [s] of the velocity against the position: a sample at 1 kHz
_MIN_DEVIATIONS = 5.0  # [standard uncertainties] of that lateness
_MIN_SHARE, _MAX_SHARE = 0.6, 1.5  # of the position's change by the velocity; noise and delay explain less
_MAX_AIR_FORCE = 0.2  # of the force that counts as touch: 0.05 N where the sensor has the paper's noise


def reading_faults(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the findings on each track, with their effects on its values by the model's derivatives."""
    findings = {}
    for track in tracks:
        if (end := track.ending) is not None:
            sensitivity = along(track.model, end.tail, end.last, track.values, end.held)
            flags = (*velocity_flags(track, end, sensitivity), *air_force_flags(track.model, end, sensitivity))
            if flags:
                findings[track.name] = Diagnosed(flags)
    return findings


def velocity_flags(track: TrackEvidence, end: TrackEnd, sensitivity: Along | None) -> Iterator[Flag]:
    """Yield the flag of a velocity that lags the position, with its effect by the motion that the estimator uses.

    `sensitivity` has the derivatives of the model's force along the last samples, which give the size of the effect.
    For an estimator that uses the velocity alone, the motion is late: theta shifts as with a delay of the force of the
    other sign. If it uses the position as well, only the rate is late: f = -dF/dd' d'' tau.
    """
    if track.estimator.motion == "position":
        return
    # A velocity that explains another share of the position's change is wrong in itself.
    share = end.report.velocity_share
    if share is not None and not _MIN_SHARE <= share <= _MAX_SHARE:
        text = f"the stated velocity is {share:.2g} times what the position changes by: one of the two is wrong"
        yield Flag("velocity-other", text)
        return
    if end.report.velocity_delay is None:
        return
    # A late one moves the values by the motion that the estimator uses.
    lateness, uncertainty = end.report.velocity_delay
    if abs(lateness) <= max(_MIN_LATENESS, _MIN_DEVIATIONS * uncertainty):
        return
    text = f"the velocity is {1e3 * lateness:.2g} ms late against the position: filtered, or of another clock"
    if sensitivity is None:
        yield Flag("velocity-late", text)
        return
    if track.estimator.motion == "velocity":
        shifts: Floats | None = lateness * delay_shifts(track.model, sensitivity, track.values)
    else:
        late_rate = None if sensitivity.by_rate is None else lateness * sensitivity.by_rate * sensitivity.acceleration
        shifts = None if late_rate is None else sensitivity.answer(late_rate)
    yield Flag("velocity-late", text, effects=effects_by_name(track.model, shifts))


def air_force_flags(model: ContactModel, end: TrackEnd, sensitivity: Along | None) -> Iterator[Flag]:
    """Yield the flag of a force before the first touch, with its effect as a wrong zero."""
    report = end.report
    if (
        "tare" in end.included
        or report.air_force is None
        or abs(report.air_force) <= _MAX_AIR_FORCE * report.touch_force
    ):
        return
    text = f"before the first touch the force is {report.air_force:+.2g} N, where it should be none"
    shifts = per_newton(sensitivity)
    effects = effects_by_name(model, None if shifts is None else report.air_force * shifts)
    yield Flag("untared", text, effects=effects)
