"""A sound force at standstill, by which an arm judges whether the force rises on the way in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.vectors import Floats

NO_SET_FORCE = 1e9  # [N]; no law holds a force
LONGEST = 1e-3  # [m] of a window
POSE = 10.0  # times the noise of the pose, which a window is long at least
_BLOCKS, _SHORTEST = 40, 8  # of a standstill; readings of one


@dataclass(frozen=True)
class SoundForce:
    """A sound force at standstill, in free air, and over which ways it has to rise in contact."""

    name: str
    windows: tuple[float, ...]  # [m]
    std: float  # [N] of one reading
    correlation: float  # by so much the variance of a mean is larger than that of independent readings
    roughness: float  # [N] rms of second differences; 0 where the resolution hides it
    inertia: float  # [N] of the tip's mass, at most
    position_std: float  # [m]
    set_force: float = NO_SET_FORCE  # [N] that a law of the motion holds: there it does not rise

    @classmethod
    def of(cls, name: str, force: Floats, position: Floats, window: float, inertia: float) -> SoundForce:
        """From readings (n,) [N] and positions (m,) [m] at standstill, all finite; `window` [m] besides 1 mm."""
        size = max(len(force) // _BLOCKS, _SHORTEST)
        means = force[: len(force) // size * size].reshape(-1, size).mean(axis=1)
        std = float(force.std())
        of_means = size * float(means.var()) / std**2 if len(means) > 2 and std > 0.0 else 1.0
        steps = np.diff(np.unique(force))
        fine = len(steps) > 0 and std >= float(steps.min())
        roughness = float(np.sqrt(np.mean(np.diff(force, 2) ** 2))) if fine and len(force) > 2 else 0.0
        position_std = float(position.std())
        windows = {min(window, LONGEST), LONGEST}
        judged = tuple(sorted(w for w in windows if w >= POSE * position_std))
        return cls(name, judged, std, max(of_means, 1.0), roughness, inertia, position_std)

    def standard_error(self, count: float) -> float:
        """Of the mean of so many readings [N]."""
        return self.std * math.sqrt(self.correlation / count)
