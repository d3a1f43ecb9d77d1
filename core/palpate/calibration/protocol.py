"""The protocol: the records of all repeats become one calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.alignment import GRAVITY
from palpate.calibration.quantity import Measured, Scatter
from palpate.calibration.record import Record
from palpate.calibration.rest import RestFit, rest_fit
from palpate.calibration.segments import Segment, resting, shaking
from palpate.calibration.settings import CalibrationSettings
from palpate.calibration.shake import ShakeFit, shake_fit
from palpate.calibration.statics import series_compliance, tap_delay
from palpate.errors import LogError

_STUCK = 0.1  # [s] of exactly equal readings
_MARGIN = 0.06  # [s]; a delay that is searched for must not leave the record
_SHIFTED = 8.0  # standard uncertainties between the mean forces of shake and rest
_UNEXPLAINED = 3.0  # times the noise at rest, and a tenth of the inertia, may be left over


@dataclass(frozen=True)
class Session:
    """What all repeats together say."""

    values: dict[str, Measured]  # by name, in the order in which people want them
    shakes: tuple[ShakeFit, ...]
    rests: tuple[RestFit, ...]
    residual: float  # [N] the largest of the shakes
    notes: tuple[str, ...]


def calibrate(records: Sequence[Record], settings: CalibrationSettings) -> Session:
    """Mass, delay, offset, weight, drift and noise, from records that each hold rest and shake in free air.

    Raises LogError with the reason where a record cannot be used: saturated, stuck, in contact, too small a motion.
    """
    if settings.motion == "plate":
        return _plate(records)
    shakes: list[ShakeFit] = []
    rests: list[RestFit] = []
    for record in records:
        _refuse_broken(record)
        moving, still = shaking(record, settings.settle), resting(record)
        if not moving:
            raise LogError("calibration: the record holds no shake of 2 s or more: no even to-and-fro motion")
        fits = [shake_fit(record, segment, settings.frequencies) for segment in moving]
        shakes += fits
        if still:
            rests.append(rest_fit(record, still))
            _refuse_shifted(record, fits, moving, rests[-1])
    return Session(
        _values(shakes, rests, settings),
        tuple(shakes),
        tuple(rests),
        max(shake.residual for shake in shakes),
        tuple(_notes(shakes, rests)),
    )


def _plate(records: Sequence[Record]) -> Session:
    """A second delay, and the compliance of the robot, from presses on a rigid plate."""
    delays, compliances = [], []
    for record in records:
        _refuse_broken(record)
        still = resting(record)
        if not still:
            raise LogError("calibration: the record holds no rest before the tip presses, so the force has no zero")
        force, position = record.force, record.position
        free = force.values - rest_fit(record, still[:1]).offset.value
        inside = (force.time > position.time[0] + _MARGIN) & (force.time < position.time[-1] - _MARGIN)
        times, readings = force.time[inside], free[inside]
        delays.append(tap_delay((times, readings), (position.time, position.values)))
        heights = np.interp(times - delays[-1].value, position.time, position.values)
        compliances.append(series_compliance(readings, heights))
    values = {"tap_delay": Measured.of(delays, "s"), "compliance": Measured.of(compliances, "m/N")}
    return Session(values, (), (), 0.0, ())


def _refuse_broken(record: Record) -> None:
    health = record.force.health
    if health.saturated:
        raise LogError(f"calibration: the force is saturated in {health.saturated} readings")
    if health.longest_repeat / record.force.rate > _STUCK:
        seconds = health.longest_repeat / record.force.rate
        raise LogError(f"calibration: the force sensor is stuck: it repeats one reading for {seconds:.2f} s")


def _refuse_shifted(record: Record, shakes: Sequence[ShakeFit], moving: Sequence[Segment], rest: RestFit) -> None:
    """Raise LogError where the mean force of a shake is not that of the rest: something pushed meanwhile."""
    for shake, segment in zip(shakes, moving, strict=True):
        nearest = min(rest.rests, key=lambda r: abs(r.time - segment.begin))
        noise = nearest.force_std.value
        shift = shake.offset - nearest.offset.value
        if abs(shift) > max(noise, _SHIFTED * nearest.offset.std, 0.05 * shake.swing):
            raise LogError(
                f"calibration: the mean force while shaken is {shift:+.3g} N off that at rest: the tip is in contact, "
                "or something hangs on it"
            )
        if shake.residual > _UNEXPLAINED * noise + 0.1 * shake.swing:
            raise LogError(
                f"calibration: mass and delay leave {shake.residual:.3g} N of the force unexplained where the noise at "
                f"rest is {noise:.3g} N: the tip is in contact, or the motion is no sine"
            )


def _values(shakes: Sequence[ShakeFit], rests: Sequence[RestFit], settings: CalibrationSettings) -> dict[str, Measured]:
    b = settings.type_b
    mass = Measured.of([shake.mass for shake in shakes], "kg", b.mass)
    found = {
        "mass": mass,
        "delay": Measured.of([shake.delay for shake in shakes], "s", b.delay),
    }
    lags = [shake.velocity_delay for shake in shakes if shake.velocity_delay is not None]
    if lags:
        found["velocity_delay"] = Measured.of(lags, "s")
    if rests:
        offset = Measured.of([rest.offset for rest in rests], "N", b.offset)
        found["offset"] = offset
        if settings.gravity:
            found["weight"] = _scaled(mass, GRAVITY, "N")
            found["bias"] = _sum(offset, found["weight"])
        drifts = [rest.drift for rest in rests if rest.drift is not None]
        if drifts:
            found["drift"] = Measured.of(drifts, "N/s")
        single = [item for rest in rests for item in rest.rests]
        found["force_std"] = Measured.of([item.force_std for item in single], "N")
        found["position_std"] = Measured.of([item.position_std for item in single], "m")
        speeds = [item.velocity_std for item in single if item.velocity_std is not None]
        if speeds:
            found["velocity_std"] = Measured.of(speeds, "m/s")
    paper = [shake.paper_velocity_std for shake in shakes if shake.paper_velocity_std is not None]
    if paper:
        # The paper's figure is a scatter without a fit of its own: only the repeats speak.
        found["paper_velocity_std"] = Measured.of([Scatter(std, 0.0) for std in paper], "m/s")
    return found


def _scaled(measured: Measured, by: float, unit: str) -> Measured:
    type_a = measured.type_a * by if measured.type_a is not None else None
    return Measured(
        measured.value * by,
        unit,
        tuple(value * by for value in measured.repeats),
        measured.fit * by,
        type_a,
        measured.type_b * by,
        measured.combined * by,
        measured.factor,
    )


def _sum(first: Measured, second: Measured) -> Measured:
    """The sum of two values that know nothing of each other."""

    def joined(a: float, b: float) -> float:
        return float((a**2 + b**2) ** 0.5)

    repeats = tuple(a + b for a, b in zip(first.repeats, second.repeats, strict=False))
    return Measured(
        first.value + second.value,
        first.unit,
        repeats,
        joined(first.fit, second.fit),
        joined(first.type_a or 0.0, second.type_a or 0.0),
        joined(first.type_b, second.type_b),
        joined(first.combined, second.combined),
        max(first.factor, second.factor),
    )


def _notes(shakes: Sequence[ShakeFit], rests: Sequence[RestFit]) -> list[str]:
    notes = []
    if not rests:
        notes.append("no-rest: the records hold no rest in free air, so offset, bias, drift and noise are not known")
    colour = max((item.colour for rest in rests for item in rest.rests), default=1.0)
    if colour > 2.0:
        notes.append(
            f"coloured-noise: below a tenth of its rate the force noise is {colour:.1f} times that of white noise"
        )
    lags = [shake.velocity_delay for shake in shakes if shake.velocity_delay is not None]
    if lags:
        lag = Measured.of(lags, "s")
        if abs(lag.value) > 1e-4 and abs(lag.value) > 3 * lag.combined:
            notes.append(f"velocity-late: the velocity is {lag.value * 1e3:.2f} ms later than the position")
    return notes
