"""Sines in unevenly sampled records: frequencies, phasors, and the noise that the record itself has around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

# Choices.
_HARMONICS = 3  # the highest of each line that is fitted as well
_NEIGHBOURS = 20  # bins of 1/T to either side of a line in which its noise is measured
_MIN_SEPARATION = 1.5  # bins of 1/T between two lines, and between a line and its noise
_MEAN_BINS = 12  # the lowest of a spectrum, which are the noise of a mean
_ZERO_PADDING = 8  # lengths of a record in its padded spectrum
_MIN_PERIODS = 2.0  # of a line in the record
_NEWTON_STEPS = 4  # of Gauss and Newton, which begin within a sixteenth of 1/T
_MAX_STEP = 0.5  # of 1/T, in one of these steps
_SMALLEST_LENGTH = 1e-300  # of a column in a quotient, in place of 0


@dataclass(frozen=True)
class SineFit:
    """x(t) = offset + slope t + Re(sum_k c_k exp(i omega_k t)), t from the middle of the record.

    The coefficients are those of least squares at the readings' own instants, so that a delay of any fraction of a
    sample is a phase like any other; interpolation, which lowers the noise half-way between samples, plays no part.
    """

    phasors: NDArray[np.complex128]  # (k,)
    variances: Floats  # (k,) of each quadrature, from the spectrum of the residual around the line
    freedom: Floats  # (k,) degrees of freedom of the variances
    offset: float
    slope: float  # [1/s]
    residual: Floats  # (n,); none where readings are left out


def sine_fit(
    time: Floats, values: Floats, frequencies: Sequence[float], middle: float, used: NDArray[np.bool_] | None = None
) -> SineFit:
    """Return sines of known frequencies [Hz], about a middle instant [s], by least squares to the readings used.

    The coefficients are a mean, a slope, then cosine and sine of each frequency: a phasor is a - i b.
    """
    used = np.ones(len(time), bool) if used is None else used
    t = time - middle
    design = _columns(t, frequencies)
    coefficients = _least_squares(design[used], values[used])
    residual = np.where(used, values - design @ coefficients, 0.0)
    share = float(np.mean(used))
    noise = [_variance_at(t, residual, frequency, frequencies, share) for frequency in frequencies]
    return SineFit(
        phasors=coefficients[2::2] - 1j * coefficients[3::2],
        variances=np.array([variance for variance, _ in noise]),
        freedom=np.array([freedom for _, freedom in noise]),
        offset=float(coefficients[0]),
        slope=float(coefficients[1]),
        residual=residual[used],
    )


def _columns(t: Floats, lines: Sequence[float]) -> Floats:
    """Return the columns (n, 2 + 2 k) of offset, slope, and cosine and sine of each line."""
    columns = [np.ones_like(t), t]
    for frequency in lines:
        columns += [np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)]
    return np.column_stack(columns)


def _least_squares(columns: Floats, values: Floats) -> Floats:
    """Return least squares by the normal equations of columns of length one: sines are nearly orthogonal."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), _SMALLEST_LENGTH)
    unit = columns / scale
    return np.asarray(np.linalg.solve(unit.T @ unit, unit.T @ values) / scale, np.float64)


def harmonics_of(frequencies: Sequence[float], max_frequency: float, span: float) -> list[float]:
    """Return second and third harmonics [Hz] other than the lines, of a record of `span` [s]."""
    harmonics: list[float] = []
    for frequency in frequencies:
        for order in range(2, _HARMONICS + 1):
            candidate = order * frequency
            gaps = [abs(candidate - line) * span for line in (*frequencies, *harmonics)]
            if candidate < max_frequency and all(gap > _MIN_SEPARATION for gap in gaps):
                harmonics.append(candidate)
    return harmonics


def _power(values: Floats) -> Floats:
    """Return |2/n sum x exp(-i omega t)|^2 at whole numbers of periods in the record, as if evenly sampled.

    For noise only, whose level no jitter of the time-stamps changes.
    """
    return np.asarray(np.abs(np.fft.rfft(values) * 2.0 / len(values)) ** 2, np.float64)


