"""Which assumptions of the record failed, and the flags that an estimator raises itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from palpate.estimation import Status
from palpate.flags import Flag

from palpate_engine.alignment import GRAVITY, AlignmentReport, AlignmentSettings, Health
from palpate_engine.result.track_record import TrackRecord

_DRIFT = 5e-4  # [s] between the clocks of two streams over a record
_FEW = 0.01  # of the samples, that may lack a reading
_MANY = 0.05  # of the samples, from which on what was lost counts, whatever it does
_REFUSED = 2.0  # factor between two rates of one stream, from which on nothing of its time is right
_UNITS = {1e3: "microseconds", 1e6: "milliseconds", 1e9: "seconds"}  # by the factor that their numbers are smaller
_NEAR = 1.5  # factor by which a ratio may miss that of a unit
_SLOWEST = 20.0  # [Hz] of a recording; a smaller announced rate may be in kHz
_STUCK = 0.1  # [s] of exactly equal readings
_TURNED = 0.02  # [N] of a weight, that is seen
_MASS = 0.05  # of itself, where no uncertainty of a tip's mass is declared
_SIGMAS, _CHANCE = 3.0, 5.0  # standard uncertainties: of what is stated; of noise that is correlated
_STIFF = 0.01  # of the samples; the few long steps of an arm that hesitates are not a property of the contact


def alignment_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """Faults of the record, whatever is estimated from it."""
    yield from _stream_flags(report.streams)
    for name, health in report.streams.items():
        yield from _rate_flags(name, health)
        if health.rate and health.longest_stand / health.rate > _STUCK:
            yield Flag("stuck", f"{name} repeats one reading for {health.longest_stand / health.rate:.2f} s")
    for name, count in (("force", report.missing_force), ("velocity", report.missing_velocity)):
        if count > max(1, _FEW * report.samples):
            yield Flag("gaps", f"{count} of {report.samples} samples have no {name}")
    if report.missing_force > _MANY * report.samples:
        yield Flag("lost-readings", f"{report.missing_force} of {report.samples} samples have no force")
    yield from _drift_flags(report, settings)
    yield from _weight_flags(report, settings)
    if report.touches > 1:
        yield Flag("touched-again", f"contact was lost and found again {report.touches - 1} times")


def _stream_flags(streams: Mapping[str, Health]) -> Iterator[Flag]:
    """Faults of the readings; those that streams of a device share, as a state that was lost, are one flag."""
    for has in _shared_counts(streams, "invalid"):
        yield Flag("invalid", f"{has} x invalid readings")
    for has in _shared_counts(streams, "duplicates"):
        yield Flag("duplicates", f"{has} x repeated time-stamps")
    for has in _shared_counts(streams, "backwards"):
        yield Flag("backwards", f"{has} x time going backwards")
    for has in _shared_counts(streams, "gaps"):
        yield Flag("gaps", f"{has} x gaps")
    for has in _shared_counts(streams, "saturated"):
        yield Flag("saturated", f"{has} x saturated readings")


def _shared_counts(streams: Mapping[str, Health], fault: str) -> Iterator[str]:
    """Return "arm.tip and twist have 3" for each count of a fault, of the streams of a device that have it."""
    names: dict[tuple[str, int], list[str]] = {}
    for name, health in streams.items():
        if count := getattr(health, fault):
            names.setdefault((name.partition(".")[0], count), []).append(name)
    for (device, count), (first, *others) in names.items():
        shared = [first, *(name.removeprefix(f"{device}.") for name in others)]
        yield f"{', '.join(shared[:-1])} and {shared[-1]} have {count}" if others else f"{first} has {count}"


def _rate_flags(name: str, health: Health) -> Iterator[Flag]:
    """Time-stamps that contradict the rate that a stream announces."""
    ratio, announced = health.rate_ratio, health.stream.rate
    if ratio is None or announced is None:
        return
    words = f"the time-stamps of {name} give {ratio * announced:.6g} Hz, and {announced:.6g} Hz are announced"
    if 1.0 / _REFUSED < ratio < _REFUSED:
        yield Flag("rate-contradicted", words)
    else:
        yield Flag("wrong-stamps", f"{words}: {_likely_unit(ratio, announced)}")


def _likely_unit(ratio: float, announced: float) -> str:
    """Return which unit explains a ratio of rates; time-stamps are in nanoseconds, rates in Hz."""
    if announced < _SLOWEST and _NEAR > ratio / 1e3 > 1.0 / _NEAR:
        return "is the rate announced in kHz?"
    for factor, unit in _UNITS.items():
        if _NEAR > ratio / factor > 1.0 / _NEAR:
            return f"the time-stamps seem to be in {unit}, and must be in nanoseconds"
    return "announce the rate of the readings, or correct the time-stamps (in nanoseconds)"


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


def _weight_flags(report: AlignmentReport, settings: AlignmentSettings) -> Iterator[Flag]:
    """Yield a tool that turns in free air, and readings that do not follow its weight."""
    turned, mass = report.turned, settings.tip_mass
    if settings.weight != "turning" and (change := report.tilt * GRAVITY * (mass or 0.0)) > _TURNED:
        yield Flag(
            "turned-tool",
            f"the tool turns, and its weight along it changes by {change:.2g} N, which a tare does not take off",
        )
    if turned is None or turned.apart is None or turned.spread < _TURNED or not mass:
        return
    angle, _ = settings.orientation_uncertainties["mounting"]
    share = _MASS if settings.tip_mass_uncertainty is None else settings.tip_mass_uncertainty / mass
    drift = settings.drift * report.duration / turned.spread
    if turned.apart > _SIGMAS * math.hypot(angle, share) + drift + _CHANCE * turned.apart_std:
        yield Flag(
            "turned-weight",
            f"in free air the weight turns by {turned.spread:.2g} N in the axes of the sensor, and the readings are "
            f"off that by {turned.apart * turned.spread:.2g} N",
        )


def track_flags(record: TrackRecord, report: AlignmentReport) -> Iterator[Flag]:
    """Yield the flags that an estimator raises itself, and whether it estimated at all; diagnoses judge its values."""
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
        none = f"the force never stayed above {report.touch_force:.3g} N: nothing was estimated"
        yield _with_sign(Flag("no-contact", none), report)
        return
    yield from _status_flags(record)


def _with_sign(flag: Flag, report: AlignmentReport) -> Flag:
    """Ask for the sign where there was no contact, and the force goes as far to the other side."""
    if flag.code != "no-contact" or report.pull <= report.touch_force:
        return flag
    remedy = "It goes down by as much as a contact would raise it: should force have sign = -1 in [alignment]?"
    return replace(flag, message=f"{flag.message}; but it goes down to {-report.pull:.3g} N", remedy=remedy)


def _status_flags(record: TrackRecord) -> Iterator[Flag]:
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
    if marks[Status.STIFF] > _STIFF * record.samples:
        yield Flag("too-stiff", f"the contact was too stiff for the time step in {marks[Status.STIFF]} samples")
    if marks[Status.REPAIRED]:
        yield Flag("covariance-repaired", f"the covariance lost its positivity in {marks[Status.REPAIRED]} samples")
    if marks[Status.RESUMED]:
        yield Flag("resumed", f"the estimate was carried over a pause {marks[Status.RESUMED]} times")
