"""What the servo loop commands: positions in the work frame, one in each period."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PERIOD = 0.002  # [s]
_SHORTEST = 0.15  # [s] of a way, however short
_OUT_OF_LINE = 0.02  # [m] between command and arm: it does not follow


@dataclass(frozen=True)
class Law:
    """How setpoints become commands.

    "pd": the paper's Cartesian law, speed = gain (z_d - z) + damping (z_d' - z'), integrated to positions for `servoL`;
    "servo": the setpoints themselves.
    """

    control: str
    gain: float  # [1/s]
    damping: float
    approach_speed: float  # [m/s] at most, on the way to the start
    retract_speed: float  # [m/s]
    acceleration: float  # [m/s^2] of what is not a trajectory


def way(begin: Floats, end: Floats, speed: float, acceleration: float) -> tuple[Floats, Floats, Floats]:
    """A straight way from rest to rest: times (n,) [s], positions and velocities (n, 3), one for each period.

    Of fifth order in time, s = 10 t^3 - 15 t^4 + 6 t^5: its largest speed is 15/8 of the mean one, its largest
    acceleration 10/sqrt(3) way/duration^2.
    """
    length = float(np.linalg.norm(end - begin))
    duration = max(15 / 8 * length / speed, math.sqrt(10 / math.sqrt(3) * length / acceleration), _SHORTEST)
    times = np.asarray(np.arange(math.ceil(duration / PERIOD) + 1) * PERIOD, np.float64)
    t = np.minimum(times / duration, 1.0)[:, None]
    position = begin + (end - begin) * (10 * t**3 - 15 * t**4 + 6 * t**5)
    return times, position, (end - begin) * ((30 * t**2 - 60 * t**3 + 30 * t**4) / duration)


class Commander:
    """Holds, goes to the start, follows a table of setpoints, or retracts; says where the tip shall be next."""

    def __init__(self, law: Law, position: Floats) -> None:
        self._law = law
        self._command = position.copy()
        self._speed = np.zeros(3)
        self._table: Floats = np.zeros((0, 7))
        self._row = 0
        self._way: list[Floats] = []
        self.home: Floats | None = None  # where the motion began
        self.mode = "hold"  # "hold", "approach", "follow", "retract", "done"

    @property
    def setpoint(self) -> Floats:
        """Position, velocity (3 + 3) and whether it is meant for estimation, as of now."""
        if self.mode == "follow" and len(self._table):
            return np.array(self._table[min(self._row, len(self._table) - 1)])
        return np.array([*self._command, *self._speed, 0.0])

    @property
    def command(self) -> Floats:
        """The latest command (3,)."""
        return self._command

    def follow(self, table: Floats) -> None:
        """Go to the first setpoint, then through the table (n, 7): position, velocity, measuring."""
        self._table, self._row, self.mode = table, 0, "approach"
        start = table[0, :3]
        _, position, _ = way(self._command, start, self._law.approach_speed, self._law.acceleration)
        self._way = list(position[1:])
        self.home = start.copy()

    def retract(self) -> None:
        """Brake, and go back along the normal to the height where the motion began."""
        if self.mode in ("approach", "follow"):
            self.mode = "retract"
        elif self.mode == "hold":
            self.mode = "done"

    def next(self, position: Floats, velocity: Floats) -> Floats:
        """The command (3,) for this period, from the measured position and velocity (3,) in the work frame."""
        if self.mode == "approach":
            if self._way:
                self._command = self._way.pop(0)
            else:
                self.mode = "follow"
        if self.mode == "follow":
            self._follow(position, velocity)
        elif self.mode == "retract":
            self._retract()
        return self._command

    def _follow(self, position: Floats, velocity: Floats) -> None:
        law = self._law
        row = self._table[min(self._row, len(self._table) - 1)]
        before = self._command
        if law.control == "pd":
            speed = law.gain * (row[:3] - position) + law.damping * (row[3:6] - velocity)
            self._command = before + speed * PERIOD
        else:
            self._command = row[:3].copy()
        self._speed = (self._command - before) / PERIOD
        self._row += 1
        if self._row >= len(self._table):
            self.mode = "done"

    def _retract(self) -> None:
        assert self.home is not None
        step, rest = self._law.acceleration * PERIOD, float(self.home[2] - self._command[2])
        # The speed from which it still can brake in what is left of the way.
        wanted = min(self._law.retract_speed, math.sqrt(2.0 * self._law.acceleration * max(rest, 0.0)))
        goal = np.array([0.0, 0.0, wanted])
        change = goal - self._speed
        length = float(np.linalg.norm(change))
        self._speed = goal if length <= step else self._speed + change * (step / length)
        self._command = self._command + self._speed * PERIOD
        if rest < 1e-5 and float(np.abs(self._speed).max()) < 2 * step:
            self.mode = "done"

    def lags(self, position: Floats) -> bool:
        """Whether the arm is so far from the command that it cannot be following it."""
        return bool(max(abs(self._command - position)) > _OUT_OF_LINE)
