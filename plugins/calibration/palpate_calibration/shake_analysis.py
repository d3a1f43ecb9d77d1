"""A shake in free air: the tip's mass and the time between force and motion, from u = m d''."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats, LogError

from palpate_calibration.calibrated_value import RepeatValue
from palpate_calibration.calibration_record import CalibrationRecord
from palpate_calibration.motion_segments import Segment, SteadyMotion
from palpate_calibration.sines import SineFit, find_lines, harmonics_of, sine_fit

_QUARTER = 0.25  # of a period: a phase beyond it is a mass below zero
_MEAN_SAMPLES = 21  # of the paper's moving average
# Choices.
_MAX_RELATIVE_STD = 0.1  # of the mass by a line; a weaker line says nothing
_COVERAGE = 3.0  # standard uncertainties of a delay, within which it may be less than a quarter of a period
_MAX_DEVIATIONS = 5.0  # standard uncertainties between the masses or delays of two lines
_MAX_DEVIATION = 0.02  # of a value, likewise; less does not matter
_HARMONIC_DEVIATIONS = 6.0  # standard uncertainties of a harmonic that is not by chance
_MAX_HARMONIC = 0.01  # of the swing, likewise; less does not matter
_SAMPLES_PER_PERIOD = 2.5  # at least, of a harmonic that is looked at
_SMALLEST, _SMALLEST_STD = 1e-300, 1e-15  # in quotients, in place of 0


@dataclass(frozen=True)
class ShakeFit:
    """Results of one shake."""

    frequencies: tuple[float, ...]  # [Hz]
    amplitudes: tuple[float, ...]  # [m] of the real motion
    mass: RepeatValue  # [kg]
    delay: RepeatValue  # [s] the force is stamped later than the position
    velocity_delay: RepeatValue | None  # [s] the velocity is stamped later than the position
    offset: float  # [N] mean reading
    swing: float  # [N] RMS of the inertia
    residual: float  # [N] RMS of the force that mass and delay do not explain
    paper_velocity_std: RepeatValue | None  # [m/s] RMSE of the velocity against its 21-sample mean
    planned: SteadyMotion  # where the arm moved as planned


def shake_fit(record: CalibrationRecord, segment: Segment, frequencies: tuple[float, ...] = ()) -> ShakeFit:
    """Return mass and delay from one shake of a tip in free air.

    `frequencies` [Hz] of the motion, which are sought in its spectrum where none is given.
    With the phasors Z of the height and U of the force (positive where it pushes the tip out) at each frequency,
    u = m d'' = -m z'' gives U/Z = m omega^2 exp(-i omega tau), hence mass from the modulus and the delay tau of the
    force from the phase, both with the uncertainty of the two sine fits; several frequencies are averaged by weight.
    Where the arm hesitates its motion is not a sine: the readings are left out. They are not where that would be over
    half of them: over the whole of any motion the ratio holds as well, with a larger residual.
    Raises LogError where the motion is not a sine, where it is too small, or where the tip is not in free air.
    Source: paper, mass identification (F = m a); the delay is beyond the paper.
    """
    # The lines of the motion, without hesitations of the arm.
    times, heights = record.position.between(segment.begin, segment.end)
    planned = SteadyMotion.of(record, segment)
    lines = frequencies or find_lines(times, heights, planned.hold(times))
    if not lines:
        raise LogError("calibration: the motion holds no sine")

    # Phasors of height and force. A tip that touches now and then is pushed in harmonics, which a mass has only where
    # the motion has them.
    max_frequency = min(record.force.rate, record.position.rate) / _SAMPLES_PER_PERIOD
    fitted_lines = (*lines, *harmonics_of(lines, max_frequency, segment.length))
    motion = sine_fit(times, heights, fitted_lines, _middle(segment), planned.hold(times))
    force = _force_fit(record, segment, planned, motion, fitted_lines, len(lines))
    _refuse_noise(motion, force, lines)

    # Mass and delay by the lines that stand well out of the noise.
    max_variances = (2 * _MAX_RELATIVE_STD * np.abs(force.phasors)) ** 2
    strong = [k for k in range(len(lines)) if force.variances[k] < max_variances[k]]
    masses, delays = _by_line(motion, force, lines, strong)
    mass, delay = _average(masses), _average(delays)
    _refuse_contact(mass, masses, delays, tuple(lines[k] for k in strong))

    # The force that they do not explain.
    swing = float(np.sqrt((np.abs(force.phasors[: len(lines)]) ** 2).sum() / 2))
    unexplained = _unexplained(motion, force, fitted_lines, mass.value, delay.value)
    _refuse_harmonics(unexplained[len(lines) :], force, fitted_lines, swing)
    residual = math.sqrt(float(np.mean(force.residual**2)) + float((unexplained**2).sum()) / 2)
    velocity_delay, paper_velocity_std = _velocity_values(record, segment, planned, motion, lines)
    return ShakeFit(
        frequencies=lines,
        amplitudes=tuple(float(abs(z)) for z in motion.phasors[: len(lines)]),
        mass=mass,
        delay=delay,
        velocity_delay=velocity_delay,
        offset=force.offset,
        swing=swing,
        residual=residual,
        paper_velocity_std=paper_velocity_std,
        planned=planned,
    )


def _middle(segment: Segment) -> float:
    """Return the time [s] to which the phases of a shake refer."""
    return (segment.begin + segment.end) / 2


def _force_fit(
    record: CalibrationRecord,
    segment: Segment,
    planned: SteadyMotion,
    motion: SineFit,
    fitted_lines: tuple[float, ...],
    line_count: int,
) -> SineFit:
    """Return the sines of the force at the lines of the motion, and at harmonics, which follow the first `line_count`.

    `planned.hold` is True at the times at which the arm moved as planned, without a hesitation.
    A late force hesitates later than the arm: its readings are left out at times that are later by the delay of its
    strongest line, in a second fit.
    """
    times, readings = record.force.between(segment.begin, segment.end)
    force = sine_fit(times, readings, fitted_lines, _middle(segment), planned.hold(times))
    if not planned.count:
        return force
    strongest = int(np.argmax(np.abs(force.phasors[:line_count])))
    phase = float(np.angle(force.phasors[strongest] / motion.phasors[strongest]))
    lateness = -phase / (2 * math.pi * fitted_lines[strongest])
    return sine_fit(times, readings, fitted_lines, _middle(segment), planned.hold(times - lateness))


def _velocity_values(
    record: CalibrationRecord, segment: Segment, planned: SteadyMotion, motion: SineFit, lines: tuple[float, ...]
) -> tuple[RepeatValue | None, RepeatValue | None]:
    """Return the delay [s] of a measured velocity, and its noise [m/s] as in the paper; None without a velocity."""
    if record.velocity is None:
        return None, None
    times, speeds = record.velocity.between(segment.begin, segment.end)
    used = planned.hold(times)
    velocity = sine_fit(times, speeds, lines, _middle(segment), used)
    return _velocity_delay(motion, velocity, lines), against_average(speeds, used)


def _by_line(
    motion: SineFit, force: SineFit, lines: tuple[float, ...], strong: list[int]
) -> tuple[list[RepeatValue], list[RepeatValue]]:
    """Return masses and delays by the lines that stand well out of the noise: the modulus of a weak one is biased.

    `strong` are the rows of these lines. The relative variances of both phasors add; the degrees of freedom are those
    of Welch and Satterthwaite.
    """
    masses, delays = [], []
    for k in strong:
        omega = 2 * math.pi * lines[k]
        z, u = motion.phasors[k], force.phasors[k]
        ratio = u / z / omega**2
        relative_variances = float(force.variances[k] / abs(u) ** 2), float(motion.variances[k] / abs(z) ** 2)
        relative_std = math.sqrt(sum(relative_variances))
        freedom = sum(relative_variances) ** 2 / (
            relative_variances[0] ** 2 / force.freedom[k] + relative_variances[1] ** 2 / motion.freedom[k] + _SMALLEST
        )
        masses.append(RepeatValue(float(abs(ratio)), float(abs(ratio)) * relative_std, float(freedom)))
        # The noise bias of a modulus, half the relative variance of the noisy force, is far below its uncertainty.
        delays.append(RepeatValue(-float(np.angle(ratio)) / omega, relative_std / omega, float(freedom)))
    return masses, delays


def _average(parts: list[RepeatValue]) -> RepeatValue:
    """Return the mean of values, weighted by their uncertainties."""
    weights = np.array([max(part.std, _SMALLEST_STD) ** -2 for part in parts])
    values = np.array([part.value for part in parts])
    mean = float((weights * values).sum() / weights.sum())
    return RepeatValue(mean, float(weights.sum() ** -0.5), sum(part.freedom for part in parts))


def _refuse_noise(motion: SineFit, force: SineFit, lines: tuple[float, ...]) -> None:
    """Raise LogError where no line stands out of the force's noise."""
    signal = np.abs(force.phasors[: len(lines)])
    noise = np.sqrt(force.variances[: len(lines)])
    if (noise / np.maximum(signal, _SMALLEST)).min() > _MAX_RELATIVE_STD:
        best = int(np.argmax(signal / np.maximum(noise, _SMALLEST)))
        raise LogError(
            f"calibration: the amplitude is too small: at {lines[best]:.3g} Hz and "
            f"{abs(motion.phasors[best]) * 1e3:.3g} mm the force swings by {signal[best]:.3g} N, and its noise there "
            f"is {noise[best]:.3g} N; shake further, faster or longer"
        )


