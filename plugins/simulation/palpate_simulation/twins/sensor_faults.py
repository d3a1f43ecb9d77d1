"""What the electronics of a sensor make of the wrench that it feels, when they fail."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from palpate import Floats


class Electronics:
    """Passes readings on; may be stuck, clip the forces, or read another force than it feels, with its own noise."""

    def __init__(self, seed: int = 0) -> None:
        self._latest, self._rng = np.zeros(6), np.random.default_rng(seed)
        self.restore()

    def restore(self) -> None:
        """Without a fault."""
        self._stuck, self._level, self._noise, self._scale = False, math.inf, 0.0, 1.0
        self._law: Callable[[Floats, Floats], Floats] | None = None

    def stick(self) -> None:
        """Repeat the latest reading from now on."""
        self._stuck = True

    def clip(self, level: float, noise: float = 0.0) -> None:
        """Let no force be larger than a level [N], with noise of a standard deviation [N] on top."""
        self._level, self._noise = level, noise

    def wrap(self, level: float) -> None:
        """Go on at the other end of the range beyond a level [N], as a number of too few bits does."""
        if level <= 0.0:
            raise ValueError("a level is above 0")
        self._law = lambda _, load: (load + level) % (2.0 * level) - level

    def rescale(self, scale: float) -> None:
        """Read so many times what is felt."""
        self._scale = scale

    def compress(self) -> None:
        """Read the square root of a force in newtons."""
        self._law = lambda _, load: np.sign(load) * np.sqrt(np.abs(load))

    def reduce(self, scale: float) -> None:
        """Read so many times what is felt."""
        self._law = lambda _, load: scale * load

    def deaden(self, level: float) -> None:
        """Feel nothing of the first newtons, either way."""
        self._law = lambda _, load: load - load.clip(-level, level)

    def forget(self, time: float) -> None:
        """Lose a constant force within a time [s]; raises ValueError for none."""
        if time <= 0.0:
            raise ValueError("a time is above 0")
        self._law = HighPass(time)

    def age(self, delay: float) -> None:
        """Read what was felt a time [s] ago."""
        self._law = OldLoads(delay)

    def read(self, times: Floats, wrench: Floats, unloaded: Floats) -> Floats:
        """Return the readings (n, 6) of a wrench (n, 6) at times (n,) [s]; of which offset and noise are not load."""
        if self._stuck:
            return np.tile(self._latest, (len(wrench), 1))
        readings = self._scale * wrench
        if self._law is not None:
            readings[:, :3] = self._law(times, wrench[:, :3] - unloaded[:, :3]) + unloaded[:, :3]
        forces = readings[:, :3].clip(-self._level, self._level)
        if self._noise:
            forces += self._noise * self._rng.standard_normal(forces.shape)
        readings[:, :3] = forces
        self._latest = readings[-1]
        return readings


class HighPass:
    """A first-order high-pass filter of loads, at rest in the load that it first meets."""

    def __init__(self, time: float) -> None:
        self._time = time  # [s]
        self._mean: Floats | None = None  # (3,) [N] that it has lost
        self._before = 0.0  # [s]

    def __call__(self, times: Floats, loads: Floats) -> Floats:
        """What passes of loads (n, 3) [N] at times (n,) [s]."""
        passed = np.empty_like(loads)
        for row, (time, load) in enumerate(zip(times.tolist(), loads, strict=True)):
            mean = load if self._mean is None else self._mean
            step = time - self._before if self._mean is not None else 0.0
            self._mean = mean + (load - mean) * -math.expm1(-step / self._time)
            self._before = time
            passed[row] = load - self._mean
        return passed


class OldLoads:
    """The loads of a while ago."""

    def __init__(self, delay: float) -> None:
        self._delay = delay  # [s]
        self._loads: deque[tuple[float, Floats]] = deque()

    def __call__(self, times: Floats, loads: Floats) -> Floats:
        """Loads (n, 3) [N] before times (n,) [s]; before its first one that."""
        old = np.empty_like(loads)
        for row, (time, load) in enumerate(zip(times.tolist(), loads, strict=True)):
            self._loads.append((time, load))
            while len(self._loads) > 1 and self._loads[1][0] <= time - self._delay:
                self._loads.popleft()
            old[row] = self._loads[0][1]
        return old
