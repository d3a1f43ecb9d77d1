"""What the tip does around a depth: nothing, a sine, several, or a chirp."""

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
        """Way inwards [m] and its rate [m/s] at times (n,) [s]."""
        value, rate = np.zeros_like(time), np.zeros_like(time)
        for amplitude, frequency in zip(self.amplitudes, self.frequencies, strict=True):
            omega = 2 * np.pi * frequency
            value = value + amplitude * np.sin(omega * time)
            rate = rate + amplitude * omega * np.cos(omega * time)
        return value, rate

    @property
    def reach(self) -> float:
        """Largest way from the middle that it can take [m]."""
        return sum(self.amplitudes)

    @property
    def top_speed(self) -> float:
        """Largest rate that it can have [m/s]."""
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
        """Way inwards [m] and its rate [m/s] at times (n,) [s]."""
        growth = np.log(self.last / self.first) / self.duration
        inside = np.clip(time, 0.0, self.duration)
        frequency = self.first * np.exp(growth * inside)
        cycles = (frequency - self.first) / growth if growth else self.first * inside
        cycles = cycles + frequency * (time - inside)
        phase = 2 * np.pi * cycles
        return self.amplitude * np.sin(phase), self.amplitude * np.cos(phase) * 2 * np.pi * frequency

    @property
    def reach(self) -> float:
        """Largest way from the middle that it takes [m]."""
        return self.amplitude

    @property
    def top_speed(self) -> float:
        """Largest rate that it has [m/s]."""
        return 2 * np.pi * max(self.first, self.last) * self.amplitude


def together(amplitudes: Sequence[float], frequencies: Sequence[float]) -> Oscillation:
    """Sines of several amplitudes and frequencies at once."""
    return Oscillation(tuple(amplitudes), tuple(frequencies))
