"""Which assumptions of the record and of a track failed."""

from __future__ import annotations

from collections.abc import Iterator, Set
from dataclasses import replace

import numpy as np

from palpate.alignment import AlignmentReport, AlignmentSettings, Health
from palpate.contact import ContactModel, contact_force
from palpate.estimation import Status
from palpate.flags import Flag
from palpate.result.lateness import force_lateness
from palpate.result.record import Tail, TrackRecord
from palpate.result.telling import told_at_best
from palpate.result.way import SWEEP

_STILL_MOVING = 0.02  # of a value: slope times time tracked
_BY_CHANCE = 3.5  # standard deviations of a slope; of two parameters one is beyond that once in a thousand tracks
_NIS_RANGE = (0.5, 1.6)  # of the mean over the last second; 0.9 to 1.1 would be one by chance alone
_COLOURED = 0.3  # autocorrelation of innovations; 0.1 comes by chance alone
_WEAK, _FAINT = 5.0, 2.0  # the force must swing by more than so many standard deviations of its noise
_TOLD = 0.2  # of a value: a weak force must tell it to so much, by the Cramer-Rao bound; a faint one never does
_SURFACE_TOLERANCE = 5e-4  # [m] between the surface that a track finds and the one that the first touch says
_LATE = 1e-3  # [s] of the velocity against the position
_DRIFT = 5e-4  # [s] between the clocks of two streams over a record
_AIR = 0.2  # of the force that counts as touch: 0.05 N where the sensor has the paper's noise
_STUCK = 0.1  # [s] of exactly equal readings


def alignment_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """What was amiss with the record, whatever is estimated from it."""
    for name, health in report.streams.items():
        yield from _stream_flags(name, health)
        if health.rate and health.longest_repeat / health.rate > _STUCK:
            yield Flag("stuck", f"{name} repeats one reading for {health.longest_repeat / health.rate:.2f} s")
    if report.missing_force:
        yield Flag("missing-force", f"{report.missing_force} of {report.samples} samples have no force")
    if report.missing_velocity > 1:
        yield Flag("missing-velocity", f"{report.missing_velocity} of {report.samples} samples have no velocity")
    if report.velocity_delay is not None:
        late, uncertainty = report.velocity_delay
        if abs(late) > max(_LATE, 5 * uncertainty):
            what = f"the velocity is {1e3 * late:.2g} ms late against the position: filtered, or of another clock"
            yield Flag("velocity-late", what)
    yield from _drift_flags(report, settings)
    if settings.tare == "free-air" and (report.tare is None or report.tare.noise is None):
        yield Flag("no-tare", "the record is too short, or has no force, for a tare in free air")
    if report.air_force is not None and abs(report.air_force) > _AIR * report.touch_force:
        yield Flag("untared", f"before the first touch the force is {report.air_force:+.2g} N, where it should be none")
    if report.touches > 1:
        yield Flag("touched-again", f"contact was lost and found again {report.touches - 1} times")


def _stream_flags(name: str, health: Health) -> Iterator[Flag]:
    if health.invalid:
        yield Flag("invalid", f"{name} has {health.invalid} x invalid readings")
    if health.duplicates:
        yield Flag("duplicates", f"{name} has {health.duplicates} x repeated time-stamps")
    if health.backwards:
        yield Flag("backwards", f"{name} has {health.backwards} x time going backwards")
    if health.gaps:
        yield Flag("gaps", f"{name} has {health.gaps} x gaps")
    if health.saturated:
        yield Flag("saturated", f"{name} has {health.saturated} x saturated readings")


def _drift_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """Clocks of force and motion that do not run alike, by the clock that logged both."""
    signals = [s for s in (settings.force, settings.position, settings.velocity) if s is not None and s.time == "stamp"]
    streams = dict.fromkeys(signal.channel.rpartition(".")[0] for signal in signals)
    gained = {name: h.gained for name in streams if (h := report.streams.get(name)) is not None}
    known = [(name, gain) for name, gain in gained.items() if gain is not None]
    for name, gain in known[1:]:
        first, reference = known[0]
        if abs(gain - reference) > _DRIFT:
            ahead, behind = (name, first) if gain > reference else (first, name)
            late = f"{1e3 * abs(gain - reference):.2g} ms"
            yield Flag("clock-drift", f"the time-stamps of {ahead} gain {late} on those of {behind} over the record")