def _variance_at(
    time: Floats, residual: Floats, frequency: float, lines: Sequence[float], share: float
) -> tuple[float, float]:
    """Return the variance of each quadrature of a phasor at a frequency [Hz], and its degrees of freedom.

    It is the mean of the residual's spectrum over neighbouring frequencies, so that coloured noise does no harm; lines
    that were fitted are left out, since the fit took the noise there as well. The residual is zero but for a share of
    the readings: sums over them have so much less power, and neighbouring frequencies correlate.
    """
    # Bins of 1/T; the line and its next bins take two of the neighbours to either side, mean and drift the lowest bins.
    power = _power(residual)
    span = float(time[-1] - time[0]) * len(time) / (len(time) - 1)
    bins = np.arange(len(power))
    distances = np.abs(bins[:, None] - np.array(lines)[None, :] * span).min(axis=1)
    is_neighbour = (distances > _MIN_SEPARATION) & (bins > 1) & (bins < len(power) - 1)
    is_neighbour &= np.abs(bins - frequency * span) < _NEIGHBOURS + 2
    # A bin has two quadratures, each with half of its power.
    return float(power[is_neighbour].mean() / 2 / share**2), 2.0 * int(is_neighbour.sum()) * share


def mean_with_std(values: Floats) -> tuple[float, float, float]:
    """Return the mean of a record at standstill, its standard uncertainty, and the degrees of freedom of that.

    The uncertainty is that of the lowest frequencies of the spectrum, so that it holds for coloured noise, too.
    """
    power = _power(values - values.mean())[1 : 1 + _MEAN_BINS]
    return float(values.mean()), float(np.sqrt(power.mean() / 4)), 2.0 * len(power)


def find_lines(
    time: Floats, values: Floats, used: NDArray[np.bool_] | None = None, max_count: int = 6, min_share: float = 0.08
) -> tuple[float, ...]:
    """Return the frequencies [Hz] of the sines of a motion, in rising order.

    One after the other: the highest peak of the spectrum of what the sines so far leave over, then all frequencies
    together by Gauss and Newton; ends where the next peak is below `min_share` of the first. Both limits are choices:
    more and weaker lines take time and hardly add to the mean of their masses.
    """
    used = np.ones(len(time), bool) if used is None else used
    t = time - (time[0] + time[-1]) / 2
    residual = values - np.polyval(np.polyfit(t[used], values[used], 1), t)
    lines: list[float] = []
    first_height: float | None = None
    for _ in range(max_count):
        frequency, height = _highest_peak(t, residual * used)
        if first_height is None:
            first_height = height
        if height < min_share * first_height or height == 0:
            break
        lines = _refined(t[used], values[used], [*lines, frequency])
        columns = _columns(t, lines)
        residual = values - columns @ _least_squares(columns[used], values[used])
    return tuple(sorted(lines))


def _highest_peak(t: Floats, values: Floats) -> tuple[float, float]:
    """Return frequency [Hz] and amplitude of the highest peak of a spectrum, of some periods within the record or more.

    The values at times t (n,) [s] are read at even times, under Hann's window, with zeros behind them.
    """
    count, span = len(t), float(t[-1] - t[0])
    even = np.linspace(t[0], t[-1], count)
    window = np.hanning(count)
    transform = np.fft.rfft(np.interp(even, t, values) * window, _ZERO_PADDING * count)
    spectrum = np.abs(transform) * 2 / window.sum()
    frequencies = np.fft.rfftfreq(_ZERO_PADDING * count, span / (count - 1))
    spectrum[frequencies * span < _MIN_PERIODS] = 0.0
    peak = int(np.argmax(spectrum))
    return float(frequencies[peak]), float(spectrum[peak])


def _refined(t: Floats, values: Floats, lines: list[float]) -> list[float]:
    """Return frequencies [Hz] by steps of Gauss and Newton, with offset, slope and phasors free."""
    for _ in range(_NEWTON_STEPS):
        columns = _columns(t, lines)
        coefficients = _least_squares(columns, values)
        slopes = []
        for k, frequency in enumerate(lines):
            a, b = coefficients[2 + 2 * k], coefficients[3 + 2 * k]
            omega = 2 * np.pi * frequency
            slopes.append(2 * np.pi * t * (b * np.cos(omega * t) - a * np.sin(omega * t)))
        step = _least_squares(np.column_stack([columns, *slopes]), values - columns @ coefficients)
        limit = _MAX_STEP / (t[-1] - t[0])
        lines = [f + float(np.clip(df, -limit, limit)) for f, df in zip(lines, step[columns.shape[1] :], strict=True)]
    return lines
