"""How a position-controlled robot follows its setpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from palpate import Floats


@dataclass(frozen=True)
class TrackedMotion:
    """A motion that is known at every instant: commanded speed is constant within a control period."""

    position: Floats  # (n, 3) [m] at the control ticks
    velocity: Floats  # (n, 3) [m/s]
    command: Floats  # (n, 3) [m/s], held from each tick to the next
    period: float  # [s]
    lag: float  # [s]

    def at(self, instants: Floats) -> tuple[Floats, Floats, Floats]:
        """Position, velocity and acceleration (m, 3) at instants (m,) [s] since the first tick."""
        tick = np.clip((instants / self.period + 1e-9).astype(int), 0, len(self.position) - 1)
        elapsed = np.maximum(instants - tick * self.period, 0.0)[:, None]
        return _advance(self.position[tick], self.velocity[tick], self.command[tick], elapsed, self.lag)

    def mean_acceleration(self, instants: Floats, width: float) -> Floats:
        """Acceleration (m, 3) averaged over a time of `width` [s] around each instant, as a sensor's filter does.

        It jumps where the command does; sampled at points, those jumps would fold onto the motion's own frequency.
        """
        after, before = (self.at(instants + shift)[1] for shift in (width / 2, -width / 2))
        return (after - before) / width


def _advance(
    position: Floats, velocity: Floats, command: Floats, elapsed: Floats, lag: float
) -> tuple[Floats, Floats, Floats]:
    """Exact solution of lag v' = command - v over a time in which the command is constant."""
    decay = np.exp(-elapsed / lag)
    lacking = velocity - command
    moved = position + command * elapsed + lacking * lag * (1.0 - decay)
    return moved, command + lacking * decay, -lacking * decay / lag


@dataclass(frozen=True)
class PositionLoop:
    """A PD law on position that commands speed: gain (z_d - z) + damping (z_d' - z'); the speed follows with a lag."""

    gain: float  # [1/s]
    damping: float
    lag: float  # [s]
    period: float  # [s]

    def track(self, position: Floats, velocity: Floats) -> TrackedMotion:
        """The motion that follows setpoints (n, 3), beginning at rest in the first."""
        n = len(position)
        actual, speed, commands = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
        decay = float(np.exp(-self.period / self.lag))
        slide = self.lag * (1.0 - decay)
        for axis in range(3):
            # Plain floats: a scalar recursion is several times faster than one on numpy rows.
            z, v, course = float(position[0, axis]), 0.0, []
            for wanted, rate in zip(position[:, axis].tolist(), velocity[:, axis].tolist(), strict=True):
                command = self.gain * (wanted - z) + self.damping * (rate - v)
                course.append((z, v, command))
                lacking = v - command
                z += command * self.period + lacking * slide
                v = command + lacking * decay
            actual[:, axis], speed[:, axis], commands[:, axis] = np.array(course).T
        return TrackedMotion(actual, speed, commands, self.period, self.lag)
