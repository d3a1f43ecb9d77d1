"""The first commands of an arm: to stay, then steps that grow, each with the time that the arm has to answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

from palpate_arms.arm_lag import DELAY
from palpate_arms.servo_law import ServoLaw, straight_path
from palpate_arms.setpoint_buffer import PERIOD
from palpate_arms.station_plane import StationPlane

# Choices (0450).
SIDESTEP = 0.3e-3  # [m] along each lateral axis: a tenth of a second at the speed of the retreat
_SHARES = (0.1, 0.4, 1.0)  # of the retreat beyond the deadband: the arm has come so far after each step
_LONGEST_WAIT = 0.2  # [s] after a step: with four of them a first motion is at most 2 s later
_SETTLED = 10  # periods before a sidestep, from which its place is determined
_SAME_AXIS = 0.5  # cosine between the axes of two steps, which are the same or orthogonal


@dataclass(frozen=True)
class StatedArm:
    """The answer to a command that is stated of an arm."""

    lag: float  # [s]
    deadband: float  # [m] of a command that it may leave undone
    gives_way: bool  # to a force, by its controller's stiffness
    give: float = 0.0  # [m] by which it does so at the force that stops the motion

    @property
    def wait(self) -> float:
        """The time [s] after a step within which the arm answers: two lags and what comes on top of them."""
        return min(DELAY + 2.0 * self.lag, _LONGEST_WAIT)


@dataclass(frozen=True, eq=False)
class HandshakeStep:
    """A step, or none of a command to stay; the arm has answered it by a row of the path."""

    last_row: int
    wait: int  # rows at its end, in which the command stands
    way: Floats  # (3,) [m] from the place at which the path begins
    axis: Floats  # (3,) of length 1, or 0 of a command to stay
    direction: str  # as messages call it


@dataclass(frozen=True)
class HandshakePath:
    """Places in the work frame, one in each period."""

    rows: Floats  # (n, 3) [m]
    steps: tuple[HandshakeStep, ...]

    @property
    def duration(self) -> float:
        """The duration [s]."""
        return len(self.rows) * PERIOD

    def axes(self, last: HandshakeStep) -> list[Floats]:
        """Return the axes (3,) along which it has gone up to the end of a step: orthogonal, and each once."""
        axes: list[Floats] = []
        for step in self.steps[: self.steps.index(last) + 1]:
            if step.axis.any() and all(abs(float(step.axis @ axis)) < _SAME_AXIS for axis in axes):
                axes.append(step.axis)
        return axes


def outward_path(place: Floats, normal: Floats, way: float, law: ServoLaw, stated: StatedArm) -> HandshakePath:
    """Return the path from a place (3,) [m]: stay, then steps along the normal that add up to `way` [m].

    Raises ValueError where the arm's deadband leaves nothing of that way.
    """
    if way <= stated.deadband:
        raise ValueError(f"its deadband of {1e3 * stated.deadband:g} mm is not below the retreat of {1e3 * way:g} mm")
    ways = [stated.deadband + share * (way - stated.deadband) for share in _SHARES]
    legs = [(length * normal, "outwards") for length in ways]
    return _stepped_path(place, round(stated.wait / PERIOD), legs, law, stated)


def sideways_path(
    place: Floats, plane: StationPlane, centre: Floats, law: ServoLaw, stated: StatedArm
) -> HandshakePath:
    """Return the path from a place (3,) [m]: a step along each lateral axis of a plane, towards the box's centre (3,).

    A step is longer by the deadband that is `stated` of the arm; the `law` bounds its speed.
    """
    # Two axes across the normal: the nearest to x, and the one across that.
    normal = plane.normal
    first = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    first /= np.linalg.norm(first)
    # A step along each, on the side of the centre; the second begins at the end of the first.
    length, way, legs = SIDESTEP + stated.deadband, np.zeros(3), []
    for axis, name in ((first, "x"), (np.cross(normal, first), "y")):
        sign = 1.0 if float((centre - place) @ axis) >= 0.0 else -1.0
        way = way + sign * length * axis
        legs.append((way, f"along {'' if sign > 0.0 else '-'}{name}"))
    return _stepped_path(place, _SETTLED, legs, law, stated)


def _stepped_path(
    place: Floats, stay: int, legs: Sequence[tuple[Floats, str]], law: ServoLaw, stated: StatedArm
) -> HandshakePath:
    """Return the path that stays for some rows, then goes to the end of each leg, and waits there.

    A leg is its end (3,) [m] from the place, and the direction in words.
    """
    # First it stays; then each leg, and the time to answer it. `begin` is the end of the leg before, from the place.
    wait = round(stated.wait / PERIOD)
    rows = [np.tile(place, (stay, 1))]
    steps = [HandshakeStep(stay, stay, np.zeros(3), np.zeros(3), "nowhere")]
    begin, count = np.zeros(3), stay
    for end, direction in legs:
        motion = straight_path(place + begin, place + end, law).position[1:]
        rows += [motion, np.tile(place + end, (wait, 1))]
        count += len(motion) + wait
        leg = end - begin
        steps.append(HandshakeStep(count, wait, end, leg / float(np.linalg.norm(leg)), direction))
        begin = end
    return HandshakePath(np.vstack(rows), tuple(steps))
