"""Shaken in free air: the tip's mass and the time between force and motion, from u = m d''."""

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

_WEAK = 0.1  # a relative uncertainty of the mass above it says nothing
_QUARTER = 0.25  # of a period: a phase beyond it is a mass below zero
_APART = 5.0  # standard uncertainties between the masses or delays of two lines that cannot be one
_APART_AT_ALL = 0.02  # of a value; below it does not matter
_HARMONIC = 6.0  # standard uncertainties of a harmonic that is not due to chance
_HARMONIC_AT_ALL = 0.01  # of the swing; below it does not matter
_AVERAGED = 21  # samples, the paper's moving average


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
    planned: SteadyMotion


def shake_fit(record: CalibrationRecord, segment: Segment, frequencies: tuple[float, ...] = ()) -> ShakeFit:
    """Mass and delay from one shake of a tip in free air.

    With the phasors Z of the height and U of the force (positive where it pushes the tip out) at each frequency,
    u = m d'' = -m z'' gives U/Z = m omega^2 exp(-i omega tau), hence mass from the modulus and the delay tau of the
    force from the phase, both with the uncertainty of the two sine fits; several frequencies are averaged by weight.
    Where the arm hesitates its motion is not a sine: the readings are left out. They are not where that would be over
    half of them: over the whole of any motion the ratio holds as well, with a larger residual.
    Raises LogError where the motion is not a sine, where it is too small, or where the tip is not in free air.
    Source: paper, mass identification (F = m a); the delay is beyond the paper.
    """
    middle = (segment.begin + segment.end) / 2
    times, heights = record.position.between(segment.begin, segment.end)
    instants, readings = record.force.between(segment.begin, segment.end)
    planned = SteadyMotion.of(record, segment)
    lines = frequencies or find_lines(times, heights, planned.hold(times))
    if not lines:
        raise LogError("calibration: the motion holds no sine")
    # What touches now and then pushes in harmonics, which a mass has only where the motion has them.
    every = (*lines, *harmonics_of(lines, min(record.force.rate, record.position.rate) / 2.5, segment.length))
    motion = sine_fit(times, heights, every, middle, planned.hold(times))
    force = sine_fit(instants, readings, every, middle, planned.hold(instants))
    if planned.count:  # a late force hesitates later
        best = int(np.argmax(np.abs(force.phasors[: len(lines)])))
        late = -float(np.angle(force.phasors[best] / motion.phasors[best])) / (2 * math.pi * lines[best])
        force = sine_fit(instants, readings, every, middle, planned.hold(instants - late))
    _refuse_noise(motion, force, lines)
    strong = [k for k in range(len(lines)) if force.variances[k] < (2 * _WEAK * abs(force.phasors[k])) ** 2]
    masses, delays = _by_line(motion, force, lines, strong)
    mass, delay = _average(masses), _average(delays)
    _refuse_contact(mass, masses, delays, tuple(lines[k] for k in strong))
    swing = float(np.sqrt((np.abs(force.phasors[: len(lines)]) ** 2).sum() / 2))
    left = _unexplained(motion, force, every, mass.value, delay.value)
    _refuse_harmonics(left[len(lines) :], force, every, swing)
    velocity = velocity_std = None
    if record.velocity is not None:
        instants, speeds = record.velocity.between(segment.begin, segment.end)
        used = planned.hold(instants)
        velocity = _velocity_delay(motion, sine_fit(instants, speeds, lines, middle, used), lines)
        velocity_std = against_average(speeds, used)
    residual = math.sqrt(float(np.mean(force.residual**2)) + float((left**2).sum()) / 2)
    amplitudes = tuple(float(abs(z)) for z in motion.phasors[: len(lines)])
    return ShakeFit(lines, amplitudes, mass, delay, velocity, force.offset, swing, residual, velocity_std, planned)


def _by_line(
    motion: SineFit, force: SineFit, lines: tuple[float, ...], strong: list[int]
) -> tuple[list[RepeatValue], list[RepeatValue]]:
    """Mass and delay by each of the lines that stand well out of the noise: the modulus of a weak one is biased."""
    masses, delays = [], []
    for k in strong:
        omega = 2 * math.pi * lines[k]
        z, u = motion.phasors[k], force.phasors[k]
        ratio = u / z / omega**2
        shares = float(force.variances[k] / abs(u) ** 2), float(motion.variances[k] / abs(z) ** 2)
        relative = math.sqrt(sum(shares))
        freedom = sum(shares) ** 2 / (shares[0] ** 2 / force.freedom[k] + shares[1] ** 2 / motion.freedom[k] + 1e-300)
        masses.append(RepeatValue(float(abs(ratio)), float(abs(ratio)) * relative, float(freedom)))
        # The noise bias of a modulus, half the relative variance of the noisy force, is far below its uncertainty.
        delays.append(RepeatValue(-float(np.angle(ratio)) / omega, relative / omega, float(freedom)))
    return masses, delays


