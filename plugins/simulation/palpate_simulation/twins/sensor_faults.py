"""Faults of a sensor's electronics, which change the wrench that it feels to the one that it reads."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from palpate import Floats


class Electronics:
    """Electronics that read the wrench as it is, unless a fault is set; the sensor's own noise stays."""

    def __init__(self, seed: int = 0) -> None:
        self._latest, self._rng = np.zeros(6), np.random.default_rng(seed)
        self.restore()

    def restore(self) -> None:
        """End every fault."""
        self._stuck, self._scale = False, 1.0
        self._level, self._noise_std = math.inf, 0.0  # [N] at which forces are clipped, and of noise on top
        self._law: Callable[[Floats, Floats], Floats] | None = None  # of times (n,) [s] and loads (n, 3) [N]

    def stick(self) -> None:
        """Repeat the latest reading from now on."""
        self._stuck = True

    def clip(self, level: float, noise: float = 0.0) -> None:
        """Let no force be larger than a level [N], with noise of a standard deviation [N] on top."""
        self._level, self._noise_std = level, noise

    def wrap(self, level: float) -> None:
        """Go on at the other end of the range beyond a level [N], as a number of too few bits does.

        Raises ValueError for a level of 0 or less.
        """
        if level <= 0.0:
            raise ValueError("a level is above 0")
        self._law = lambda _, load: (load + level) % (2.0 * level) - level

    def rescale(self, scale: float) -> None:
        """Read the wrench times a scale, offset and noise included."""
        self._scale = scale

    def compress(self) -> None:
        """Read the square root of a force in newtons."""
        self._law = lambda _, load: np.sign(load) * np.sqrt(np.abs(load))

    def reduce(self, scale: float) -> None:
        """Read the load times a scale, with the offset and noise of the sensor."""
        self._law = lambda _, load: scale * load

    def deaden(self, level: float) -> None:
        """Feel no load up to a level [N], either way, and the rest of a larger one."""
        self._law = lambda _, load: load - load.clip(-level, level)

    def forget(self, time: float) -> None:
        """Lose a constant force within a time [s]; raises ValueError for 0 or less."""
        if time <= 0.0:
            raise ValueError("a time is above 0")
        self._law = HighPass(time)

    def age(self, delay: float) -> None:
        """Read the load of a delay [s] ago."""
        self._law = OldLoads(delay)

    def read(self, times: Floats, wrench: Floats, unloaded: Floats) -> Floats:
        """Return the readings (n, 6) of a wrench (n, 6) [N, N*m] at times (n,) [s].

        `unloaded` (n, 6) is the part of the wrench that is offset and noise; the rest is load.
        """
        if self._stuck:
            return np.tile(self._latest, (len(wrench), 1))
        readings = self._scale * wrench
        if self._law is not None:
            readings[:, :3] = self._law(times, wrench[:, :3] - unloaded[:, :3]) + unloaded[:, :3]
        forces = readings[:, :3].clip(-self._level, self._level)
        if self._noise_std:
            forces += self._noise_std * self._rng.standard_normal(forces.shape)
        readings[:, :3] = forces
        self._latest = readings[-1]
        return readings


class HighPass:
    """A first-order high-pass filter of loads, at rest in the load that it first meets."""

    def __init__(self, time: float) -> None:
        self._time = time  # [s]
        self._mean: Floats | None = None  # m (3,) [N], which is lost
        self._last_time = 0.0  # [s]

    def __call__(self, times: Floats, loads: Floats) -> Floats:
        """Return the filtered loads (n, 3) of loads (n, 3) [N] at times (n,) [s]: load - m, time m' = load - m."""
        passed = np.empty_like(loads)
        for row, (time, load) in enumerate(zip(times.tolist(), loads, strict=True)):
            mean = load if self._mean is None else self._mean
            step = time - self._last_time if self._mean is not None else 0.0
            self._mean = mean + (load - mean) * -math.expm1(-step / self._time)
            self._last_time = time
            passed[row] = load - self._mean
        return passed


class OldLoads:
    """Loads of a time ago."""

    def __init__(self, delay: float) -> None:
        self._delay = delay  # [s]
        self._loads: deque[tuple[float, Floats]] = deque()  # with their times [s]

    def __call__(self, times: Floats, loads: Floats) -> Floats:
        """Return the loads (n, 3) [N] a delay before times (n,) [s]; the first load until it is old enough."""
        old = np.empty_like(loads)
        for row, (time, load) in enumerate(zip(times.tolist(), loads, strict=True)):
            self._loads.append((time, load))
            while len(self._loads) > 1 and self._loads[1][0] <= time - self._delay:
                self._loads.popleft()
            old[row] = self._loads[0][1]
        return old
