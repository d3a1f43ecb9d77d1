"""A sound force at standstill, against which an arm compares the rise of the force on the way in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.vectors import Floats

NO_SET_FORCE = 1e9  # [N], a choice: so large that no law holds it
LONGEST = 1e-3  # [m], a choice: longest window
POSE = 10.0  # noises of the pose, a choice: a shorter window is not judged
_BLOCKS = 40  # a choice: blocks of a standstill, whose means show the correlation of its readings
_MIN_BLOCK = 8  # readings, a choice: of a block


@dataclass(frozen=True)
class SoundForce:
    """A sound force at standstill, and over which distances and how steeply it rises in contact."""

    name: str
    windows: tuple[float, ...]  # [m]
    std: float  # [N] of one reading
    correlation: float  # variance of a mean over that of independent readings
    roughness: float  # [N] rms of second differences; 0 where the resolution hides it
    inertia: float  # [N] of the tip's mass, at most
    position_std: float  # [m]
    set_force: float = NO_SET_FORCE  # [N] that a law of the motion holds: there it does not rise
    stiffness: float = math.inf  # [N/m] of the stiffest material that the tip may meet
    drift: float = 0.0  # [N/s] of the sensor's zero
    zero_std: float = 0.0  # [N] standard uncertainty of the mean at standstill
    zero_age: float = 0.0  # [s] since the middle of the standstill, when this is made

    @classmethod
    def of(cls, name: str, force: Floats, position: Floats, window: float, inertia: float) -> SoundForce:
        """Return the sound force `name` by its finite readings (n,) [N] and positions (m,) [m] at standstill.

        Its rise is judged over a `window` [m] and over 1 mm; `inertia` [N] is that of the tip's mass, at most.
        """
        std, position_std = float(force.std()), float(position.std())
        # Windows that the noise of the pose does not hide.
        windows = {min(window, LONGEST), LONGEST}
        judged = tuple(sorted(length for length in windows if length >= POSE * position_std))
        return cls(
            name=name,
            windows=judged,
            std=std,
            correlation=_correlation(force, std),
            roughness=_roughness(force, std),
            inertia=inertia,
            position_std=position_std,
        )

    def standard_error(self, count: float) -> float:
        """Return the standard error [N] of the mean of so many readings."""
        return self.std * math.sqrt(self.correlation / count)


def _correlation(force: Floats, std: float) -> float:
    """Return the variance of the means of blocks over that of independent readings (n,) [N], 1 at least."""
    size = max(len(force) // _BLOCKS, _MIN_BLOCK)
    means = force[: len(force) // size * size].reshape(-1, size).mean(axis=1)
    ratio = size * float(means.var()) / std**2 if len(means) > 2 and std > 0.0 else 1.0
    return max(ratio, 1.0)


def _roughness(force: Floats, std: float) -> float:
    """Return the rms of second differences [N] of readings (n,); 0 where the noise is below the resolution."""
    steps = np.diff(np.unique(force))
    is_resolved = len(steps) > 0 and std >= float(steps.min())
    if not is_resolved or len(force) <= 2:
        return 0.0
    return float(np.sqrt(np.mean(np.diff(force, 2) ** 2)))
