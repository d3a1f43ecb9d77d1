"""Flags of a record whose assumptions failed, and those that an estimator raises itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from palpate.estimation import Status
from palpate.flags import Flag

from palpate_engine.alignment import GRAVITY, AlignmentReport, AlignmentSettings, Health
from palpate_engine.result.track_record import TrackRecord

# Choices, if not said otherwise. They apply to faults of streams and clocks: a log in order does not come near them.
_MAX_CLOCK_DRIFT = 5e-4  # [s] between the clocks of two streams over a record
_MAX_GAPS = 0.01  # of the samples, that may lack a reading
_MAX_LOST = 0.05  # of the samples: more lost readings count, whatever their effect
_MAX_RATE_RATIO = 2.0  # between two rates of one stream; beyond it nothing of its time is right
_UNITS = {1e3: "microseconds", 1e6: "milliseconds", 1e9: "seconds"}  # by the factor that their numbers are smaller
_MAX_UNIT_RATIO = 1.5  # factor by which a ratio of rates may miss that of a unit
_MIN_RATE = 20.0  # [Hz] of a recording; a smaller announced rate may be in kHz
_MAX_STANDSTILL = 0.1  # [s] of exactly equal readings
_MIN_TURNED_WEIGHT = 0.02  # [N], from which on a weight that turns counts
_MASS_UNCERTAINTY = 0.05  # of a tip's mass, where no uncertainty is declared
_STATED_SIGMAS = 3.0  # standard uncertainties of stated facts, by which a weight may miss them
_NOISE_SIGMAS = 5.0  # the same of noise, which may be correlated
_MAX_STIFF = 0.01  # of the samples; the few long steps of an arm that hesitates are not a property of the contact


def alignment_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """Yield the faults of the record, whatever is estimated from it."""
    yield from _stream_flags(report.streams)
    for name, health in report.streams.items():
        yield from _rate_flags(name, health)
        if health.rate and (duration := health.longest_stand / health.rate) > _MAX_STANDSTILL:
            yield Flag("stuck", f"{name} repeats one reading for {duration:.2f} s")
    for name, count in (("force", report.missing_force), ("velocity", report.missing_velocity)):
        if count > max(1, _MAX_GAPS * report.samples):
            yield Flag("gaps", f"{count} of {report.samples} samples have no {name}")
    if report.missing_force > _MAX_LOST * report.samples:
        yield Flag("lost-readings", f"{report.missing_force} of {report.samples} samples have no force")
    yield from _drift_flags(report, settings)
    yield from _weight_flags(report, settings)
    if report.touches > 1:
        yield Flag("touched-again", f"contact was lost and found again {report.touches - 1} times")


def _stream_flags(streams: Mapping[str, Health]) -> Iterator[Flag]:
    """Yield the faults of the readings; those that streams of a device share, such as a lost state, are one flag."""
    for text in _shared_counts(streams, "invalid", "invalid reading"):
        yield Flag("invalid", text)
    for text in _shared_counts(streams, "duplicates", "repeated time-stamp"):
        yield Flag("duplicates", text)
    for text in _shared_counts(streams, "backwards", "backward time-stamp"):
        yield Flag("backwards", text)
    for text in _shared_counts(streams, "gaps", "gap"):
        yield Flag("gaps", text)
    for text in _shared_counts(streams, "saturated", "saturated reading"):
        yield Flag("saturated", text)


def _shared_counts(streams: Mapping[str, Health], fault: str, thing: str) -> Iterator[str]:
    """Yield "arm.tip and twist have 3 gaps" for each count of a fault, with the streams of a device that have it."""
    names: dict[tuple[str, int], list[str]] = {}
    for name, health in streams.items():
        if count := getattr(health, fault):
            names.setdefault((name.partition(".")[0], count), []).append(name)
    for (device, count), (first, *further_names) in names.items():
        shared = [first, *(name.removeprefix(f"{device}.") for name in further_names)]
        subject = f"{', '.join(shared[:-1])} and {shared[-1]} have" if further_names else f"{first} has"
        yield f"{subject} {count} {thing}{'' if count == 1 else 's'}"


def _rate_flags(name: str, health: Health) -> Iterator[Flag]:
    """Yield a flag for time-stamps that contradict the rate that a stream announces."""
    ratio, announced = health.rate_ratio, health.stream.rate
    if ratio is None or announced is None:
        return
    message = f"the time-stamps of {name} give {ratio * announced:.6g} Hz, and {announced:.6g} Hz are announced"
    if 1.0 / _MAX_RATE_RATIO < ratio < _MAX_RATE_RATIO:
        yield Flag("rate-contradicted", message)
    else:
        yield Flag("wrong-stamps", f"{message}: {_likely_unit(ratio, announced)}")


def _likely_unit(ratio: float, announced: float) -> str:
    """Return the unit that explains a ratio of rates, as a sentence; time-stamps are in nanoseconds, rates in Hz."""
    if announced < _MIN_RATE and _MAX_UNIT_RATIO > ratio / 1e3 > 1.0 / _MAX_UNIT_RATIO:
        return "is the rate announced in kHz?"
    for factor, unit in _UNITS.items():
        if _MAX_UNIT_RATIO > ratio / factor > 1.0 / _MAX_UNIT_RATIO:
            return f"the time-stamps seem to be in {unit}, and must be in nanoseconds"
    return "announce the rate of the readings, or correct the time-stamps (in nanoseconds)"


def _drift_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """Yield a flag for clocks of force and motion that do not run alike, by the clock that logged both."""
    signals = [signal for signal in (settings.force, settings.position, settings.velocity) if signal is not None]
    streams = dict.fromkeys(signal.channel.rpartition(".")[0] for signal in signals if signal.time == "stamp")
    gains: list[tuple[str, float]] = []  # [s] of the clock of each stream
    for name in streams:
        health = report.streams.get(name)
        if health is not None and health.gained is not None:
            gains.append((name, health.gained))
    for name, gain in gains[1:]:
        first, reference = gains[0]
        if abs(gain - reference) > _MAX_CLOCK_DRIFT:
            ahead, behind = (name, first) if gain > reference else (first, name)
            drift = f"{1e3 * abs(gain - reference):.2g} ms"
            yield Flag("clock-drift", f"the time-stamps of {ahead} gain {drift} on those of {behind} over the record")


def _weight_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """Yield a flag for a tool that turns in free air, and for readings that do not follow its weight."""
    turned, mass = report.turned, settings.tip_mass
    if settings.weight != "turning" and (change := report.tilt * GRAVITY * (mass or 0.0)) > _MIN_TURNED_WEIGHT:
        yield Flag(
            "turned-tool",
            f"the tool turns, and its weight along it changes by {change:.2g} N, which a tare does not take off",
        )
    if turned is None or turned.apart is None or turned.spread < _MIN_TURNED_WEIGHT or not mass:
        return
    # All as shares of the weight: what the angle of the mounting [rad] and the mass may be off by, and the drift.
    angle, _ = settings.orientation_uncertainties["mounting"]
    stated = settings.tip_mass_uncertainty
    mass_uncertainty = _MASS_UNCERTAINTY if stated is None else stated / mass
    drift = settings.drift * report.duration / turned.spread
    limit = _STATED_SIGMAS * math.hypot(angle, mass_uncertainty) + drift + _NOISE_SIGMAS * turned.apart_std
    if turned.apart > limit:
        yield Flag(
            "turned-weight",
            f"in free air the weight turns by {turned.spread:.2g} N in the axes of the sensor, and the readings are "
            f"off that by {turned.apart * turned.spread:.2g} N",
        )


def track_flags(record: TrackRecord, report: AlignmentReport) -> Iterator[Flag]:
    """Yield the flags that an estimator raises itself, and one for a track that never estimated.

    Diagnoses judge its values.
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
        if record.flags:  # the estimator has given the reason
            return
        message = f"the force never stayed above {report.touch_force:.3g} N: nothing was estimated"
        yield _with_sign(Flag("no-contact", message), report)
        return
    yield from _status_flags(record)


