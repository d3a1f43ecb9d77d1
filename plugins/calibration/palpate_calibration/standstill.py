"""Standstill in free air: offset and drift of the sensor, and the noise of every signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from palpate import Floats
from palpate_kit.runs.calibration_file import NoiseSpectrum

from palpate_calibration.calibrated_value import MeasuredValue, RepeatValue
from palpate_calibration.calibration_record import CalibrationRecord
from palpate_calibration.motion_segments import Segment
from palpate_calibration.sines import mean_with_std

# Choices.
_PARTS = 4  # of a long standstill, whose means show the drift
_MIN_BINS = 8  # of the lowest octave of a spectrum
_SLOW_PARTS = 5  # of a spectrum, the lowest of which, below a tenth of the rate, is slow noise
_SMALLEST_STD = 1e-12  # [N] in a quotient, in place of 0


@dataclass(frozen=True)
class StandstillStretch:
    """One stretch at standstill."""

    time: float  # [s] its middle
    offset: RepeatValue  # [N]
    force_std: RepeatValue  # [N] of one reading, without what drifts
    velocity_std: RepeatValue | None  # [m/s]
    position_std: RepeatValue  # [m]
    colour: float  # noise density below a tenth of the rate over that of white noise of the same std; 1: white


@dataclass(frozen=True)
class StandstillFit:
    """All stretches at standstill of one record."""

    offset: RepeatValue  # [N] at the first stretch
    drift: RepeatValue | None  # [N/s]; None where there is but one stretch
    stretches: tuple[StandstillStretch, ...]


def standstill_fit(record: CalibrationRecord, segments: Sequence[Segment]) -> StandstillFit:
    """Return offset, drift and noise of a record's stretches at standstill; one at least."""
    stretches = tuple(_stretch(record, segment) for segment in segments)
    return StandstillFit(stretches[0].offset, _drift(stretches), stretches)


def long_standstill_fit(record: CalibrationRecord, segment: Segment) -> StandstillFit:
    """Return offset, drift and noise of one long standstill; the drift is the slope of the means of its quarters."""
    edges = np.linspace(segment.begin, segment.end, _PARTS + 1)
    parts = [_stretch(record, Segment(float(a), float(b))) for a, b in pairwise(edges)]
    whole = _stretch(record, segment)
    return StandstillFit(whole.offset, _drift(parts), (whole,))


def standstill_values(fits: Sequence[StandstillFit], offset_type_b: float) -> dict[str, MeasuredValue]:
    """Return offset, drift and noises from the standstills of all repeats."""
    values = {"offset": MeasuredValue.of([fit.offset for fit in fits], "N", offset_type_b)}
    drifts = [fit.drift for fit in fits if fit.drift is not None]
    if drifts:
        values["drift"] = MeasuredValue.of(drifts, "N/s")
    stretches = [stretch for fit in fits for stretch in fit.stretches]
    values["force_std"] = MeasuredValue.of([stretch.force_std for stretch in stretches], "N")
    values["position_std"] = MeasuredValue.of([stretch.position_std for stretch in stretches], "m")
    speeds = [stretch.velocity_std for stretch in stretches if stretch.velocity_std is not None]
    if speeds:
        values["velocity_std"] = MeasuredValue.of(speeds, "m/s")
    return values


@dataclass(frozen=True)
class OctaveNoise:
    """Noise at standstill by octaves."""

    unit: str  # of the density, per root hertz
    frequencies: tuple[float, ...]  # [Hz] middle of each octave
    densities: tuple[float, ...]  # root of the one-sided power density in it


def noise_spectrum(spectrum: OctaveNoise) -> NoiseSpectrum:
    """Return a spectrum in a calibration file."""
    return NoiseSpectrum(unit=spectrum.unit, frequencies=spectrum.frequencies, densities=spectrum.densities)


