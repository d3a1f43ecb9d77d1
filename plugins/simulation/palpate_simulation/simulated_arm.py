"""Motion of a position-controlled robot that follows its setpoints."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

# Frequencies [Hz] between which an arm deviates: a UR3e in a slow sweep, as recorded by others (0284).
MIN_UNREST_FREQUENCY, MAX_UNREST_FREQUENCY = 0.5, 20.0
SINES = 64  # of the unrest (0284; a choice: enough for a nearly normal deviation)
TICK_ROUNDING = 1e-9  # of a period: an instant so little before a tick is on it


@dataclass(frozen=True)
class TrackedMotion:
    """A motion that is known at every instant: the commanded speed u is constant within a control period.

    The speed v follows it with a lag, lag v' = u - v.
    """

    position: Floats  # (n, 3) [m] at the control ticks
    velocity: Floats  # (n, 3) [m/s]
    command: Floats  # (n, 3) [m/s], held from each tick to the next
    period: float  # [s]
    lag: float  # [s]

    def at(self, instants: Floats) -> tuple[Floats, Floats, Floats]:
        """Return position, velocity and acceleration (m, 3) at instants (m,) [s] since the first tick.

        The exact solution of lag v' = u - v in the time t since the tick before, with e = exp(-t/lag):
        x + u t + (v - u) lag (1 - e), u + (v - u) e, -(v - u) e/lag.
        """
        tick, elapsed = self._tick_before(instants)
        command = self.command[tick]
        decay = np.exp(-elapsed / self.lag)
        excess = self.velocity[tick] - command
        position = self.position[tick] + command * elapsed + excess * self.lag * (1.0 - decay)
        return position, command + excess * decay, -excess * decay / self.lag

    def velocity_at(self, instants: Floats) -> Floats:
        """Return the velocity (m, 3) at instants (m,) [s] since the first tick, the one that `at` returns."""
        tick, elapsed = self._tick_before(instants)
        command = self.command[tick]
        return np.asarray(command + (self.velocity[tick] - command) * np.exp(-elapsed / self.lag))

    def _tick_before(self, instants: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the index (m,) of the tick before each instant (m,) [s], and the time (m, 1) [s] since that tick."""
        tick = np.clip((instants / self.period + TICK_ROUNDING).astype(np.int64), 0, len(self.position) - 1)
        return tick, np.maximum(instants - tick * self.period, 0.0)[:, None]

    def mean_acceleration(self, instants: Floats, width: float) -> Floats:
        """Return the acceleration (m, 3) averaged over a time of `width` [s] around each instant (m,) [s].

        A sensor's filter averages as well. The acceleration jumps with the command; sampled at points, these jumps
        would be aliased onto the motion's own frequency.
        """
        velocity_after = self.velocity_at(instants + width / 2)
        velocity_before = self.velocity_at(instants + -width / 2)
        return (velocity_after - velocity_before) / width

    def with_unrest(self, std: float, rng: np.random.Generator) -> TrackedMotion:
        """Return the motion with a vertical deviation w(t) of a standard deviation [m] added.

        w is the sum of 64 sines of random phase, with frequencies from 0.5 to 20 Hz, as many in each octave. A command
        that is higher by w' + lag w'' makes the speed higher by w'.
        """
        frequency = np.exp(rng.uniform(math.log(MIN_UNREST_FREQUENCY), math.log(MAX_UNREST_FREQUENCY), SINES))
        omega = 2 * np.pi * frequency
        time = (np.arange(len(self.position)) * self.period)[:, None]
        phase = 1j * (omega * time + rng.uniform(0, 2 * np.pi, SINES))
        # w, w' and w'' are the real part of the sum of (i omega)^order A exp(i phase); the variance of a sine is A^2/2.
        waves = std * np.sqrt(2 / SINES) * np.exp(phase)
        deviation, speed, acceleration = (((1j * omega) ** order * waves).sum(axis=1).real for order in range(3))
        up = np.array([0.0, 0.0, 1.0])
        return replace(
            self,
            position=self.position + np.outer(deviation, up),
            velocity=self.velocity + np.outer(speed, up),
            command=self.command + np.outer(speed + self.lag * acceleration, up),
        )


@dataclass(frozen=True)
class PositionLoop:
    """A PD law on position that commands speed: gain (z_d - z) + damping (z_d' - z'); the speed follows with a lag."""

    gain: float  # [1/s]
    damping: float
    lag: float  # [s]
    period: float  # [s]

    def track(self, position: Floats, velocity: Floats) -> TrackedMotion:
        """Return the motion that follows setpoints, beginning at rest in the first; `position`, `velocity` are (n, 3).

        The displacement z from the first setpoint and the speed v are driven by u = gain (z_d - z_d0) + damping z_d'.
        """
        n, first = len(position), position[:1]
        drive = self.gain * (position - first) + self.damping * velocity
        displacement, speed = self._respond(drive)[:, :n]
        command = drive - self.gain * displacement - self.damping * speed
        return TrackedMotion(first + displacement, speed.copy(), command, self.period, self.lag)

    def _respond(self, drive: Floats) -> Floats:
        """Return displacement and speed (2, n or more, 3) at the ticks of a drive u (n, 3), from z = v = 0.

        From tick to tick the state s = (z, v) becomes A s + b u. About sqrt(n) blocks of sqrt(n) ticks are followed
        side by side, each from s = 0: fewer steps in Python than n. Then A^i s0 is added at tick i of each block, with
        the state s0 in which it really starts.
        """
        n = len(drive)
        length = max(math.isqrt(n), 1)  # ticks of a block
        blocks = -(-n // length)  # rounded up
        padded = np.zeros((blocks * length, 3))
        padded[:n] = drive
        drive_of_blocks = padded.reshape(blocks, length, 3)
        states = np.zeros((length + 1, 2, blocks, 3))
        powers = [np.eye(2)]  # of A
        for i in range(length):
            states[i + 1] = self._next_state(states[i], drive_of_blocks[:, i])
            powers.append(self._next_state(powers[-1], 0.0))
        starts = np.zeros((2, blocks, 3))
        for k in range(1, blocks):
            starts[:, k] = powers[-1] @ starts[:, k - 1] + states[-1, :, k - 1]
        states[:-1] += np.einsum("iab,bks->iaks", np.array(powers[:-1]), starts)
        return np.asarray(states[:-1].transpose(1, 2, 0, 3).reshape(2, -1, 3))

    def _next_state(self, state: Floats, drive: Floats | float) -> Floats:
        """Return displacement and speed (2, ...) a period after a state (2, ...): A s + b u.

        The command drive - gain z - damping v is held over the period, and the speed follows it with the lag.
        """
        decay = float(np.exp(-self.period / self.lag))
        lag_time = self.lag * (1.0 - decay)  # [s]
        displacement, speed = state
        command = drive - self.gain * displacement - self.damping * speed
        excess = speed - command
        return np.stack([displacement + command * self.period + excess * lag_time, command + excess * decay])
