"""Steps into the material with a rest on each, and out again."""

from itertools import pairwise

import numpy as np
from palpate import Floats, Length, Setpoint, Time, Trajectory
from pydantic import Field


class Stairs(Trajectory):
    """Steps of equal height: each is a smooth way z = z0 + (z1 - z0) (3 u^2 - 2 u^3) and a rest."""

    depth: Length = Field(gt=0, description="of the last step")
    steps: int = Field(default=4, ge=1, description="how many")
    clearance: Length = Field(default=0.002, gt=0, description="height at which it starts and ends")
    way: Time = Field(default=0.5, gt=0, description="for each step")
    rest: Time = Field(default=0.5, gt=0, description="on each step")

    @property
    def total_duration(self) -> float:
        """From rest to rest [s]."""
        return float(self._corners()[0][-1])

    def at(self, time: Floats) -> Setpoint:
        """Setpoints (n, 3)."""
        instants, heights = self._corners()
        position, velocity = np.zeros((len(time), 3)), np.zeros((len(time), 3))
        position[:, 2] = self.clearance
        for (begin, end), (before, after) in zip(pairwise(instants), pairwise(heights), strict=True):
            inside = (time > begin) & (time <= end)
            u = (time[inside] - begin) / (end - begin)
            position[inside, 2] = before + (after - before) * (3 * u**2 - 2 * u**3)
            velocity[inside, 2] = (after - before) * 6 * u * (1 - u) / (end - begin)
        return Setpoint(position, velocity, position[:, 2] < 0)

    def _corners(self) -> tuple[list[float], list[float]]:
        """Return the instants [s] and the heights [m] between which it goes."""
        instants, heights = [0.0], [self.clearance]
        for step in range(1, self.steps + 1):
            instants += [instants[-1] + self.way, instants[-1] + self.way + self.rest]
            heights += [-self.depth * step / self.steps] * 2
        return [*instants, instants[-1] + 2 * self.way], [*heights, self.clearance]
