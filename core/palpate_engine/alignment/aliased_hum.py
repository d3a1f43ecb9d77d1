"""A power line's hum in readings that are so few that it looks like a slow wave, or a drift."""

from __future__ import annotations

import numpy as np
from palpate.vectors import Floats

_LINES = (50.0, 60.0)  # [Hz]
_OFF = 0.2  # [Hz] by which a line may be off
_MOST_WAVES = 8.0  # in the record: more of them are not a press
_FINE, _FEWEST = 4.0, 5  # frequencies to a wave of the record, and at least
_NARROW, _LEVELS = 9, 2  # frequencies around the best, and how often they narrow
_ALIKE = 1e-9  # share of a wave that the other terms leave, which does not count


def left_by_hum(time: Floats, basis: Floats, rest: Floats, interval: float, bends: float = 0.0) -> float:
    """The least sum of squares [N2] of readings less air and one wave that hum may be; infinite where hum is not slow.

    `rest` (n,) [N] is what the orthonormal terms `basis` (n, k) of air leave at times (n,) [s], of readings that were
    taken at an interval [s]. The line of the air may bend as well, by so many waves over the readings.
    """
    lasts = float(time[-1] - time[0])
    bands = [band for line in _LINES if (band := _band(line, interval))[0] * lasts < _MOST_WAVES]
    if bends and lasts > 0.0:
        bands.append((0.0, bends / lasts))
    if not bands or not lasts > 0.0:
        return float("inf")
    low, high = min(band[0] for band in bands), min(max(band[1] for band in bands), _MOST_WAVES / lasts)
    low = max(low, 0.25 / (_FINE * lasts))  # a slower one is a parabola
    count = max(round(_FINE * (high - low) * lasts), _FEWEST)
    best = float("inf")
    for _ in range(1 + _LEVELS):
        turns = np.linspace(low, high, count)
        sums = _left(time, basis, rest, turns)
        at = int(np.argmin(sums))
        best = min(best, float(sums[at]))
        low, high, count = float(turns[max(at - 1, 0)]), float(turns[min(at + 1, count - 1)]), _NARROW
    return best


def _band(line: float, interval: float) -> tuple[float, float]:
    """Frequencies [Hz] at which hum of a line may appear in readings at an interval [s]."""
    rate = 1.0 / interval
    aliases = [abs(f - rate * round(f / rate)) for f in np.linspace(line - _OFF, line + _OFF, 2 * _NARROW + 1)]
    return min(aliases), max(aliases)


def _left(time: Floats, basis: Floats, rest: Floats, turns: Floats) -> Floats:
    """Sum of squares that a sine and a cosine of each frequency (m,) [Hz] leave."""
    phase = 2.0 * np.pi * turns[:, None] * (time - time.mean())
    sine, cosine = np.sin(phase), np.cos(phase)
    for wave in (sine, cosine):
        wave -= (wave @ basis) @ basis.T
    gain = np.zeros(len(turns))
    first = np.einsum("ij,ij->i", sine, sine)
    along = np.einsum("ij,ij->i", sine, cosine) / np.where(first > _ALIKE, first, 1.0)
    cosine -= along[:, None] * sine
    for wave in (sine, cosine):
        size = np.einsum("ij,ij->i", wave, wave)
        product = wave @ rest
        gain += np.where(size > _ALIKE * len(time), product**2 / np.where(size > 0.0, size, 1.0), 0.0)
    return np.asarray(float(rest @ rest) - gain)
