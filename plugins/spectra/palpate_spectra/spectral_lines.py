"""Lines of a recorded motion: which sines it is made of, and the phasors of what went along with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Phasors = NDArray[np.complex128]

_MOST = 12  # lines of one motion
_WEAK = 0.02  # of the largest amplitude; fainter sines of the motion are not lines
_CLEAR = 100.0  # power of a line over that of the motion's noise around it
LEAST_EXPLAINED = 0.98  # of the motion's power; less is not a sum of sines
_LOWEST = 1.5  # periods in the record
_TREND = 0.4  # of the lowest line's frequency; what is slower is the drift of tip, sensor and material
_BINS = 40  # of the spectrum around a line in which its noise is measured
_ORDER = 3  # of the sums and differences of lines that a nonlinear contact makes


@dataclass(frozen=True)
class LineFit:
    """Several channels on the same sines: x_j(t) = trend + Re(sum_k c_kj exp(i w_k (t - middle)))."""

    frequencies: Floats  # (k,) [Hz]
    phasors: Phasors  # (k, channels)
    covariances: Phasors  # (k, channels, channels) E[dc dc^H] of the phasors, circular: each quadrature has half
    freedom: Floats  # (k,) degrees of freedom of the covariances
    level: Floats  # (channels,) mean


def lines_of(time: Floats, height: Floats) -> Floats | None:
    """Frequencies [Hz] of the sines that a motion is made of, ascending; None where it is not a sum of sines.

    The highest peak of the periodogram of what is left is a line while it stands clear of the noise; all frequencies
    are then those of least squares.
    """
    t = time - time.mean()
    slow = np.column_stack([np.ones_like(t), t])
    left = height - slow @ _solved(slow, height)
    power, first = float(left @ left), 0.0
    found: list[float] = []
    while len(found) < _MOST:
        peak, amplitude, noise = _peak(t, left)
        first = first or amplitude
        if amplitude < _WEAK * first or amplitude**2 < _CLEAR * noise:
            break
        found = _refined(t, height, [*found, peak])
        if min(found) * float(np.ptp(t)) < _LOWEST:
            return None
        left = height - (design := columns_of(t, found)) @ _solved(design, height)
    explained = 1.0 - float(left @ left) / max(power, 1e-300)
    return np.array(sorted(found)) if found and explained > LEAST_EXPLAINED and _apart(found, t) else None


def _apart(found: Sequence[float], t: Floats) -> bool:
    """Return True if lines are more than a period of the record apart; a frequency that wanders makes a comb of near
    ones."""
    return len(found) < 2 or float(np.min(np.diff(np.sort(found)))) * float(np.ptp(t)) > 1.0


def _peak(t: Floats, left: Floats) -> tuple[float, float, float]:
    """Frequency [Hz] and amplitude of the highest peak, and the noise's squared amplitude around it (Hann's window)."""
    n, step = len(t), float(np.median(np.diff(t)))
    window = np.hanning(n)
    size = 4 * n
    spectrum = np.abs(np.fft.rfft(left * window, size)) * 2.0 / float(window.sum())
    frequencies = np.fft.rfftfreq(size, step)
    allowed = (frequencies * n * step > _LOWEST) & (frequencies < 0.2 / step)
    best = int(np.argmax(np.where(allowed, spectrum, 0.0)))
    beside = spectrum[max(best - 160, 1) : best + 161]
    return float(frequencies[best]), float(spectrum[best]), float(np.median(beside) ** 2)


def _refined(t: Floats, values: Floats, frequencies: list[float]) -> list[float]:
    """Frequencies [Hz] of least squares by Gauss and Newton, amplitudes with them."""
    f = np.array(frequencies)
    for _ in range(4):
        design = columns_of(t, f)
        found = _solved(design, values)
        a, b = found[2::2], found[3::2]
        phase = 2 * np.pi * np.outer(t, f)
        slopes = 2 * np.pi * t[:, None] * (b * np.cos(phase) - a * np.sin(phase))
        both = np.hstack([design, slopes])
        step = _solved(both, values - design @ found)[-len(f) :]
        f = f + np.clip(step, -0.5 / np.ptp(t), 0.5 / np.ptp(t))
    return [float(value) for value in f]


def columns_of(t: Floats, frequencies: Sequence[float] | Floats) -> Floats:
    """Offset, slope, cosine and sine of each line (n, 2 + 2 k)."""
    columns = [np.ones_like(t), t]
    for frequency in np.asarray(frequencies).tolist():
        columns += [np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)]
    return np.column_stack(columns)


def _solved(columns: Floats, values: Floats) -> Floats:
    """Least squares by the normal equations of columns of length one."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit = columns / scale
    found = np.linalg.lstsq(unit.T @ unit, unit.T @ values, rcond=1e-12)[0]
    return np.asarray(found / (scale if values.ndim == 1 else scale[:, None]), np.float64)


