"""Oscillations of the tip around a depth: none, a sine, several, or a chirp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats


@dataclass(frozen=True)
class Oscillation:
    """A sum of sines, w(t) = sum of A_i sin(2 pi f_i t), zero at t = 0 and there on its way inwards."""

    amplitudes: tuple[float, ...]  # [m]
    frequencies: tuple[float, ...]  # [Hz]

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Return the displacement inwards [m] and its rate [m/s] at times (n,) [s]."""
        value, rate = np.zeros_like(time), np.zeros_like(time)
        for amplitude, frequency in zip(self.amplitudes, self.frequencies, strict=True):
            omega = 2 * np.pi * frequency
            value = value + amplitude * np.sin(omega * time)
            rate = rate + amplitude * omega * np.cos(omega * time)
        return value, rate

    @property
    def reach(self) -> float:
        """The largest possible displacement from the middle [m]."""
        return sum(self.amplitudes)

    @property
    def top_speed(self) -> float:
        """The largest possible rate [m/s]."""
        return sum(2 * np.pi * f * a for a, f in zip(self.amplitudes, self.frequencies, strict=True))


@dataclass(frozen=True)
class ChirpPhase:
    """A sine whose frequency rises exponentially from f1 to f2 over a duration T, and is constant outside.

    w(t) = A sin(phi(t)), phi' = 2 pi f1 (f2/f1)^(t/T); before the beginning f1, after the end f2.
    """

    amplitude: float  # [m]
    first: float  # [Hz]
    last: float  # [Hz]
    duration: float  # [s]

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Return the displacement inwards [m] and its rate [m/s] at times (n,) [s]."""
        growth = np.log(self.last / self.first) / self.duration
        # Cycles within the chirp, then those before or after at a constant frequency.
        bounded = np.clip(time, 0.0, self.duration)
        frequency = self.first * np.exp(growth * bounded)
        cycles = (frequency - self.first) / growth if growth else self.first * bounded
        cycles = cycles + frequency * (time - bounded)
        phase = 2 * np.pi * cycles
        return self.amplitude * np.sin(phase), self.amplitude * np.cos(phase) * 2 * np.pi * frequency

    @property
    def reach(self) -> float:
        """The largest displacement from the middle [m]."""
        return self.amplitude

    @property
    def top_speed(self) -> float:
        """The largest rate [m/s]."""
        return 2 * np.pi * max(self.first, self.last) * self.amplitude


def together(amplitudes: Sequence[float], frequencies: Sequence[float]) -> Oscillation:
    """Return sines of several amplitudes and frequencies at once."""
    return Oscillation(tuple(amplitudes), tuple(frequencies))
