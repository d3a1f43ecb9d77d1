"""A power line's hum in readings that are so few that it looks like a slow wave, or a drift."""

from __future__ import annotations

import numpy as np
from palpate.vectors import Floats

_LINE_FREQUENCIES = (50.0, 60.0)  # [Hz] of power lines
_LINE_DEVIATION = 0.2  # [Hz] by which a line may be off; a choice (decision 0392)
_MAX_WAVES = 8.0  # in the record: more of them are not a press; a choice
# The search for the frequency (choices): a grid of the band, then twice one that spans two of its steps.
_PER_WAVE = 4.0  # frequencies of the band for each wave that it adds to the record
_MIN_FREQUENCIES = 5
_FINE_GRID = 9  # frequencies
_FINE_LEVELS = 2
_ALIAS_POINTS = 19  # frequencies of a line, whose aliases are compared
_MIN_SHARE = 1e-9  # of a wave's square, that other terms have to leave for it to count: above their rounding


def residual_of_hum(time: Floats, basis: Floats, residual: Floats, interval: float, bends: float = 0.0) -> float:
    """Return the least sum of squares [N2] of readings less air and one wave that hum may be.

    `residual` (n,) [N] is of the orthonormal terms `basis` (n, k) of air at times (n,) [s], of readings that were taken
    at an interval [s]. The line of the air may bend as well, by so many waves over the readings. Infinite where no hum
    is slow at this rate.
    """
    duration = float(time[-1] - time[0])
    # Bands of frequencies [Hz] of a wave that is as slow as a press.
    aliases = (_alias_band(line, interval) for line in _LINE_FREQUENCIES)
    bands = [band for band in aliases if band[0] * duration < _MAX_WAVES]
    if bends and duration > 0.0:
        bands.append((0.0, bends / duration))
    if not bands or not duration > 0.0:
        return float("inf")
    low = min(band[0] for band in bands)
    low = max(low, 0.25 / (_PER_WAVE * duration))  # a quarter of a step, a choice: a slower wave is a parabola
    high = min(max(band[1] for band in bands), _MAX_WAVES / duration)

    # The frequency of the least sum of squares.
    count = max(round(_PER_WAVE * (high - low) * duration), _MIN_FREQUENCIES)
    cost = float("inf")
    for _ in range(1 + _FINE_LEVELS):
        frequencies = np.linspace(low, high, count)
        costs = _wave_costs(time, basis, residual, frequencies)
        best_row = int(np.argmin(costs))
        cost = min(cost, float(costs[best_row]))
        low, high = float(frequencies[max(best_row - 1, 0)]), float(frequencies[min(best_row + 1, count - 1)])
        count = _FINE_GRID
    return cost


def _alias_band(line: float, interval: float) -> tuple[float, float]:
    """Return the frequencies [Hz] between which hum of a line may appear in readings at an interval [s]."""
    rate = 1.0 / interval
    frequencies = np.linspace(line - _LINE_DEVIATION, line + _LINE_DEVIATION, _ALIAS_POINTS)
    aliases = [abs(frequency - rate * round(frequency / rate)) for frequency in frequencies]
    return min(aliases), max(aliases)


def _wave_costs(time: Floats, basis: Floats, residual: Floats, frequencies: Floats) -> Floats:
    """Return the sum of squares (m,) [N2] of a residual less a sine and a cosine of each frequency (m,) [Hz]."""
    # Both waves less what air explains of them, and the cosine less what the sine explains (Gram and Schmidt).
    phase = 2.0 * np.pi * frequencies[:, None] * (time - time.mean())
    sine, cosine = np.sin(phase), np.cos(phase)
    for wave in (sine, cosine):
        wave -= (wave @ basis) @ basis.T
    sine_square = np.einsum("ij,ij->i", sine, sine)
    product = np.einsum("ij,ij->i", sine, cosine)
    cosine -= (product / np.where(sine_square > _MIN_SHARE, sine_square, 1.0))[:, None] * sine

    # Each lowers the sum of squares by the square of its projection.
    decrease = np.zeros(len(frequencies))
    for wave in (sine, cosine):
        wave_square = np.einsum("ij,ij->i", wave, wave)
        projection = wave @ residual
        is_independent = wave_square > _MIN_SHARE * len(time)
        decrease += np.where(is_independent, projection**2 / np.where(wave_square > 0.0, wave_square, 1.0), 0.0)
    return np.asarray(float(residual @ residual) - decrease)
