"""The path of the tip in a palpation, as the robot really goes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_studies.design.settings import DesignLoop


@dataclass(frozen=True)
class DepthPath:
    """Depth and its derivatives at evenly spaced instants, each (n,)."""

    time: Floats  # [s]
    depth: Floats  # [m]
    rate: Floats  # [m/s]
    acceleration: Floats  # [m/s^2]
    jerk: Floats  # [m/s^3]


def sine_path(
    depth: float, sines: Sequence[tuple[float, float]], duration: float, sampling: float, loop: DesignLoop
) -> DepthPath:
    """Sines (frequency [Hz], commanded amplitude [m]) around a mean depth [m], in the loop's steady state."""
    time = np.arange(max(int(duration * sampling), 2)) / sampling
    orders = [np.zeros_like(time) for _ in range(4)]
    for frequency, amplitude in sines:
        omega = 2 * np.pi * frequency
        wave = amplitude * loop.passes(frequency) * np.exp(1j * omega * time) / 1j
        for order, total in enumerate(orders):
            total += ((1j * omega) ** order * wave).real
    return DepthPath(time, depth + orders[0], orders[1], orders[2], orders[3])
