"""The noise of the force: of the air around a contact, of the last digit, or of the upper band of a residual."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from palpate import Floats, LastDigit, SampleStore, TrackEvidence

from palpate_uncertainty.channel_noise import null_of

AIR, READINGS = 0.2, 100  # [s] and readings without contact that determine the noise
REST = 6.0  # standard deviations of the height at rest; a tip that is farther off moves
_AIR_HEIGHT_SHARE = 0.05  # of the way in contact, above which the air before it is air
_BAND_BEGIN = 0.125  # of the band, from which on what a model leaves is noise
_FLATNESS_RATIO = 1.5  # by which parts of a flat band differ at most
_FLATNESS_DEVIATIONS = 3.8  # standard deviations, the same of few readings
_MIN_CHANGE_SHARE = 0.7  # of the readings, fewer of which differ from the one before where a sensor is held
_HANN_VARIANCE = 1.94  # variance of the mean of lines of a Hann window, of that of independent ones (Harris 1978)
LAW_ROUNDING = 2e-6  # of the range of the force, that a fit of a computed force leaves where contact sets in
_MIN_STEP_NOISES = 0.5  # of the noise, above which a step of the readings counts in addition


@dataclass(frozen=True)
class ForceNoise:
    """The noise of the force, as an autoregression of white noise."""

    std: float  # [N]
    coefficients: Floats  # (p,) of the autoregression; empty: white
    readings: int  # that determine it
    excess: float = 1.0  # of the variance of slow means, by what is not known of the coefficients

    @classmethod
    def of(cls, track: TrackEvidence, left: Floats) -> ForceNoise | None:
        """From standstill, else from the air before the contact, else from the upper band of what is left (n,) [N].

        Where the last digit exceeds all of these, it is the noise. None where it is open.
        """
        if (rounding := rounding_noise(track)) is not None:
            return rounding
        rest = air_readings(track)
        if rest is None:
            return upper_band(left, track.kept.force)
        null, std = null_of(rest), float(np.std(rest, ddof=1))
        steps, digit = np.abs(np.diff(track.kept.force)), LastDigit.of(track.kept.force)
        share = float(np.mean(steps == 0)) if len(steps) else 0.0
        if (
            share > 0.02 or digit.step > _MIN_STEP_NOISES * std
        ):  # readings in steps: those add noise that the air need not show
            std = float(np.hypot(std, digit.noise))
        return cls(std, null.coefficients, len(rest), null.excess) if std > 0 else None

    def spectrum(self, n: int) -> Floats:
        """Power (m,) [N^2] over the frequencies of a real transform of n points."""
        inverse = np.abs(np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), n)) ** -2
        # Over all n frequencies the mean is the variance.
        whole = 2.0 * inverse.sum() - inverse[0] - (inverse[-1] if n % 2 == 0 else 0.0)
        return np.asarray(inverse * self.std**2 * n / whole)


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
    """Force (n,) [N] without contact that shows the noise: at standstill, else on the way; None where it is short."""
    known = np.isfinite(track.air_force)
    time, force, place = track.air_time[known], track.air_force[known], track.air_position[known]
    if len(time) < READINGS:
        return None
    until = standstill_count(time, place)
    if until < READINGS or time[until - 1] - time[0] < AIR:
        kept = track.kept.position
        way = track.surface - float(np.nanmin(kept)) if len(kept) else 0.0
        near = place < track.surface + _AIR_HEIGHT_SHARE * way
        until = int(np.argmax(near)) if near.any() else len(place)
    if until < READINGS or time[until - 1] - time[0] < AIR:
        return None
    return np.asarray(force[:until])


def standstill_count(time: Floats, place: Floats) -> int:
    """Return how many of the first readings, at times (n,) [s] and heights (n,) [m], are of a tip at rest.

    A tip moves where it is off the mean of the first moments by more than heights scatter there about a line, and by
    more than their resolution. It does not begin at rest where that line rises by as much.
    """
    known = np.isfinite(place)
    if not known.any():
        return len(place)
    # The first moments: as long as is needed to determine a noise.
    window = known & (np.arange(len(place)) < READINGS) | known & (time <= time[0] + AIR)
    if not window.any():
        return 0
    centred, level = time[window] - np.mean(time[window]), float(np.mean(place[window]))
    slope = float(centred @ place[window]) / max(float(centred @ centred), 1e-300)
    scatter = float(np.std(place[window] - level - slope * centred))
    steps = np.abs(np.diff(place[known]))
    limit = REST * scatter + float(np.min(steps[steps > 0], initial=np.inf) if (steps > 0).any() else 0.0)
    if abs(slope) * float(np.ptp(centred)) > limit:
        return 0
    moving = np.abs(place - level) > limit
    return int(np.argmax(moving)) if moving.any() else len(place)


def upper_band(left: Floats, readings: Floats) -> ForceNoise | None:
    """White noise of at most the power of the upper band of what a model has left (n,) [N] of readings (m,) [N].

    None where that is not flat, or below the step of the readings. A few samples show little of how flat it is.
    """
    steps = np.abs(np.diff(readings))
    if len(left) < READINGS or not np.isfinite(left).all() or np.count_nonzero(steps) < _MIN_CHANGE_SHARE * len(steps):
        return None
    window = np.hanning(len(left))
    power = np.abs(np.fft.rfft(np.diff(left, 2) * window[1:-1])) ** 2 / float(window @ window)
    angle = np.linspace(0.0, np.pi, len(power))[int(_BAND_BEGIN * len(power)) :]
    band = power[-len(angle) :] / (2.0 * np.sin(angle / 2.0)) ** 4
    parts = [float(np.mean(part)) for part in np.array_split(band, 4)]
    flat = max(_FLATNESS_RATIO, float(np.exp(_FLATNESS_DEVIATIONS * np.sqrt(_HANN_VARIANCE * 4 / len(band)))))
    if max(parts) > flat * min(parts) or not float(steps[steps > 0].min()) < min(parts) ** 0.5:
        return None
    return ForceNoise(max(parts) ** 0.5, np.zeros(0), len(band))
