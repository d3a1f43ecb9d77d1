"""Sines in unevenly sampled records: frequencies, phasors, and the noise that the record itself has beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_HARMONICS = 3  # of each line that are fitted along, so that they do not count as noise
_NEIGHBOURS = 20  # bins of 1/T to either side of a line in which its noise is measured


@dataclass(frozen=True)
class SineFit:
    """x(t) = offset + slope t + Re(sum_k c_k exp(i omega_k t)) + harmonics, t from the middle of the record.

    The coefficients are those of least squares at the readings' own instants, so that a delay of any fraction of a
    sample is a phase like any other; interpolation, which lowers the noise half-way between samples, plays no part.
    """

    phasors: NDArray[np.complex128]  # (k,)
    variances: Floats  # (k,) of each quadrature, from the spectrum of the residual beside the line
    freedom: Floats  # (k,) degrees of freedom of the variances
    offset: float
    slope: float  # [1/s]
    residual: Floats  # (n,)
    harmonic: float  # RMS of the fitted harmonics


def sine_fit(time: Floats, values: Floats, frequencies: Sequence[float], middle: float) -> SineFit:
    """Least squares of sines of known frequencies [Hz], about a middle instant [s]."""
    t = time - middle
    span = float(t[-1] - t[0])
    lines = list(frequencies) + _harmonics(frequencies, (len(t) - 1) / span / 2.5, span)
    columns = [np.ones_like(t), t / span]
    for frequency in lines:
        columns += [np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)]
    design = np.column_stack(columns)
    found, *_ = np.linalg.lstsq(design, values, rcond=None)
    residual = values - design @ found
    phasors = found[2::2] - 1j * found[3::2]
    own = len(frequencies)
    noise = [_variance_at(t, residual, frequency, lines) for frequency in frequencies]
    return SineFit(
        phasors[:own],
        np.array([variance for variance, _ in noise]),
        np.array([freedom for _, freedom in noise]),
        float(found[0]),
        float(found[1] / span),
        residual,
        float(np.sqrt((np.abs(phasors[own:]) ** 2).sum() / 2)),
    )


def _harmonics(frequencies: Sequence[float], highest: float, span: float) -> list[float]:
    """Harmonics of the lines that are neither lines themselves nor too high to be seen."""
    found: list[float] = []
    for frequency in frequencies:
        for order in range(2, _HARMONICS + 1):
            candidate = order * frequency
            if candidate < highest and all(abs(candidate - f) * span > 1.5 for f in (*frequencies, *found)):
                found.append(candidate)
    return found


def spectrum_at(time: Floats, values: Floats, frequencies: Floats) -> NDArray[np.complex128]:
    """2/n sum x exp(-i omega t) at frequencies (k,) [Hz]: the phasor of a sine of that frequency."""
    turns = np.exp(-2j * np.pi * np.outer(frequencies, time))
    return np.asarray(2.0 / len(time) * (turns @ values))


def _variance_at(time: Floats, residual: Floats, frequency: float, lines: Sequence[float]) -> tuple[float, float]:
    """Variance of each quadrature of a phasor at a frequency [Hz], and its degrees of freedom.

    The mean of the residual's spectrum over neighbouring frequencies, so that coloured noise is no trouble; lines that
    were fitted are left out, since the fit took the noise there along.
    """
    span = float(time[-1] - time[0])
    steps = np.arange(2, _NEIGHBOURS + 2) / span
    candidates = np.concatenate([frequency - steps, frequency + steps])
    candidates = candidates[candidates * span > 1.5]
    apart = np.abs(candidates[:, None] - np.array(lines)[None, :]).min(axis=1)
    candidates = candidates[apart * span > 1.5]
    power = np.abs(spectrum_at(time, residual, candidates)) ** 2
    return float(power.mean() / 2), 2.0 * len(candidates)


def mean_with_std(time: Floats, values: Floats) -> tuple[float, float, float]:
    """Mean of a record at rest, its standard uncertainty, and the degrees of freedom of that.

    The uncertainty is that of the lowest frequencies of the spectrum, which is where a mean lives: right for coloured
    noise, too.
    """
    span = float(time[-1] - time[0])
    bins = np.arange(1, 13) / span
    power = np.abs(spectrum_at(time - time.mean(), values - values.mean(), bins)) ** 2
    return float(values.mean()), float(np.sqrt(power.mean() / 4)), 2.0 * len(bins)


def find_lines(time: Floats, values: Floats, most: int = 6, least: float = 0.08) -> tuple[float, ...]:
    """Frequencies [Hz] of the sines that a motion consists of, the strongest first to be found, in rising order.

    One after the other: the highest peak of the spectrum of what the sines so far leave over, then all frequencies
    together by Gauss and Newton; ends where the next peak is below `least` of the first.
    """
    middle = (time[0] + time[-1]) / 2
    t = time - middle
    span, count = float(t[-1] - t[0]), len(t)
    even = np.linspace(t[0], t[-1], count)
    lines: list[float] = []
    rest, first = values - np.polyval(np.polyfit(t, values, 1), t), None
    for _ in range(most):
        window = np.hanning(count)
        spectrum = np.abs(np.fft.rfft(np.interp(even, t, rest) * window, 8 * count)) * 2 / window.sum()
        grid = np.fft.rfftfreq(8 * count, span / (count - 1))
        spectrum[grid * span < 2.0] = 0.0  # a line needs two periods
        peak = int(np.argmax(spectrum))
        first = spectrum[peak] if first is None else first
        if spectrum[peak] < least * first or spectrum[peak] == 0:
            break
        lines = _refined(t, values, [*lines, float(grid[peak])])
        rest = sine_fit(t, values, lines, 0.0).residual
    return tuple(sorted(lines))


def _refined(t: Floats, values: Floats, lines: list[float]) -> list[float]:
    for _ in range(4):
        columns = [np.ones_like(t), t]
        for frequency in lines:
            columns += [np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)]
        found, *_ = np.linalg.lstsq(np.column_stack(columns), values, rcond=None)
        slopes = []
        for k, frequency in enumerate(lines):
            a, b = found[2 + 2 * k], found[3 + 2 * k]
            omega = 2 * np.pi * frequency
            slopes.append(2 * np.pi * t * (b * np.cos(omega * t) - a * np.sin(omega * t)))
        rest = values - np.column_stack(columns) @ found
        step, *_ = np.linalg.lstsq(np.column_stack([*columns, *slopes]), rest, rcond=None)
        limit = 0.5 / (t[-1] - t[0])
        lines = [f + float(np.clip(df, -limit, limit)) for f, df in zip(lines, step[len(columns) :], strict=True)]
    return lines