def mixed_frequencies(lines: Floats, span: float, highest: float) -> Floats:
    """Sums and differences of up to three lines [Hz] that are not lines themselves: what a nonlinear law makes."""
    found: list[float] = []
    signed = [sign * f for f, sign in product(lines.tolist(), (1, -1))]
    for order in range(2, _ORDER + 1):
        for some in combinations_with_replacement(signed, order):
            f = sum(some)
            near = [abs(f - other) * span < 1.2 for other in (*lines.tolist(), *found)]
            if _LOWEST / span < f < highest and not any(near):
                found.append(f)
    return np.array(sorted(found))


def fit_lines(time: Floats, channels: Floats, lines: Floats) -> tuple[LineFit, LineFit]:
    """Channels (n, c) on the lines [Hz], and on what a nonlinear law makes of these.

    The trend is a polynomial of degree one and cosines slower than 0.4 of the lowest line. Covariances are those of the
    residual's spectrum within some forty bins around each line, across all channels, so that noise of the motion that
    is felt as force counts as what it is.
    """
    t = time - time.mean()
    n, span, step = len(t), float(np.ptp(t)), float(np.median(np.diff(t)))
    others = mixed_frequencies(lines, span, 0.2 / step)
    both = np.concatenate([lines, others])
    design = np.hstack([columns_of(t, both), _slow(n, int(2 * span * _TREND * float(lines[0])))])
    found = _solved(design, channels)
    left = channels - design @ found
    phasors = found[2 : 2 + 2 * len(both) : 2] - 1j * found[3 : 3 + 2 * len(both) : 2]
    spectrum = np.fft.rfft(left, axis=0)
    noise = [_noise(spectrum, n, n * step, f, both, float(lines[0])) for f in both.tolist()]
    covariances, freedom = np.array([c for c, _ in noise]), np.array([k for _, k in noise])
    level = channels.mean(axis=0)
    k = len(lines)
    return (
        LineFit(lines, phasors[:k], covariances[:k], freedom[:k], level),
        LineFit(others, phasors[k:], covariances[k:], freedom[k:], level),
    )


def _slow(n: int, order: int) -> Floats:
    """Cosines over the record, slower than its lines (n, order - 1)."""
    place = (np.arange(n) + 0.5) / n
    return np.column_stack([np.zeros((n, 0)), *(np.cos(np.pi * k * place) for k in range(2, order + 1))])


def _noise(
    spectrum: Phasors, n: int, span: float, frequency: float, taken: Floats, lowest: float
) -> tuple[Phasors, float]:
    """Covariance (c, c) of phasors at a frequency [Hz] by the residual's bins around it, and its degrees of freedom.

    Bins that the fit has emptied do not count: those of its sines and of the trend.
    """
    f = np.arange(len(spectrum)) / span
    free = f > 1.2 * _TREND * lowest
    for other in taken.tolist():
        free &= np.abs(f - other) * span > 1.01
    rows = np.flatnonzero(free)
    rows = rows[np.argsort(np.abs(f[rows] - frequency), kind="stable")][:_BINS]
    near = spectrum[rows]
    return np.asarray(4.0 / n**2 * (near.T @ near.conj()) / max(len(rows), 1), np.complex128), 2.0 * len(rows)
