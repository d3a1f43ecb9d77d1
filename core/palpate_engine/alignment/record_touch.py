"""The first touch in a record whose own noise says what counts as touch: what inertia, drift and travel cannot be.

Thresholds are choices of decisions 0375, 0392 and 0481, which state the rates of both errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate.estimation import Samples
from palpate.vectors import Floats

from palpate_engine.alignment.air_line import FIRST_READINGS, MIN_AIR, ROBOT_FORCE
from palpate_engine.alignment.aliased_hum import residual_of_hum
from palpate_engine.alignment.change_point import samples_as_one, shortest_descent, white_noise
from palpate_engine.alignment.contact_threshold import SAMPLES_IN_A_ROW, run_lengths
from palpate_engine.alignment.touch_fit import (
    Averages,
    TouchFit,
    air_terms,
    averaged,
    basis_of,
    fit_touch,
    with_acceleration,
)

_LOOK_INTERVAL, _LOOK_SHARE = 16, 32  # samples between two looks: at least so many, and so great a part of all
_MAX_ROWS = 1024  # means of the record that are looked at together
_RESOLUTION_READINGS = 4096  # latest readings, whose steps are looked at

# Forces in air.
_DRIFT = 0.05  # [N/s] of a sensor that warms up; a press of 1 N takes less than 20 s
_CABLE = 2.0  # [N/m] of a cable that the tip pulls along
_BENDS = 2.0  # waves over the readings, of an optical lever's baseline (1 in 3 um of travel is usual)

# What a touch has to explain.
_MIN_GAIN = 100.0  # variances of the noise, by which it lowers the sum of squares: ten sigma, jointly
_MIN_GAIN_OVER_WAVE = 16.0  # the same in addition to the best wave, of hum or of a line that bends
_MIN_RISE = 3.0  # steps of the resolution, by which what only contact explains rises
_MAX_NOISE_RATIO = 2.0  # standard deviations of the noise, that law or hum may leave
_MAX_MISFIT_SHARE = 0.2  # of its rise, that the law may leave in addition
_MAX_MISFIT_SHARE_WITHOUT_AIR = 0.03  # the same of a record that begins in contact: a cone leaves so much, a wave more
_PART_COUNTS = (8, 32)  # of parts of a residual, whose means show how many readings count as one


@dataclass(frozen=True)
class RecordTouch:
    """Begin of contact in a stretch that shows it."""

    begin: int  # index of the first sample below the surface
    surface: float  # [m]
    step: float  # [N] resolution of the force; 0: none shows
    noise: float  # [N] of one reading, by the third differences of all of them


class TouchSearch:
    """Looks for the first touch at set numbers of samples from the record's begin, however they arrive."""

    def __init__(self, max_mass: float) -> None:
        self._max_mass = max_mass  # [kg]
        self._look_end = 0  # samples of the last look
        self._has_shown = False  # True if the last look showed contact
        self.due = FIRST_READINGS  # samples at which the next look is taken

    def next_touch(self, samples: Samples, final: bool) -> RecordTouch | None:
        """Return the touch that two looks in a row show, by all samples of the record so far; None until then.

        Where `final`, a look at the end is the last.
        """
        while self.due <= len(samples) or (final and self._look_end < len(samples)):
            self._look_end = min(self.due, len(samples))
            touch = record_touch(samples[: self._look_end], self._max_mass)
            self.due += max(_LOOK_INTERVAL, self.due // _LOOK_SHARE)
            if touch is not None and self._has_shown:
                return touch
            self._has_shown = touch is not None
        return None

    def of_record(self, samples: Samples) -> RecordTouch | None:
        """Return the touch by all samples of a record that has ended; it may begin in contact."""
        return record_touch(samples, self._max_mass, _MAX_MISFIT_SHARE_WITHOUT_AIR)

    def is_air(self, samples: Samples) -> bool:
        """Return True if a record without a touch has no more force than air may give, or hum explains it."""
        finite = samples[np.isfinite(samples.force) & np.isfinite(samples.position)]
        averages = Averages(finite.time, finite.force, finite.position)
        if len(finite) > MIN_AIR:
            averages = with_acceleration(averages)
        is_weak = float(np.ptp(finite.force)) < _air_range(finite.position, averages.acceleration, self._max_mass)
        return is_weak or _is_hum(finite)


def record_touch(samples: Samples, max_mass: float, max_misfit: float = _MAX_MISFIT_SHARE) -> RecordTouch | None:
    """Return the touch that samples from a record's begin show; None where air explains them as well.

    Air is F = b + s t + k z - m a + noise with m from 0 to `max_mass` [kg]: the sensor's zero and its drift, a cable
    or a tilt, the inertia of what hangs behind the sensor. Contact adds c (z_s - z)^1.5 below z_s. A touch lowers the
    sum of squares by the square of ten standard deviations of the noise in the air before, whatever m, and leaves no
    more than a share `max_misfit` of its rise.
    """
    # Readings that go down by more than their noise.
    rows = np.flatnonzero(np.isfinite(samples.force) & np.isfinite(samples.position))
    if len(rows) < 2 * MIN_AIR:
        return None
    readings = samples[rows]
    height, force = readings.position, readings.force
    height_range = float(np.ptp(height))
    min_descent = shortest_descent(height, height_range)
    if not height_range > min_descent or not float(np.ptp(force)) > 0.0:
        return None

    # Air and contact, fitted to the means of blocks.
    size = _block_size(len(rows))
    averages = averaged(readings, size)
    if max_mass > 0.0:
        averages = with_acceleration(averages)
    fit = fit_touch(averages, max_mass)
    if fit is None or fit.surface - float(averages.height.min()) < min_descent:
        return None

    # Contact is what air is not: not before it, not by noise, not by a wave.
    noise, step = white_noise(force), resolution(force)
    first = int(np.argmax(averages.height < fit.surface))
    if not _is_air_before(averages, first, max_mass):
        return None
    variance = _noise_variance(fit.residual, first, noise / np.sqrt(size), step)
    if not _is_significant(fit, first, variance, step, max_misfit):
        return None
    # Where a mass is set in motion, what it leaves would pass for noise, and any press for a bent line.
    bends = _BENDS if averages.acceleration is None else 0.0
    if _gain_over_wave(averages.time, fit, _interval(readings), bends) < _MIN_GAIN_OVER_WAVE * variance:
        return None

    # The first of some samples in a row below the surface.
    is_lasting = run_lengths(height < fit.surface, 0) >= SAMPLES_IN_A_ROW
    if not is_lasting.any():
        return None
    begin = int(rows[int(np.argmax(is_lasting)) - SAMPLES_IN_A_ROW + 1])
    # Rounding to a step has the variance step^2 / 12.
    return RecordTouch(begin, fit.surface, step, max(noise, step / np.sqrt(12.0)))


def _block_size(count: int) -> int:
    """Return how many of `count` readings make a mean."""
    return -(-count // _MAX_ROWS)


def _is_air_before(averages: Averages, first: int, max_mass: float) -> bool:
    """Return True if the force before a touch changes by no more than drift, and travel through air, may give.

    A tip that moves in contact from the start on changes it by more.
    """
    if not first:
        return True
    drift = _DRIFT * float(averages.time[first - 1] - averages.time[0])
    air_range = _air_range(averages.height[:first], averages.acceleration, max_mass)
    return float(np.ptp(averages.force[:first])) < air_range + drift


def _air_range(height: Floats, acceleration: Floats | None, max_mass: float) -> float:
    """Return the range of force [N] that a robot's own, a cable and inertia may give without drift."""
    inertia = 0.0 if acceleration is None else max_mass * float(np.ptp(acceleration))
    return ROBOT_FORCE + _CABLE * float(np.ptp(height)) + inertia


def _noise_variance(residual: Floats, first: int, noise: float, step: float) -> float:
    """Return the variance [N2] of a mean: by third differences, by the air before a touch, and by the resolution.

    The largest of the three; the last two times the number of readings that count as one.
    """
    air = residual[:first]
    air_variance = float(air @ air) / len(air) * _readings_as_one(air) if len(air) else 0.0
    return max(noise**2, air_variance, step**2 / 12.0 * _readings_as_one(residual))


def _is_significant(fit: TouchFit, first: int, variance: float, step: float, max_misfit: float) -> bool:
    """Return True if a law explains far more than noise and resolution, and leaves little of the contact."""
    contact = fit.residual[first:]
    rms = float(np.sqrt(contact @ contact / len(contact)))
    if fit.gain < _MIN_GAIN * variance or fit.rise < _MIN_RISE * step:
        return False
    return rms <= _MAX_NOISE_RATIO * float(np.sqrt(variance)) + max_misfit * fit.rise


def _gain_over_wave(time: Floats, fit: TouchFit, interval: float, bends: float) -> float:
    """Return by how much [N2] contact lowers the sum of squares in addition to a wave, of hum or of air that bends.

    Infinite where neither is possible.
    """
    air_cost = residual_of_hum(time, fit.air_basis, fit.air_residual, interval, bends)
    if not np.isfinite(air_cost):
        return air_cost
    law = fit.air_residual - fit.residual
    basis = np.column_stack([fit.air_basis, law / np.linalg.norm(law)])
    return air_cost - residual_of_hum(time, basis, fit.residual, interval, bends)


def _is_hum(samples: Samples) -> bool:
    """Return True if drift, travel and a wave that hum may be leave of the force no more than its noise."""
    if len(samples) < 2 * MIN_AIR:
        return False
    size = _block_size(len(samples))
    averages = averaged(samples, size)
    basis = basis_of(air_terms(averages))
    residual = averages.force - basis @ (basis.T @ averages.force)
    cost = residual_of_hum(averages.time, basis, residual, _interval(samples))
    return cost < len(averages.time) * (_MAX_NOISE_RATIO * white_noise(samples.force)) ** 2 / size


def _interval(samples: Samples) -> float:
    """Return the mean interval [s] of samples."""
    return float(samples.time[-1] - samples.time[0]) / (len(samples) - 1)


def resolution(values: Floats) -> float:
    """Return the step of values (n,) that repeat, as those that an instrument rounds; 0 where they do not."""
    latest = values[-_RESOLUTION_READINGS:]
    levels = np.unique(latest)
    if len(levels) < 2 or len(levels) > 0.5 * len(latest):
        return 0.0
    return float(np.median(np.diff(levels)))


def _readings_as_one(residual: Floats) -> float:
    """Return how many readings count as one, by the parts that show most."""
    return max((samples_as_one(residual, parts) for parts in _PART_COUNTS if len(residual) >= parts), default=1.0)
