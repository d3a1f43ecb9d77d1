"""A skin that moves under the tip: it breathes, coughs, or rises as the person does."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from palpate import Floats

from palpate_simulation.twins.arm import TICK

_Path = Callable[[Floats], Floats]  # heights (n,) [m] at times (n,) [s]


class MovingSkin:
    """Height of a skin over where it rests, along z of the work frame, as the sum of its motions."""

    def __init__(self) -> None:
        self._paths: list[_Path] = []
        self._breath: _Path | None = None

    def breathe(self, height: float, rate: float, now: float) -> None:
        """Rise by a height [m] and fall again at a rate [Hz], from a time [s] on; a rate of 0 ends it.

        The height is h/2 (1 - cos(2 pi rate t)). Raises ValueError.
        """
        if not (math.isfinite(height) and 0.0 <= rate < math.inf):
            raise ValueError
        self._breath = None
        if rate:
            self._breath = lambda times: 0.5 * height * (1.0 - np.cos(2.0 * np.pi * rate * (times - now)))

    def rise(self, height: float, duration: float, now: float) -> None:
        """Rise by a height [m], or fall by one below 0, within a duration [s] from a time [s] on, and stay there.

        Raises ValueError.
        """
        if not (math.isfinite(height) and 0.0 < duration < math.inf):
            raise ValueError
        self._paths.append(lambda times: height * _smooth_step((times - now) / duration))

    def cough(self, height: float, duration: float, now: float) -> None:
        """Rise by a height [m] within a duration [s], and fall back in as long."""
        self.rise(height, duration, now)
        self.rise(-height, duration, now + duration)

    @property
    def moves(self) -> bool:
        """True if the skin moves or has moved."""
        return bool(self._paths) or self._breath is not None

    def motion(self, times: Floats) -> tuple[Floats, Floats]:
        """Return heights (n,) [m] and speeds (n,) [m/s] at times (n,) [s]."""
        return self._height(times), (self._height(times + TICK) - self._height(times - TICK)) / (2.0 * TICK)

    def _height(self, times: Floats) -> Floats:
        """Return the sum of all motions, heights (n,) [m] at times (n,) [s]."""
        paths = [*self._paths, *([] if self._breath is None else [self._breath])]
        return np.asarray(sum((path(times) for path in paths), np.zeros_like(times)))


def _smooth_step(share: Floats) -> Floats:
    """Return 10 t^3 - 15 t^4 + 6 t^5 (n,), which rises from 0 to 1 with shares t (n,) of a time.

    The only polynomial of fifth order whose speed and acceleration are 0 at both ends.
    """
    t = np.clip(share, 0.0, 1.0)
    return np.asarray(10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5)