def _with_sign(flag: Flag, report: AlignmentReport) -> Flag:
    """Ask for the sign where there was no contact, and the force goes as far to the other side."""
    if flag.code != "no-contact" or report.pull <= report.touch_force:
        return flag
    remedy = "It goes down by as much as a contact would raise it: should force have sign = -1 in [alignment]?"
    return replace(flag, message=f"{flag.message}; but it goes down to {-report.pull:.3g} N", remedy=remedy)


def _status_flags(record: TrackRecord) -> Iterator[Flag]:
    """Yield a flag for each status of a sample that an estimator has set."""
    marks = record.marks
    if marks[Status.DIVERGED]:
        yield Flag("diverged", "the estimates stopped being finite or plausible numbers; none can be used")
    if marks[Status.LIFTED]:
        yield Flag(
            "depth-not-positive", f"the estimated depth was not positive in {marks[Status.LIFTED]} samples in contact"
        )
    if marks[Status.RESTARTED]:
        yield Flag("restarted", f"the filter restarted {marks[Status.RESTARTED]} times")
    if marks[Status.BLIND]:
        yield Flag("blind", f"{marks[Status.BLIND]} samples lacked a measurement and were predicted only")
    if marks[Status.STIFF] > _MAX_STIFF * record.samples:
        yield Flag("too-stiff", f"the contact was too stiff for the time step in {marks[Status.STIFF]} samples")
    if marks[Status.REPAIRED]:
        yield Flag("covariance-repaired", f"the covariance lost its positivity in {marks[Status.REPAIRED]} samples")
    if marks[Status.RESUMED]:
        yield Flag("resumed", f"the estimate was carried over a pause {marks[Status.RESUMED]} times")
