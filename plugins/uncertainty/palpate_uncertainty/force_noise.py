"""The noise of the force: of the air around a contact, of the last digit, or of the upper band of a residual."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from palpate import Floats, LastDigit, SampleStore, TrackEvidence

from palpate_uncertainty.channel_noise import null_of

# Choices, unless a source is named. A record with air in plenty, or a flat band, does not come near most of them.
AIR = 0.2  # [s] without contact that determines the noise
MIN_READINGS = 100  # without contact that determine the noise
REST = 6.0  # standard deviations of the height at rest; a tip that is farther off moves
_AIR_HEIGHT_SHARE = 0.05  # of the way in contact, above which the air before it is air
_BAND_BEGIN = 0.125  # of the band, from which on the residual of a model is noise
_BAND_PARTS = 4  # of the band, whose powers are compared
_FLATNESS_RATIO = 1.5  # by which parts of a flat band differ at most
_FLATNESS_DEVIATIONS = 3.8  # standard deviations, the same of few readings
_MIN_CHANGE_SHARE = 0.7  # of the readings, fewer of which differ from the one before where a sensor is held
_MAX_REPEAT_SHARE = 0.02  # of the readings that equal the one before, above which the force comes in steps
# Lines of the power of a Hann window correlate by (2/3)^2 with the next ones, and by (1/6)^2 with those after them.
_HANN_VARIANCE = 1.94  # variance of their mean, of that of independent lines: 1 + 2 (4/9 + 1/36) (Harris 1978)
LAW_ROUNDING = 2e-6  # of the range of the force: the residual of a fit of a computed force where contact sets in
_MIN_STEP_NOISES = 0.5  # of the noise, above which a step of the readings counts in addition
_SMALLEST_SQUARE = 1e-300  # in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class ForceNoise:
    """The noise of the force, as an autoregression of white noise."""

    std: float  # [N]
    coefficients: Floats  # (p,) of the autoregression; empty: white
    readings: int  # that determine it
    excess: float = 1.0  # of the variance of slow means, by what is not known of the coefficients

    @classmethod
    def of(cls, track: TrackEvidence, residual: Floats) -> ForceNoise | None:
        """Return the noise at standstill, else of the air before the contact, else of a residual's (n,) [N] upper band.

        Where the last digit exceeds all of these, it is the noise. None where the noise remains open.
        """
        if (rounding := rounding_noise(track)) is not None:
            return rounding
        air = air_readings(track)
        if air is None:
            return upper_band(residual, track.kept.force)
        # The autoregression of the readings in air, and their standard deviation.
        null, std = null_of(air), float(np.std(air, ddof=1))
        # Readings in steps add noise that the air need not show.
        steps, digit = np.abs(np.diff(track.kept.force)), LastDigit.of(track.kept.force)
        repeat_share = float(np.mean(steps == 0)) if len(steps) else 0.0
        if repeat_share > _MAX_REPEAT_SHARE or digit.step > _MIN_STEP_NOISES * std:
            std = float(np.hypot(std, digit.noise))
        return cls(std, null.coefficients, len(air), null.excess) if std > 0 else None

    def spectrum(self, n: int) -> Floats:
        """Return the power (m,) [N^2] over the frequencies of a real transform of n points."""
        inverse = np.abs(np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), n)) ** -2
        # Over all n frequencies the mean is the variance.
        total = 2.0 * inverse.sum() - inverse[0] - (inverse[-1] if n % 2 == 0 else 0.0)
        return np.asarray(inverse * self.std**2 * n / total)


def rounding_noise(track: TrackEvidence) -> ForceNoise | None:
    """Return the noise of rounding where the last digit of the force exceeds all other noise; else None."""
    return _rounding_noise(track.kept)


@lru_cache(maxsize=2)  # several diagnoses of a track ask
def _rounding_noise(kept: SampleStore) -> ForceNoise | None:
    """Return the noise of rounding of kept samples; None where their force has more."""
    force = kept.force[np.isfinite(kept.force)]
    digit = LastDigit.of(force)
    if not digit.exceeds_noise(force):
        return None
    return ForceNoise(max(digit.noise, LAW_ROUNDING * float(np.ptp(force))), np.zeros(0), len(force))


def air_readings(track: TrackEvidence) -> Floats | None:
    """Return the force (n,) [N] without contact: at standstill, else on the way in; None where both are too short."""
    is_finite = np.isfinite(track.air_force)
    time, force, height = track.air_time[is_finite], track.air_force[is_finite], track.air_position[is_finite]
    if len(time) < MIN_READINGS:
        return None
    count = standstill_count(time, height)
    if count < MIN_READINGS or time[count - 1] - time[0] < AIR:  # else the way in, down to 5 % of the way in contact
        kept = track.kept.position
        way = track.surface - float(np.nanmin(kept)) if len(kept) else 0.0
        is_near = height < track.surface + _AIR_HEIGHT_SHARE * way
        count = int(np.argmax(is_near)) if is_near.any() else len(height)
    if count < MIN_READINGS or time[count - 1] - time[0] < AIR:
        return None
    return np.asarray(force[:count])


def standstill_count(time: Floats, height: Floats) -> int:
    """Return the number of first readings, at times (n,) [s] and heights (n,) [m], at which the tip is at rest.

    A tip moves if it is off the mean of the first moments by more than 6 times the scatter of the heights about a line
    there, plus their resolution. It does not begin at rest if that line rises by as much.
    """
    is_finite = np.isfinite(height)
    if not is_finite.any():
        return len(height)
    # The first moments: as long as a noise needs.
    window = is_finite & (np.arange(len(height)) < MIN_READINGS) | is_finite & (time <= time[0] + AIR)
    if not window.any():
        return 0
    # The line through them, and the scatter about it.
    centred, level = time[window] - np.mean(time[window]), float(np.mean(height[window]))
    slope = float(centred @ height[window]) / max(float(centred @ centred), _SMALLEST_SQUARE)
    scatter = float(np.std(height[window] - level - slope * centred))
    steps = np.abs(np.diff(height[is_finite]))
    resolution = float(np.min(steps[steps > 0], initial=np.inf) if (steps > 0).any() else 0.0)
    limit = REST * scatter + resolution
    if abs(slope) * float(np.ptp(centred)) > limit:
        return 0
    is_moving = np.abs(height - level) > limit
    return int(np.argmax(is_moving)) if is_moving.any() else len(height)


def upper_band(residual: Floats, readings: Floats) -> ForceNoise | None:
    """Return the white noise of a residual (n,) [N] of readings (m,) [N], by the upper band of its spectrum.

    The band has four parts; the noise is the power of the largest. None if the parts differ by more than 1.5 times and
    by more than 3.8 standard deviations of chance, if the standard deviation of the smallest is below the least step of
    the readings, if a sensor holds its readings, and of fewer than 100 samples.
    """
    steps = np.abs(np.diff(readings))
    is_held = np.count_nonzero(steps) < _MIN_CHANGE_SHARE * len(steps)
    if len(residual) < MIN_READINGS or not np.isfinite(residual).all() or is_held:
        return None
    # The spectrum of second differences over that of their filter, (2 sin(w/2))^4: of the residual, without leakage.
    window = np.hanning(len(residual))
    power = np.abs(np.fft.rfft(np.diff(residual, 2) * window[1:-1])) ** 2 / float(window @ window)
    angle = np.linspace(0.0, np.pi, len(power))[int(_BAND_BEGIN * len(power)) :]
    band = power[-len(angle) :] / (2.0 * np.sin(angle / 2.0)) ** 4
    parts = [float(np.mean(part)) for part in np.array_split(band, _BAND_PARTS)]
    deviation = np.sqrt(_HANN_VARIANCE * _BAND_PARTS / len(band))  # of the logarithm of a part's mean, by chance
    max_ratio = max(_FLATNESS_RATIO, float(np.exp(_FLATNESS_DEVIATIONS * deviation)))
    is_flat = max(parts) <= max_ratio * min(parts)
    is_above_step = min(parts) ** 0.5 > float(steps[steps > 0].min())
    if not (is_flat and is_above_step):
        return None
    return ForceNoise(std=max(parts) ** 0.5, coefficients=np.zeros(0), readings=len(band))