def spectra(records: Sequence[CalibrationRecord], segments: Sequence[Segment]) -> dict[str, OctaveNoise]:
    """Return the noise of force, position and velocity at standstill, the mean power of one stretch of each record.

    The integral of the squared density over frequency is the variance, so `force_std` and its like are the same
    numbers: the spectrum says whether they are white.
    """
    by_role = {}
    for role, unit in (("force", "N"), ("position", "m"), ("velocity", "m/s")):
        tracks = [getattr(record, role) for record in records]
        if any(track is None for track in tracks):
            continue
        values = [track.between(s.begin, s.end)[1] for track, s in zip(tracks, segments, strict=True)]
        by_role[role] = _spectrum([track.rate for track in tracks], values, unit)
    return by_role


def _spectrum(rates: Sequence[float], values: Sequence[Floats], unit: str) -> OctaveNoise:
    """Return the mean spectrum of records (n,) at rates [Hz], by octaves below half of the mean rate."""
    length = min(map(len, values))
    rate = float(np.mean(rates))
    power = np.mean([_periodogram(record[:length], rate) for record in values], axis=0)
    grid = np.fft.rfftfreq(length, 1.0 / rate)
    edges = rate / 2 * 2.0 ** np.arange(-int(np.log2(length / _MIN_BINS)), 1)
    middles, densities = [], []
    for low, high in pairwise([0.0, *edges]):
        inside = (grid > low) & (grid <= high)
        middles.append(float(np.sqrt(low * high)) if low > 0 else float(high / 2))
        densities.append(float(np.sqrt(power[inside].mean())))
    return OctaveNoise(f"{unit}/sqrt(Hz)", tuple(middles), tuple(densities))


def _periodogram(values: Floats, rate: float) -> Floats:
    """Return the one-sided power density [unit^2/Hz] of a record at standstill, without its straight line."""
    line = np.linspace(-1.0, 1.0, len(values))
    level = values - values.mean()
    level = level - line * (line * level).sum() / (line**2).sum()
    return np.asarray(np.abs(np.fft.rfft(level)) ** 2 * 2.0 / (rate * len(values)))


def _stretch(record: CalibrationRecord, segment: Segment) -> StandstillStretch:
    """Return offset and noises of one stretch."""
    force = record.force.between(segment.begin, segment.end)[1]
    velocity = None
    if record.velocity is not None:
        velocity = _white_std(record.velocity.between(segment.begin, segment.end)[1])
    return StandstillStretch(
        (segment.begin + segment.end) / 2,
        RepeatValue(*mean_with_std(force)),
        _white_std(force),
        velocity,
        _white_std(record.position.between(segment.begin, segment.end)[1]),
        _colour(force),
    )


def _white_std(values: Floats) -> RepeatValue:
    """Return the standard deviation of one reading about a straight line, sigma +- sigma/sqrt(2 (n - 2))."""
    n = len(values)
    t = np.linspace(-1.0, 1.0, n)
    scatter = values - values.mean() - t * (t * values).sum() / (t**2).sum()
    std = float(np.sqrt((scatter**2).sum() / (n - 2)))
    return RepeatValue(std, std / np.sqrt(2.0 * (n - 2)), n - 2.0)


def _colour(force: Floats) -> float:
    """Return the power of slow noise over that of all noise, 1 where it is white.

    Much above 1 the noise does not average out by the number of readings.
    """
    line = np.linspace(-1.0, 1.0, len(force))
    level = force - force.mean()
    power = np.abs(np.fft.rfft(level - line * (line * level).sum() / (line**2).sum()))[1:] ** 2
    slow = power[: max(len(power) // _SLOW_PARTS, 1)]
    return float(slow.mean() / power.mean()) if power.any() else 1.0


def _drift(stretches: Sequence[StandstillStretch]) -> RepeatValue | None:
    """Return the slope of the offsets over time, weighted by their uncertainty; None of a single one."""
    if len(stretches) < 2:
        return None
    t = np.array([stretch.time for stretch in stretches])
    y = np.array([stretch.offset.value for stretch in stretches])
    w = np.array([max(stretch.offset.std, _SMALLEST_STD) ** -2 for stretch in stretches])
    since = t - (w * t).sum() / w.sum()
    information = float((w * since**2).sum())
    freedom = sum(stretch.offset.freedom for stretch in stretches)
    return RepeatValue(float((w * since * y).sum() / information), information**-0.5, freedom)
