"""Spectral lines of a recorded motion: frequencies of the sines in it, and phasors of all channels on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Phasors = NDArray[np.complex128]

# Choices.
MIN_EXPLAINED_SHARE = 0.98  # of the motion's power; a sum of sines explains at least so much
_MAX_LINES = 12  # of one motion
_MIN_AMPLITUDE_SHARE = 0.02  # of the largest amplitude; fainter sines of the motion are not lines
_MIN_POWER_OVER_NOISE = 100.0  # of a line, over the motion's noise around it: 20 dB
_MIN_PERIODS = 1.5  # of a line in the record; a slower sine cannot be distinguished from a trend
_MAX_SAMPLING_SHARE = 0.2  # of the sampling rate, up to which lines are searched: five samples a period
_TREND_SHARE = 0.4  # of the lowest line's frequency; slower changes are the drift of tip, sensor and material
_TREND_CLEARANCE = 1.2  # times the trend's highest frequency, from which on bins hold noise
_NOISE_BINS = 40  # of the spectrum, in which the noise around a line is measured
_ZERO_PADDING = 4  # lengths of the record in a periodogram, which then has four points a bin
_GAUSS_NEWTON_STEPS = 4  # they start within a bin of the line, where each squares the error
_MAX_STEP_BINS = 0.5  # of a frequency in one step of Gauss and Newton
_MAX_ORDER = 3  # of the sums and differences of lines that a nonlinear contact makes
_SAME_LINE_BINS = 1.2  # two frequencies that are nearer cannot be resolved: they are one line
_EMPTIED_BINS = 1.01  # bins around a fitted sine that the fit has emptied: its own, and one on either side
_SINGULAR_SHARE = 1e-12  # of the largest singular value of normalised columns; smaller ones are rounding
_MIN_NORM = 1e-300  # keeps a division by a norm finite


@dataclass(frozen=True)
class LineFit:
    """Several channels on the same sines: x_j(t) = trend + Re(sum_k c_kj exp(i w_k (t - middle)))."""

    frequencies: Floats  # (k,) [Hz]
    phasors: Phasors  # (k, channels) c
    covariances: Phasors  # (k, channels, channels) E[dc dc^H] of the phasors, circular: each quadrature has half
    freedom: Floats  # (k,) degrees of freedom of the covariances
    channel_means: Floats  # (channels,)

    def line(self, index: int) -> LineFit:
        """Return the fit of one of the lines alone."""
        row = slice(index, index + 1)
        return LineFit(
            self.frequencies[row], self.phasors[row], self.covariances[row], self.freedom[row], self.channel_means
        )


def find_lines(time: Floats, height: Floats) -> Floats | None:
    """Return the frequencies [Hz] of the sines in a motion (n,) [m], ascending; None where it is not a sum of sines.

    The highest peak of the residual's periodogram is added as a line while it stands clear of the noise; all
    frequencies are then refined by least squares.
    """
    t = time - time.mean()
    trend = np.column_stack([np.ones_like(t), t])
    residual = height - trend @ _least_squares(trend, height)
    power = float(residual @ residual)
    largest_amplitude = 0.0
    lines: list[float] = []
    while len(lines) < _MAX_LINES:
        frequency, amplitude, noise = _highest_peak(t, residual)
        largest_amplitude = largest_amplitude or amplitude
        is_faint = amplitude < _MIN_AMPLITUDE_SHARE * largest_amplitude
        if is_faint or amplitude**2 < _MIN_POWER_OVER_NOISE * noise:
            break
        lines = _refine_frequencies(t, height, [*lines, frequency])
        if min(lines) * float(np.ptp(t)) < _MIN_PERIODS:
            return None
        design = design_matrix(t, lines)
        residual = height - design @ _least_squares(design, height)
    is_explained = 1.0 - float(residual @ residual) / max(power, _MIN_NORM) > MIN_EXPLAINED_SHARE
    return np.array(sorted(lines)) if lines and is_explained and _are_resolved(lines, t) else None


def _are_resolved(lines: Sequence[float], t: Floats) -> bool:
    """Return True if lines [Hz] are more than 1/duration apart; a wandering frequency makes a comb of nearer ones."""
    return len(lines) < 2 or float(np.min(np.diff(np.sort(lines)))) * float(np.ptp(t)) > 1.0


def _highest_peak(t: Floats, residual: Floats) -> tuple[float, float, float]:
    """Return frequency [Hz] and amplitude of the highest peak, and the noise's squared amplitude around it.

    From the amplitude spectrum with Hann's window; the noise is the median over the points near the peak.
    """
    n, interval = len(t), float(np.median(np.diff(t)))
    window = np.hanning(n)
    padded_length = _ZERO_PADDING * n
    # Amplitude of a sine: twice its line in the spectrum, over the sum of the window.
    amplitudes = np.abs(np.fft.rfft(residual * window, padded_length)) * 2.0 / float(window.sum())
    frequencies = np.fft.rfftfreq(padded_length, interval)
    is_searched = (frequencies * n * interval > _MIN_PERIODS) & (frequencies < _MAX_SAMPLING_SHARE / interval)
    peak = int(np.argmax(np.where(is_searched, amplitudes, 0.0)))
    # The same bins on either side as of a line's noise, in points of the padded spectrum.
    reach = _ZERO_PADDING * _NOISE_BINS
    nearby_amplitudes = amplitudes[max(peak - reach, 1) : peak + reach + 1]
    return float(frequencies[peak]), float(amplitudes[peak]), float(np.median(nearby_amplitudes) ** 2)


def _refine_frequencies(t: Floats, values: Floats, frequencies: list[float]) -> list[float]:
    """Return the frequencies [Hz] of least squares for values (n,), by Gauss and Newton, amplitudes with them.

    Of a cos(w t) + b sin(w t) the derivative by the frequency f = w/(2 pi) is 2 pi t (b cos(w t) - a sin(w t)).
    """
    f = np.array(frequencies)
    for _ in range(_GAUSS_NEWTON_STEPS):
        design = design_matrix(t, f)
        coefficients = _least_squares(design, values)
        a, b = coefficients[2::2], coefficients[3::2]  # after offset and slope
        phase = 2 * np.pi * np.outer(t, f)
        derivatives = 2 * np.pi * t[:, None] * (b * np.cos(phase) - a * np.sin(phase))
        jacobian = np.hstack([design, derivatives])
        step = _least_squares(jacobian, values - design @ coefficients)[-len(f) :]
        # At most half a bin of 1/duration, so that no line jumps to another one's peak.
        f = f + np.clip(step, -_MAX_STEP_BINS / np.ptp(t), _MAX_STEP_BINS / np.ptp(t))
    return [float(frequency) for frequency in f]


def design_matrix(t: Floats, frequencies: Sequence[float] | Floats) -> Floats:
    """Return offset, slope, and the cosine and sine of each of k frequencies [Hz] at times (n,) [s]: (n, 2 + 2 k)."""
    columns = [np.ones_like(t), t]
    for frequency in np.asarray(frequencies).tolist():
        columns += [np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)]
    return np.column_stack(columns)


def _least_squares(columns: Floats, values: Floats) -> Floats:
    """Return the coefficients of least squares, by the normal equations of normalised columns.

    `columns` is (n, p); values (n,) give (p,), and values (n, c) give (p, c).
    """
    norms = np.maximum(np.linalg.norm(columns, axis=0), _MIN_NORM)
    normalised = columns / norms
    scaled = np.linalg.lstsq(normalised.T @ normalised, normalised.T @ values, rcond=_SINGULAR_SHARE)[0]
    return np.asarray(scaled / (norms if values.ndim == 1 else norms[:, None]), np.float64)


def intermodulation_frequencies(lines: Floats, duration: float, highest: float) -> Floats:
    """Return the sums and differences [Hz] of two or three lines [Hz] that a nonlinear contact makes, ascending.

    Those that the record of a duration [s] cannot resolve from a line or from one another are left out, as are those
    that are slower than 1.5 periods of it or above the highest frequency [Hz].
    """
    combinations: list[float] = []
    signed_lines = [sign * line for line, sign in product(lines.tolist(), (1, -1))]
    for order in range(2, _MAX_ORDER + 1):
        for terms in combinations_with_replacement(signed_lines, order):
            frequency = sum(terms)
            known_frequencies = (*lines.tolist(), *combinations)
            is_new = not any(abs(frequency - other) * duration < _SAME_LINE_BINS for other in known_frequencies)
            if _MIN_PERIODS / duration < frequency < highest and is_new:
                combinations.append(frequency)
    return np.array(sorted(combinations))


def fit_lines(time: Floats, channels: Floats, lines: Floats) -> tuple[LineFit, LineFit]:
    """Return the fit of channels (n, c) on the lines [Hz], and that on their sums and differences.

    Least squares on both at once and on a trend: a polynomial of degree one, and cosines slower than 0.4 of the lowest
    line. Covariances are those of the residual's spectrum in the 40 bins around each line, across all channels, so that
    noise of the motion that the force follows is counted in both.
    """
    t = time - time.mean()
    n, duration, interval = len(t), float(np.ptp(t)), float(np.median(np.diff(t)))
    combinations = intermodulation_frequencies(lines, duration, _MAX_SAMPLING_SHARE / interval)
    frequencies = np.concatenate([lines, combinations])
    # A cosine of order k has k half periods in the record.
    order = int(2 * duration * _TREND_SHARE * float(lines[0]))
    design = np.hstack([design_matrix(t, frequencies), _slow_cosines(n, order)])
    coefficients = _least_squares(design, channels)

    # Phasors a - i b of a cos(w t) + b sin(w t).
    past_sines = 2 + 2 * len(frequencies)
    phasors = coefficients[2:past_sines:2] - 1j * coefficients[3:past_sines:2]

    residuals = channels - design @ coefficients
    covariances, freedom = _noise_of_sines(residuals, interval, frequencies, float(lines[0]))
    channel_means = channels.mean(axis=0)
    count = len(lines)
    return (
        LineFit(lines, phasors[:count], covariances[:count], freedom[:count], channel_means),
        LineFit(combinations, phasors[count:], covariances[count:], freedom[count:], channel_means),
    )


def _slow_cosines(n: int, max_order: int) -> Floats:
    """Return the cosines of orders 2 to `max_order` over a record of n samples (n, orders): a slow trend."""
    share = (np.arange(n) + 0.5) / n
    cosines = [np.cos(np.pi * order * share) for order in range(2, max_order + 1)]
    return np.column_stack([np.zeros((n, 0)), *cosines])


def _noise_of_sines(
    residuals: Floats, interval: float, frequencies: Floats, lowest_line: float
) -> tuple[Phasors, Floats]:
    """Return the covariances (k, c, c) of phasors at frequencies (k,) [Hz], and their degrees of freedom (k,).

    By the spectrum of the fit's residuals (n, c) at an interval [s]; the trend goes up to a share of the lowest line.
    """
    n = len(residuals)
    spectrum = np.fft.rfft(residuals, axis=0)
    bin_frequencies = np.arange(len(spectrum)) / (n * interval)
    is_noise = _noise_bins(bin_frequencies, n * interval, frequencies, lowest_line)
    noise = [_noise_covariance(spectrum, n, bin_frequencies, is_noise, f) for f in frequencies.tolist()]
    covariances, freedom = zip(*noise, strict=True)
    return np.array(covariances), np.array(freedom)


def _noise_bins(bin_frequencies: Floats, duration: float, sines: Floats, lowest_line: float) -> NDArray[np.bool_]:
    """Return which bins of the residual's spectrum hold noise: those that neither a fitted sine nor the trend empties.

    The bins are at frequencies (m,) [Hz] of a record of a duration [s]; the sines are at frequencies [Hz].
    """
    is_noise = np.asarray(bin_frequencies > _TREND_CLEARANCE * _TREND_SHARE * lowest_line)
    for sine in sines.tolist():
        is_noise &= np.abs(bin_frequencies - sine) * duration > _EMPTIED_BINS
    return is_noise


def _noise_covariance(
    spectrum: Phasors, n: int, bin_frequencies: Floats, is_noise: NDArray[np.bool_], frequency: float
) -> tuple[Phasors, float]:
    """Return the covariance (c, c) of phasors at a frequency [Hz], and its degrees of freedom.

    The mean of S S^H over the 40 nearest bins of noise of the residual's spectrum S (m, c), times (2/n)^2, since the
    phasor of a sine in n samples is 2/n of its line in S. Each bin has two quadratures, and so two degrees of freedom.
    """
    rows = np.flatnonzero(is_noise)
    rows = rows[np.argsort(np.abs(bin_frequencies[rows] - frequency), kind="stable")][:_NOISE_BINS]
    nearest = spectrum[rows]
    covariance = 4.0 / n**2 * (nearest.T @ nearest.conj()) / max(len(rows), 1)
    return np.asarray(covariance, np.complex128), 2.0 * len(rows)
