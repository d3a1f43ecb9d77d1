"""The protocol of a calibration, from the records of all repeats to its values and notes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from palpate import Floats, LogError
from palpate_engine import GRAVITY

from palpate_calibration.calibrated_value import MeasuredValue, add_values, scale_value
from palpate_calibration.calibration_record import CalibrationRecord
from palpate_calibration.motion_segments import Segment, hesitation_note, shake_segments, standstill_segments
from palpate_calibration.settings import CalibrationSettings
from palpate_calibration.shake_analysis import ShakeFit, shake_fit
from palpate_calibration.standstill import OctaveNoise, StandstillFit, standstill_fit, standstill_values
from palpate_calibration.statics import series_compliance, tap_delay

# Choices.
_MAX_REPEAT = 0.1  # [s] of exactly equal readings
_DELAY_MARGIN = 0.06  # [s] at the ends of a record, that a delay of 50 ms does not leave
_MAX_SHIFT = 8.0  # standard uncertainties between the mean forces of shake and standstill
_MAX_SHIFT_SHARE = 0.05  # of the inertia, likewise
_MAX_DIFFERENCE = 3.0  # standard uncertainties between two ways to one value
_NOTED_NOISES = 1.5  # times the noise at standstill, from which on a residual is noted
_MAX_NOISES = 3.0  # times the noise at standstill, and a tenth of the inertia, that a residual may be
_MAX_RESIDUAL_SHARE = 0.1
MAX_COLOUR = 2.0  # times the density of white noise, from which on slow noise is noted
_MIN_LATENESS = 1e-4  # [s] of a velocity that a run corrects
_CERTAIN, _SMALL_CERTAIN = 3.0, 5.0  # standard uncertainties of a lateness, and of one that is too small to correct


@dataclass(frozen=True)
class StepFindings:
    """Results of all repeats together."""

    values: dict[str, MeasuredValue]  # by name, in the order in which they are shown
    shakes: tuple[ShakeFit, ...] = ()
    standstills: tuple[StandstillFit, ...] = ()
    residual: float = 0.0  # [N] the largest of the shakes
    notes: tuple[str, ...] = ()
    spectra: Mapping[str, OctaveNoise] = field(default_factory=dict)  # of the noise at standstill, by role


def calibrate(records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Return mass, delay, offset, weight, drift and noise, from records of standstill and shake in free air.

    Raises LogError with the reason where a record cannot be used: saturated, stuck, in contact, too small a motion.
    """
    if settings.motion == "plate":
        return join_steps([delay_from_taps(records), compliance_from_presses(records)], settings)
    return join_steps([shake_findings(records, settings)], settings)