def track_flags(
    record: TrackRecord,
    model: ContactModel,
    report: AlignmentReport,
    average: float,
    online: bool = True,
    tip_mass: float = 0.0,
) -> Iterator[Flag]:
    """What is amiss with one track, by its last `average` seconds [s].

    An offline estimate is one of the whole record: it does not drift, and its first seconds are those that settle.
    """
    yield from (_with_sign(flag, report) for flag in record.flags)
    if record.failure is not None:
        yield record.failure
        return
    tail = record.tail
    if tail is None and record.marks[Status.WAITING]:
        yield Flag("never-started", f"{record.marks[Status.WAITING]} samples in contact were too few to start on")
        return
    if tail is None:
        if record.flags:  # the estimator has said why
            return
        none = f"the force never stayed above {report.touch_force:.3g} N: nothing was estimated"
        yield _with_sign(Flag("no-contact", none), report)
        return
    late = force_lateness(tail, tip_mass) if record.swept <= SWEEP else None
    yield from _status_flags(record, late)
    if late is not None:
        yield Flag("force-late", f"the contact gives out work: the force is at least {1e3 * late:.2g} ms late")
    if record.marks[Status.DIVERGED]:
        return
    last = tail.since(float(tail.time[-1]) - average) if online else tail
    yield from _bound_flags(last, model, record.held)
    if online:
        swept = record.swept > SWEEP
        yield from _convergence_flags(tail, last, model, average, record.tracked, swept)
    else:
        begun = tail.since(float(tail.time[0]) + average)
        yield from _innovation_flags(begun, f"after the first {average:g} s")
        yield from _colour_flags(begun)
    if record.report is None:  # a fit says itself what its record does not tell
        yield from _force_flags(tail, last, model, report, record)
    yield from _surface_flags(last, model, report)


def _with_sign(flag: Flag, report: AlignmentReport) -> Flag:
    """Ask for the sign where there was no contact, and the force goes as far to the other side."""
    if flag.code != "no-contact" or report.pull <= report.touch_force:
        return flag
    asked = f"but it goes down to {-report.pull:.3g} N: should force have sign = -1 in [alignment]?"
    return replace(flag, message=f"{flag.message}; {asked}")


def _status_flags(record: TrackRecord, late: float | None) -> Iterator[Flag]:
    marks = record.marks
    if marks[Status.DIVERGED]:
        cause = "" if late is None else "; the likely cause is a force that is late: the viscosity would be negative"
        yield Flag("diverged", f"the estimates stopped being finite or plausible numbers; none can be used{cause}")
    if marks[Status.LIFTED]:
        yield Flag(
            "depth-not-positive", f"the estimated depth was not positive in {marks[Status.LIFTED]} samples in contact"
        )
    if marks[Status.RESTARTED]:
        yield Flag("restarted", f"the filter began anew {marks[Status.RESTARTED]} times")
    if marks[Status.BLIND]:
        yield Flag("blind", f"{marks[Status.BLIND]} samples lacked a measurement and were predicted only")
    if marks[Status.STIFF]:
        yield Flag("too-stiff", f"the contact was too stiff for the time step in {marks[Status.STIFF]} samples")
    if marks[Status.REPAIRED]:
        yield Flag("covariance-repaired", f"the covariance lost its positivity in {marks[Status.REPAIRED]} samples")
    if marks[Status.RESUMED]:
        yield Flag("resumed", f"the estimate was carried over a pause {marks[Status.RESUMED]} times")


def _bound_flags(last: Tail, model: ContactModel, held: Set[str]) -> Iterator[Flag]:
    for column, parameter in enumerate(model.parameters):
        value = float(last.values[:, column].mean())
        if parameter.name not in held and not parameter.lower < value < parameter.upper:
            yield Flag("implausible", f"{parameter.name} of {value:.3g} {parameter.unit} is outside what is possible")


