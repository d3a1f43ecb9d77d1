"""How a position-controlled robot follows its setpoints."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

_UNREST = (0.5, 20.0)  # [Hz] between which an arm deviates: a UR3e in a slow sweep, as recorded by others
_SINES = 64


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
        tick, elapsed = self._since(instants)
        return _advance(self.position[tick], self.velocity[tick], self.command[tick], elapsed, self.lag)

    def velocity_at(self, instants: Floats) -> Floats:
        """Velocity (m, 3) at instants (m,) [s] since the first tick: as `at` has it."""
        tick, elapsed = self._since(instants)
        command = self.command[tick]
        return np.asarray(command + (self.velocity[tick] - command) * np.exp(-elapsed / self.lag))

    def _since(self, instants: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the tick before each instant, and the time (m, 1) [s] since it."""
        tick = np.clip((instants / self.period + 1e-9).astype(np.int64), 0, len(self.position) - 1)
        return tick, np.maximum(instants - tick * self.period, 0.0)[:, None]

    def mean_acceleration(self, instants: Floats, width: float) -> Floats:
        """Acceleration (m, 3) averaged over a time of `width` [s] around each instant, as a sensor's filter does.

        It jumps where the command does; sampled at points, those jumps would fold onto the motion's own frequency.
        """
        after, before = (self.velocity_at(instants + shift) for shift in (width / 2, -width / 2))
        return (after - before) / width

    def with_unrest(self, std: float, dice: np.random.Generator) -> TrackedMotion:
        """Return the motion with one up and down of a standard deviation [m] besides: sines from 0.5 to 20 Hz, as many
        in each octave.

        Its speed u' and acceleration u'' are those of a command that is higher by u' + lag u''.
        """
        omega = 2 * np.pi * np.exp(dice.uniform(math.log(_UNREST[0]), math.log(_UNREST[1]), _SINES))
        phase = 1j * (
            omega * (np.arange(len(self.position)) * self.period)[:, None] + dice.uniform(0, 2 * np.pi, _SINES)
        )
        wave = std * np.sqrt(2 / _SINES) * np.exp(phase)
        way, speed, change = (((1j * omega) ** order * wave).sum(axis=1).real for order in range(3))
        up = np.array([0.0, 0.0, 1.0])
        command = self.command + np.outer(speed + self.lag * change, up)
        return replace(
            self,
            position=self.position + np.outer(way, up),
            velocity=self.velocity + np.outer(speed, up),
            command=command,
        )


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
        """Return the motion that follows setpoints (n, 3), beginning at rest in the first.

        From tick to tick the way z from the first setpoint and the speed v become A (z, v) + b u with
        u = gain (z_d - z_d0) + damping z_d'. Many stretches are followed side by side, each from z = v = 0; then each
        gets what the state that it really begins with becomes by the powers of A.
        """
        n, first = len(position), position[:1]
        length = max(math.isqrt(n), 1)
        stretches = -(-n // length)
        wanted = np.zeros((stretches * length, 3))
        wanted[:n] = self.gain * (position - first) + self.damping * velocity
        side_by_side = wanted.reshape(stretches, length, 3)
        states = np.zeros((length + 1, 2, stretches, 3))
        for i in range(length):
            states[i + 1] = self._following(states[i], side_by_side[:, i])
        powers = [np.eye(2)]
        for _ in range(length):
            powers.append(self._following(powers[-1], 0.0))
        starts = np.zeros((2, stretches, 3))
        for k in range(1, stretches):
            starts[:, k] = powers[-1] @ starts[:, k - 1] + states[-1, :, k - 1]
        states[:-1] += np.einsum("iab,bks->iaks", np.array(powers[:-1]), starts)
        way, speed = states[:-1].transpose(1, 2, 0, 3).reshape(2, -1, 3)[:, :n]
        command = wanted[:n] - self.gain * way - self.damping * speed
        return TrackedMotion(first + way, speed.copy(), command, self.period, self.lag)

    def _following(self, state: Floats, wanted: Floats | float) -> Floats:
        """Way and speed (2, ...) a tick later."""
        decay = float(np.exp(-self.period / self.lag))
        slide = self.lag * (1.0 - decay)
        way, speed = state
        command = wanted - self.gain * way - self.damping * speed
        lacking = speed - command
        return np.stack([way + command * self.period + lacking * slide, command + lacking * decay])