def _average(parts: list[RepeatValue]) -> RepeatValue:
    weights = np.array([max(part.std, 1e-15) ** -2 for part in parts])
    values = np.array([part.value for part in parts])
    mean = float((weights * values).sum() / weights.sum())
    return RepeatValue(mean, float(weights.sum() ** -0.5), sum(part.freedom for part in parts))


def _refuse_noise(motion: SineFit, force: SineFit, lines: tuple[float, ...]) -> None:
    """Raise LogError where no line stands out of the force's noise."""
    signal = np.abs(force.phasors[: len(lines)])
    noise = np.sqrt(force.variances[: len(lines)])
    if (noise / np.maximum(signal, 1e-300)).min() > _WEAK:
        best = int(np.argmax(signal / np.maximum(noise, 1e-300)))
        raise LogError(
            f"calibration: the amplitude is too small: at {lines[best]:.3g} Hz and "
            f"{abs(motion.phasors[best]) * 1e3:.3g} mm the force swings by {signal[best]:.3g} N, and its noise there "
            f"is {noise[best]:.3g} N; shake further, faster or longer"
        )


def _refuse_contact(
    mass: RepeatValue, masses: list[RepeatValue], delays: list[RepeatValue], lines: tuple[float, ...]
) -> None:
    """Raise LogError where the force is not that of a mass."""
    for delay, frequency in zip(delays, lines, strict=True):
        # A weak line's phase says little; the strong ones decide.
        if abs(delay.value) - 3 * delay.std > _QUARTER / frequency:
            raise LogError(
                f"calibration: at {frequency:.3g} Hz the force falls where the tip is pushed out: either the tip is in "
                "contact, or [alignment] force needs sign = -1, or the delay is beyond a quarter of the period"
            )
    for name, parts, scale in (("mass", masses, mass.value), ("delay", delays, _QUARTER / max(lines))):
        for i, first in enumerate(parts):
            for second in parts[:i]:
                gap = abs(first.value - second.value)
                if gap > max(_APART * math.hypot(first.std, second.std), _APART_AT_ALL * scale):
                    raise LogError(
                        f"calibration: no single {name} explains the force at {lines[i]:.3g} Hz and at the other "
                        f"frequencies ({first.value:.4g} and {second.value:.4g}): the tip is in contact, or the "
                        "sensor filters"
                    )


def _unexplained(motion: SineFit, force: SineFit, lines: tuple[float, ...], mass: float, delay: float) -> Floats:
    """Modulus (k,) [N] of the force at each frequency that mass and delay do not give."""
    omega = 2 * np.pi * np.array(lines)
    given = mass * omega**2 * np.exp(-1j * omega * delay) * motion.phasors
    return np.asarray(np.abs(force.phasors - given), np.float64)


def _refuse_harmonics(left: Floats, force: SineFit, lines: tuple[float, ...], swing: float) -> None:
    """Raise LogError where the force has a harmonic (k,) [N] that the motion does not have."""
    first = len(lines) - len(left)
    for modulus, variance, frequency in zip(left, force.variances[first:], lines[first:], strict=True):
        if modulus > max(_HARMONIC * math.sqrt(variance), _HARMONIC_AT_ALL * swing):
            raise LogError(
                f"calibration: the force has {modulus:.3g} N at {frequency:.3g} Hz, a harmonic that the motion does "
                "not explain: the tip is in contact, or touches something at times"
            )


def _velocity_delay(motion: SineFit, velocity: SineFit, lines: tuple[float, ...]) -> RepeatValue:
    """V/Z = i omega exp(-i omega tau) by line."""
    found = []
    for k, frequency in enumerate(lines):
        omega = 2 * math.pi * frequency
        z, v = motion.phasors[k], velocity.phasors[k]
        relative = math.sqrt(motion.variances[k] / abs(z) ** 2 + velocity.variances[k] / abs(v) ** 2)
        angle = float(np.angle(v / (1j * omega * z)))
        found.append(RepeatValue(-angle / omega, relative / omega, float(velocity.freedom[k])))
    return _average(found)


def against_average(values: Floats, used: NDArray[np.bool_]) -> RepeatValue | None:
    """RMSE between a signal (n,) and its centred 21-sample mean, the paper's velocity noise, +- itself/sqrt(2 n)."""
    if len(values) < 3 * _AVERAGED:
        return None
    mean = np.convolve(values, np.ones(_AVERAGED) / _AVERAGED, "valid")
    whole = np.convolve(used, np.ones(_AVERAGED), "valid") > _AVERAGED - 0.5
    half = _AVERAGED // 2
    rmse, n = float(np.sqrt(np.mean((values[half:-half] - mean)[whole] ** 2))), int(np.count_nonzero(whole))
    return RepeatValue(rmse, rmse / math.sqrt(2 * n), n)