def _refuse_contact(
    mass: RepeatValue, masses: list[RepeatValue], delays: list[RepeatValue], lines: tuple[float, ...]
) -> None:
    """Raise LogError where the force is not that of a mass.

    That is where it lags by more than a quarter of a period, or where the lines differ in the mass or the delay.
    """
    for delay, frequency in zip(delays, lines, strict=True):
        # A weak line's phase says little; the strong ones decide.
        if abs(delay.value) - _COVERAGE * delay.std > _QUARTER / frequency:
            raise LogError(
                f"calibration: at {frequency:.3g} Hz the force falls where the tip is pushed out: either the tip is in "
                "contact, or [alignment] force needs sign = -1, or the delay is beyond a quarter of the period"
            )
    for name, parts, scale in (("mass", masses, mass.value), ("delay", delays, _QUARTER / max(lines))):
        for i, first in enumerate(parts):
            for second in parts[:i]:
                gap = abs(first.value - second.value)
                if gap > max(_MAX_DEVIATIONS * math.hypot(first.std, second.std), _MAX_DEVIATION * scale):
                    raise LogError(
                        f"calibration: no single {name} explains the force at {lines[i]:.3g} Hz and at the other "
                        f"frequencies ({first.value:.4g} and {second.value:.4g}): the tip is in contact, or the "
                        "sensor filters"
                    )