def shake_findings(records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Return mass and delay from shakes in free air; with standstills in the records offset, drift and noise, too."""
    shakes: list[ShakeFit] = []
    standstills: list[StandstillFit] = []
    for record in records:
        refuse_broken(record)
        segments = shake_segments(record, settings.settle)
        if not segments:
            raise _no_shake(record)
        fits = [shake_fit(record, segment, settings.frequencies) for segment in segments]
        shakes += fits
        if standstill_stretches := standstill_segments(record):
            standstills.append(standstill_fit(record, standstill_stretches))
            _refuse_shifted(fits, segments, standstills[-1])
    return StepFindings(
        values=_values(shakes, standstills, settings),
        shakes=tuple(shakes),
        standstills=tuple(standstills),
        residual=max(shake.residual for shake in shakes),
        notes=tuple(_notes(shakes, standstills)),
    )


def _no_shake(record: CalibrationRecord) -> LogError:
    """Return the error of a record without a shake, with its motion."""
    count = record.hesitations.count(record.begin, record.end)
    motion = f"{1e3 * float(np.ptp(record.position.values)):.3g} mm in {record.end - record.begin:.3g} s"
    return LogError(
        f"calibration: the record contains no shake of 2 s or more: no steady oscillation; the tip moves by {motion}"
        + (f", and {hesitation_note(count)}" if count else "")
    )


def delay_from_taps(records: Sequence[CalibrationRecord]) -> StepFindings:
    """Return a second delay, from taps on a stiff plate."""
    delays = []
    for record in records:
        times, readings = _plate_readings(record)
        delays.append(tap_delay((times, readings), (record.position.time, record.position.values)))
    return StepFindings({"tap_delay": MeasuredValue.of(delays, "s")})


def compliance_from_presses(records: Sequence[CalibrationRecord]) -> StepFindings:
    """Return the compliance of robot and sensor, from presses on a stiff plate."""
    compliances = []
    for record in records:
        times, readings = _plate_readings(record)
        position = record.position
        delay = tap_delay((times, readings), (position.time, position.values)).value
        compliances.append(series_compliance(readings, np.interp(times - delay, position.time, position.values)))
    return StepFindings({"compliance": MeasuredValue.of(compliances, "m/N")})


def _plate_readings(record: CalibrationRecord) -> tuple[Floats, Floats]:
    """Return times (n,) [s] and forces (n,) [N], less the zero, of a press on a plate; raises LogError."""
    refuse_broken(record)
    rests = standstill_segments(record)
    if not rests:
        raise LogError(
            "calibration: the record contains no standstill before the tip presses, so the force has no zero"
        )
    force, position = record.force, record.position
    tared = force.values - standstill_fit(record, rests[:1]).offset.value
    inside = (force.time > position.time[0] + _DELAY_MARGIN) & (force.time < position.time[-1] - _DELAY_MARGIN)
    return force.time[inside], tared[inside]


def join_steps(all_findings: Sequence[StepFindings], settings: CalibrationSettings) -> StepFindings:
    """Return the findings of all steps together: of a value in several the earlier one, and notes on disagreements."""
    values: dict[str, MeasuredValue] = {}
    for step_findings in all_findings:
        values = step_findings.values | values
    if "mass" not in values and "mass_by_weight" in values:
        values["mass"] = values["mass_by_weight"]
    # The sensor's reading without the tip's weight, where gravity pulls along it.
    if settings.gravity and {"mass", "offset"} <= values.keys():
        values["weight"] = scale_value(values["mass"], GRAVITY, "N")
        values["bias"] = add_values(values["offset"], values["weight"])
    shakes = tuple(shake for step_findings in all_findings for shake in step_findings.shakes)
    # Of a role that several steps have the noise of, too, the earlier one counts.
    spectra: dict[str, OctaveNoise] = {}
    for step_findings in reversed(all_findings):
        spectra |= step_findings.spectra
    return StepFindings(
        values={name: values[name] for name in sorted(values, key=_rank)},
        shakes=shakes,
        standstills=tuple(standstill for step_findings in all_findings for standstill in step_findings.standstills),
        residual=max((step_findings.residual for step_findings in all_findings), default=0.0),
        notes=(*dict.fromkeys(_lasting_notes(all_findings, values)), *_disagreements(values)),
        spectra=spectra,
    )


def _lasting_notes(all_findings: Sequence[StepFindings], values: Mapping[str, MeasuredValue]) -> Iterator[str]:
    """Yield the notes that hold for all steps together: a standstill of any step gives the offset."""
    for step_findings in all_findings:
        yield from (
            note for note in step_findings.notes if "offset" not in values or not note.startswith("no-standstill")
        )


_ORDER = ("mass", "delay", "velocity_delay", "offset", "weight", "bias", "drift", "force_std", "position_std")


def _rank(name: str) -> int:
    return _ORDER.index(name) if name in _ORDER else len(_ORDER)


def _disagreements(values: Mapping[str, MeasuredValue]) -> Iterator[str]:
    """Yield a note for each value that two ways determine differently."""
    for first, second, code in (("mass", "mass_by_weight", "masses-differ"), ("delay", "tap_delay", "delays-differ")):
        if not {first, second} <= values.keys():
            continue
        a, b = values[first], values[second]
        if abs(a.value - b.value) > _MAX_DIFFERENCE * math.hypot(a.combined, b.combined):
            yield f"{code}: {first} is {a.value:.4g} {a.unit}, {second} is {b.value:.4g} {b.unit}"


def refuse_broken(record: CalibrationRecord) -> None:
    """Raise LogError where the force is saturated, or the sensor stuck."""
    health = record.force.health
    if health.saturated:
        raise LogError(f"calibration: the force is saturated in {health.saturated} readings")
    if health.longest_repeat / record.force.rate > _MAX_REPEAT:
        seconds = health.longest_repeat / record.force.rate
        raise LogError(f"calibration: the force sensor is stuck: it repeats one reading for {seconds:.2f} s")


def _refuse_shifted(shakes: Sequence[ShakeFit], segments: Sequence[Segment], standstill: StandstillFit) -> None:
    """Raise LogError where the mean force of a shake is not that of the standstill: something pushed meanwhile."""
    for shake, segment in zip(shakes, segments, strict=True):
        nearest = min(standstill.stretches, key=lambda stretch: abs(stretch.time - segment.begin))
        noise = nearest.force_std.value
        shift = shake.offset - nearest.offset.value
        if abs(shift) > max(noise, _MAX_SHIFT * nearest.offset.std, _MAX_SHIFT_SHARE * shake.swing):
            raise LogError(
                f"calibration: the mean force while shaken is {shift:+.3g} N off that at standstill: the tip is in "
                "contact, or something hangs on it"
            )
        if shake.residual > _MAX_NOISES * noise + _MAX_RESIDUAL_SHARE * shake.swing:
            reason = "the tip is in contact, or the motion is not a sine"
            if shake.planned.breaks_up:
                reason = f"{hesitation_note(shake.planned.count)}; that is over half of the shake"
            raise LogError(
                f"calibration: mass and delay leave {shake.residual:.3g} N of the force unexplained where the noise at "
                f"standstill is {noise:.3g} N: {reason}"
            )


def _values(
    shakes: Sequence[ShakeFit], standstills: Sequence[StandstillFit], settings: CalibrationSettings
) -> dict[str, MeasuredValue]:
    """Return the values by all shakes and standstills, with the type B uncertainties that are stated for them."""
    type_b = settings.type_b
    values = {
        "mass": MeasuredValue.of([shake.mass for shake in shakes], "kg", type_b.mass),
        "delay": MeasuredValue.of([shake.delay for shake in shakes], "s", type_b.delay),
    }
    lags = [shake.velocity_delay for shake in shakes if shake.velocity_delay is not None]
    if lags:
        values["velocity_delay"] = MeasuredValue.of(lags, "s")
    if standstills:
        values |= standstill_values(standstills, type_b.offset)
    paper_stds = [shake.paper_velocity_std for shake in shakes if shake.paper_velocity_std is not None]
    if paper_stds:
        values["paper_velocity_std"] = MeasuredValue.of(paper_stds, "m/s")
    return values


def _notes(shakes: Sequence[ShakeFit], standstills: Sequence[StandstillFit]) -> Iterator[str]:
    """Yield the notes on shakes and standstills: what is unknown, coloured, left out, unexplained or late."""
    if not standstills:
        yield (
            "no-standstill: the records contain no standstill in free air, so offset, bias, drift and noise are unknown"
        )
    stretches = [stretch for fit in standstills for stretch in fit.stretches]
    colour = max((stretch.colour for stretch in stretches), default=1.0)
    if colour > MAX_COLOUR:
        yield f"coloured-noise: below a tenth of its rate the force noise is {colour:.1f} times that of white noise"
    count = sum(shake.planned.count for shake in shakes)
    if count:
        # Of a shake that hesitations break up nothing is left out.
        shares = []
        for shake in shakes:
            shares.append(0.0 if shake.planned.breaks_up else shake.planned.share)
        share = np.mean(shares)
        yield f"hesitated: {hesitation_note(count)}; {share:.0%} of the shakes is left out for it"
    noise = max((stretch.force_std.value for stretch in stretches), default=math.inf)
    residual = max(shake.residual for shake in shakes)
    if residual > _NOTED_NOISES * noise:
        yield (
            f"unexplained: mass and delay leave {residual:.3g} N of the force, where the noise at standstill is "
            f"{noise:.3g} N: something else vibrated, or the clocks stumbled"
        )
    yield from _lateness_notes(shakes)


def _lateness_notes(shakes: Sequence[ShakeFit]) -> Iterator[str]:
    """Yield the note on a velocity that is certainly later than the position."""
    lags = [shake.velocity_delay for shake in shakes if shake.velocity_delay is not None]
    if not lags:
        return
    lag = MeasuredValue.of(lags, "s")
    is_small = abs(lag.value) <= _MIN_LATENESS
    if abs(lag.value) > (_SMALL_CERTAIN if is_small else _CERTAIN) * lag.combined:
        note = f"velocity-late: the velocity is {lag.value * 1e3:.3g} ms later than the position"
        yield f"{note}: certain, but too small to correct" if is_small else note