def _convergence_flags(
    tail: Tail, last: Tail, model: ContactModel, average: float, tracked: float, swept: bool
) -> Iterator[Flag]:
    """Whether the estimates have settled, and the innovations are what the filter expects.

    On a sweep they follow the material from place to place and never settle.
    """
    if tracked < 2 * average or len(tail.time) < 10:
        yield Flag("not-converged", f"only {tracked:.2g} s were tracked")
        return
    moving, chance = [], _BY_CHANCE * tracked * tail.slope_by_chance()
    for column, parameter in enumerate(model.parameters if not swept else ()):
        value, rest = float(last.values[:, column].mean()), float(tail.unsettled(tail.values, tracked)[column])
        least = max(_STILL_MOVING * abs(value), 3.0 * float(last.std[-1, column]), float(chance[column]))
        if rest > least:
            moving.append(f"{parameter.name} by {100 * rest / tracked / abs(value):.2f} % a second")
    if moving:
        yield Flag("not-converged", f"still moving after {tracked:.3g} s: {', '.join(moving)}")
    yield from _innovation_flags(last, f"in the last {average:g} s")
    yield from _colour_flags(tail)


def _innovation_flags(seen: Tail, when: str) -> Iterator[Flag]:
    """Whether innovations are as large as the filter expects."""
    nis = float(np.nanmean(seen.nis)) if np.isfinite(seen.nis).any() else float("nan")
    if not np.isnan(nis) and not _NIS_RANGE[0] <= nis <= _NIS_RANGE[1]:
        yield Flag("inconsistent", f"NIS of {nis:.2g} {when} where 1 is expected: noise or model is wrong")


def _colour_flags(tail: Tail) -> Iterator[Flag]:
    """Whether innovations tell of one another."""
    lag, share = tail.correlation()
    if abs(share) > _COLOURED:
        found = f"innovations {lag} samples apart correlate by {share:+.2f}"
        yield Flag("coloured-innovations", f"{found}: the model misses something, or the data are filtered")


def _force_flags(
    tail: Tail, last: Tail, model: ContactModel, report: AlignmentReport, record: TrackRecord
) -> Iterator[Flag]:
    """Whether the force swings enough to tell what the track says."""
    noise = report.tare.noise if report.tare and report.tare.noise else last.noise
    swing = float(np.nanmax(last.model_force) - np.nanmin(last.model_force))
    if swing >= _WEAK * noise:
        return
    values, bounds = np.abs(last.values.mean(axis=0)), told_at_best(tail, model, noise, record.samples)
    free = [i for i, parameter in enumerate(model.parameters) if parameter.name not in record.held]
    if swing < _FAINT * noise or not (bounds < _TOLD * values)[free].all():
        yield Flag("not-identifiable", f"the force swings by {swing:.2g} N against a noise of {noise:.2g} N")


def _surface_flags(last: Tail, model: ContactModel, report: AlignmentReport) -> Iterator[Flag]:
    """The model at the estimate must give the force of first touch where that was; none, where contact began there."""
    if report.first_touch is None or report.tare is None or report.tare.noise is None or model.memory:
        return  # what a material that relaxes answers to a first touch depends on the approach
    theta, surface = last.values.mean(axis=0), float(last.surface.mean())
    depths = np.linspace(0.0, 0.02, 2001)
    force = contact_force(model, depths, 0.0, theta)
    touch_force = 0.0 if report.by_change_point else report.touch_force
    expected = float(depths[min(int(np.searchsorted(force, touch_force)), len(depths) - 1)])
    apart = surface - (report.first_touch[1] + expected)
    if abs(apart) > _SURFACE_TOLERANCE:
        yield Flag("surface-mismatch", f"the estimated surface is {1e3 * apart:+.2f} mm from where the tip touched")


def validity_flags(model: ContactModel, last: Tail) -> Iterator[Flag]:
    """What the model says against itself at the greatest depth that was reached."""
    depth = float(np.max(last.surface - last.position)) if len(last.time) else 0.0
    problem = model.validity(depth) if np.isfinite(depth) and depth > 0 else ""
    if problem:
        yield Flag("beyond-model-range", problem)
