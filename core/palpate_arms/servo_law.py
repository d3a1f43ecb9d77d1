"""The law that makes commands of setpoints, with its speeds, and the straight way that it makes by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import Floats

from palpate_arms.setpoint_buffer import PERIOD

_SHORTEST = 0.15  # [s] of a way, however short
_OWN = 0.85  # of the speed limit: two steps of that in one tick are still below 1.2 of it
_USUAL_RETRACT_SPEED = 0.05  # [m/s] where nothing states one
OVERSHOOT = 1.37  # in speed, of a mass on a spring whose damping ratio is 0.3: 1 + exp(-pi 0.3 / sqrt(1 - 0.3^2))


@dataclass(frozen=True)
class ServoLaw:
    """How setpoints become commands.

    "pd": the paper's Cartesian law, speed = gain (z_d - z) + damping (z_d' - z'), integrated to positions for `servoL`,
    and never over `most`: an arm that does not follow is not called faster and faster; "servo": the setpoints
    themselves.
    """

    control: str
    gain: float  # [1/s]
    damping: float
    approach_speed: float  # [m/s] at most, on the way to the start
    retract_speed: float  # [m/s] at most; infinite where nothing states one
    acceleration: float  # [m/s^2] of what is not a trajectory
    angular_speed: float = math.radians(10.0)  # [rad/s] at most, on the way to the start
    lever: float = 0.0  # [m] from the tip to the flange, which swings when the tool turns about the tip
    most: float = math.inf  # [m/s] that the law may ask for
    gives_way: bool = False  # whether the arm stands on its controller's spring, and overshoots

    def within(self, limits: dict[str, Any]) -> ServoLaw:
        """Return the law whose own motions and commands keep the limits of a motion, by what the arm does."""
        speed, leaving = limits["speed"], limits.get("retract_speed", 0.0)
        share = _OWN / (OVERSHOOT if self.gives_way else 1.0)
        retract_speed = self.retract_speed
        if math.isinf(retract_speed) and leaving <= speed:
            retract_speed = _USUAL_RETRACT_SPEED
        return replace(
            self,
            approach_speed=min(self.approach_speed, share * speed),
            retract_speed=min(retract_speed, share * max(speed, leaving)),
            angular_speed=limits["angular_speed"],
            most=speed,
        )


def own_law(speed: float, acceleration: float) -> ServoLaw:
    """Return the law of a way that the kit makes by itself at a speed [m/s]."""
    return ServoLaw("servo", 0.0, 0.0, speed, speed, acceleration)


def tick_room(limits: dict[str, Any] | None, state_period: float, ahead: float) -> float:
    """How far [m] a command may go on, so that all which one tick might take at once is at most what is expected.

    That is two of its own steps, and what comes between two states that come more seldom, every `state_period` [s]; the
    latest command is `ahead` [m] of what the controller has taken.
    """
    if limits is None or ahead == 0.0:
        return math.inf
    return float(max(_OWN * limits["speed"] * (PERIOD + state_period) - ahead, 0.0))


@dataclass(frozen=True)
class StraightPath:
    """A straight way from rest to rest, one row for each period."""

    times: Floats  # (n,) [s]
    position: Floats  # (n, 3) [m]
    velocity: Floats  # (n, 3) [m/s]
    left: Floats  # (n,) part of the turn that is still to be made
    turning: Floats  # (n,) [rad/s]


def straight_path(begin: Floats, end: Floats, law: ServoLaw, turn: float = 0.0) -> StraightPath:
    """Return a straight way that turns the tool by an angle [rad] as well.

    Of fifth order in time, s = 10 t^3 - 15 t^4 + 6 t^5: its largest speed is 15/8 of the mean one, its largest
    acceleration 10/sqrt(3) way/duration^2. What the turn moves at its lever counts as way.
    """
    length = float(np.linalg.norm(end - begin)) + turn * law.lever
    duration = max(15 / 8 * length / law.approach_speed, math.sqrt(10 / math.sqrt(3) * length / law.acceleration))
    duration = max(duration, 15 / 8 * turn / law.angular_speed, _SHORTEST)
    times = np.asarray(np.arange(math.ceil(duration / PERIOD) + 1) * PERIOD, np.float64)
    t = np.minimum(times / duration, 1.0)
    done = 10 * t**3 - 15 * t**4 + 6 * t**5
    rate = (30 * t**2 - 60 * t**3 + 30 * t**4) / duration
    position = begin + (end - begin) * done[:, None]
    return StraightPath(times, position, (end - begin) * rate[:, None], 1.0 - done, turn * rate)
