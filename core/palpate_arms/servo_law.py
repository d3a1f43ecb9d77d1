"""The law that makes commands of setpoints, with its speeds, and the straight way that it makes by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from palpate import Floats

from palpate_arms.setpoint_buffer import PERIOD

_MIN_DURATION = 0.15  # [s] of a way, however short, a choice
_OWN_SHARE = 0.85  # of the speed limit, a choice: two steps of that in one tick are still below 1.2 of it (0151)
_USUAL_RETRACT_SPEED = 0.05  # [m/s] where nothing states one, a choice
# Of the way from rest to rest s = 10 t^3 - 15 t^4 + 6 t^5, at the extremes of its derivatives.
_PEAK_SPEED = 15 / 8  # over the mean speed
_PEAK_ACCELERATION = 10 / math.sqrt(3)  # over the way and the square of the duration
OVERSHOOT = 1.37  # in speed, of a mass on a spring whose damping ratio is 0.3: 1 + exp(-pi 0.3 / sqrt(1 - 0.3^2))


@dataclass(frozen=True)
class ServoLaw:
    """The law that makes commands of setpoints.

    "pd": the paper's Cartesian law, speed = gain (z_d - z) + damping (z_d' - z'), integrated to positions for `servoL`,
    and never over `max_speed`: an arm that does not follow is not called faster and faster; "servo": the setpoints
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
    max_speed: float = math.inf  # [m/s] that the law may ask for
    gives_way: bool = False  # the arm stands on its controller's spring, and overshoots (0406)

    def within(self, limits: dict[str, Any]) -> ServoLaw:
        """Return the law whose own motions and commands keep the limits of a motion, by what the arm does."""
        speed, leaving_speed = limits["speed"], limits.get("retract_speed", 0.0)
        share = _OWN_SHARE / (OVERSHOOT if self.gives_way else 1.0)
        retract_speed = self.retract_speed
        if math.isinf(retract_speed) and leaving_speed <= speed:
            retract_speed = _USUAL_RETRACT_SPEED
        return replace(
            self,
            approach_speed=min(self.approach_speed, share * speed),
            retract_speed=min(retract_speed, share * max(speed, leaving_speed)),
            angular_speed=limits["angular_speed"],
            max_speed=speed,
        )


def own_law(speed: float, acceleration: float) -> ServoLaw:
    """Return the law of a way that the kit makes by itself at a speed [m/s]."""
    return ServoLaw("servo", 0.0, 0.0, speed, speed, acceleration)


def tick_room(limits: dict[str, Any] | None, state_period: float, ahead: float) -> float:
    """Return how far [m] a command may go on, so that what one tick may take at once is at most what is expected.

    That is two of its own steps, and what comes between two states that come more seldom, every `state_period` [s]; the
    latest command is `ahead` [m] of what the controller has taken.
    """
    if limits is None or ahead == 0.0:
        return math.inf
    return float(max(_OWN_SHARE * limits["speed"] * (PERIOD + state_period) - ahead, 0.0))


@dataclass(frozen=True)
class StraightPath:
    """A straight way from rest to rest, one row for each period."""

    times: Floats  # (n,) [s]
    position: Floats  # (n, 3) [m]
    velocity: Floats  # (n, 3) [m/s]
    remaining_turn: Floats  # (n,) part of the turn that remains
    turning: Floats  # (n,) [rad/s]


def straight_path(begin: Floats, end: Floats, law: ServoLaw, turn: float = 0.0) -> StraightPath:
    """Return a straight way that turns the tool by an angle [rad] as well.

    Of fifth order in time, s = 10 t^3 - 15 t^4 + 6 t^5: its largest speed is 15/8 of the mean one, its largest
    acceleration 10/sqrt(3) way/duration^2. What the turn moves at its lever counts as way.
    """
    # The duration that keeps speed, acceleration and angular speed.
    length = float(np.linalg.norm(end - begin)) + turn * law.lever
    by_speed = _PEAK_SPEED * length / law.approach_speed
    by_acceleration = math.sqrt(_PEAK_ACCELERATION * length / law.acceleration)
    duration = max(by_speed, by_acceleration, _PEAK_SPEED * turn / law.angular_speed, _MIN_DURATION)
    # The share of the way at each period, and its rate.
    times = np.asarray(np.arange(math.ceil(duration / PERIOD) + 1) * PERIOD, np.float64)
    t = np.minimum(times / duration, 1.0)
    share = 10 * t**3 - 15 * t**4 + 6 * t**5
    rate = (30 * t**2 - 60 * t**3 + 30 * t**4) / duration
    position = begin + (end - begin) * share[:, None]
    return StraightPath(times, position, (end - begin) * rate[:, None], 1.0 - share, turn * rate)