def _unexplained(motion: SineFit, force: SineFit, lines: tuple[float, ...], mass: float, delay: float) -> Floats:
    """Return the modulus (k,) [N] of the force at each frequency that mass and delay do not explain."""
    omega = 2 * np.pi * np.array(lines)
    inertia = mass * omega**2 * np.exp(-1j * omega * delay) * motion.phasors
    return np.asarray(np.abs(force.phasors - inertia), np.float64)


def _refuse_harmonics(harmonics: Floats, force: SineFit, frequencies: tuple[float, ...], swing: float) -> None:
    """Raise LogError where the force has a harmonic (k,) [N] that the motion does not have."""
    first = len(frequencies) - len(harmonics)
    for modulus, variance, frequency in zip(harmonics, force.variances[first:], frequencies[first:], strict=True):
        if modulus > max(_HARMONIC_DEVIATIONS * math.sqrt(variance), _MAX_HARMONIC * swing):
            raise LogError(
                f"calibration: the force has {modulus:.3g} N at {frequency:.3g} Hz, a harmonic that the motion does "
                "not explain: the tip is in contact, or touches something at times"
            )


def _velocity_delay(motion: SineFit, velocity: SineFit, lines: tuple[float, ...]) -> RepeatValue:
    """Return the delay tau [s] of the velocity against the height by V/Z = i omega exp(-i omega tau), of all lines."""
    delays = []
    for k, frequency in enumerate(lines):
        omega = 2 * math.pi * frequency
        z, v = motion.phasors[k], velocity.phasors[k]
        relative = math.sqrt(motion.variances[k] / abs(z) ** 2 + velocity.variances[k] / abs(v) ** 2)
        angle = float(np.angle(v / (1j * omega * z)))
        delays.append(RepeatValue(-angle / omega, relative / omega, float(velocity.freedom[k])))
    return _average(delays)


def against_average(values: Floats, used: NDArray[np.bool_]) -> RepeatValue | None:
    """Return the RMSE between a signal (n,) and its centred 21-sample mean, the paper's noise, +- itself/sqrt(2 n)."""
    if len(values) < 3 * _MEAN_SAMPLES:
        return None
    mean = np.convolve(values, np.ones(_MEAN_SAMPLES) / _MEAN_SAMPLES, "valid")
    is_whole = np.convolve(used, np.ones(_MEAN_SAMPLES), "valid") > _MEAN_SAMPLES - 0.5  # of a count: all are used
    half, count = _MEAN_SAMPLES // 2, int(np.count_nonzero(is_whole))
    rmse = float(np.sqrt(np.mean((values[half:-half] - mean)[is_whole] ** 2)))
    return RepeatValue(rmse, rmse / math.sqrt(2 * count), count)
