"""A tip that the force leads: one loop for the arm's own process and for the simulated rig."""

from __future__ import annotations

import math
from typing import Any

from palpate import ForceLaw

# Choices.
_SMOOTHING = 0.01  # [s] time constant over which readings of the force are averaged
_END_MARGIN = 2e-5  # [m] from the deepest place of the envelope: there it is reached
_MAX_PULL, _MAX_PULL_SHARE = 0.5, 0.25  # [N], and share of the force to hold: a larger pull is a wrong sign
_MAX_SILENCE = 0.1  # [s] without a reading
_MARGIN = 1e-3  # [m] by which the tip may be below the envelope, as a loop swings
_MAX_STOP_SHARE = 0.8  # of the force that stops the motion; more would stop it by its own noise and swing
_ROUNDING = 1 + 1e-9  # times a limit that a setting may equal
_MS = _MM = 1e3  # per second, per metre


def refusal(law: ForceLaw, stop: float | None, speed: float, acceleration: float, duration: float) -> str | None:
    """Return why a law is not allowed for an arm with these limits, in a motion of a duration [s]; None where it is.

    The limits are the force [N] that stops the motion, a speed [m/s] and an acceleration [m/s^2]. Without a `stop` the
    force is not read.
    """
    if stop is None:
        return (
            "the controlled force has to be read by the arm's own process, and the sensor does not share its readings"
        )
    numbers = (law.force, law.begin, law.end, law.speed, law.acceleration, law.gain)
    if not all(map(math.isfinite, numbers)) or min(law.force, law.speed, law.acceleration, law.gain) <= 0:
        return "a setting of the force control is not finite, or not above 0"
    if law.force > _MAX_STOP_SHARE * stop:
        return f"a force of {law.force:g} N is more than {_MAX_STOP_SHARE:g} of the {stop:g} N that stop the motion"
    if law.speed > speed * _ROUNDING:
        return f"the force control may move at {_MM * law.speed:g} mm/s, over the limit of {_MM * speed:g} mm/s"
    if law.acceleration > acceleration * _ROUNDING:
        return (
            f"the force control may accelerate at {law.acceleration:g} m/s^2, over the limit of {acceleration:g} m/s^2"
        )
    if not 0 <= law.begin < law.end <= duration:
        return "the force control's times are not those of the motion"
    return None


class ForceLead:
    """Height and speed that the force law commands, one period after another.

    v = -gain (force - felt), within the speed and with the acceleration of the law, and never so fast inwards that it
    could not brake before the deepest place of the envelope; outside of the law's time it goes to the top. The height
    never goes below the envelope's of that time.
    """

    def __init__(self, law: ForceLaw, top: float, bottom: float, period: float) -> None:
        self.law, self.top, self.bottom, self.period = law, top, bottom, period
        self.height, self.speed = top, 0.0
        self._felt = 0.0  # [N] smoothed over the readings
        self._share = 1.0 - math.exp(-period / _SMOOTHING)  # of a new reading
        self._silence = 0.0  # [s] since the latest reading

    @classmethod
    def of(cls, law: ForceLaw, heights: Any, period: float) -> ForceLead:
        """Return the loop within the heights (n,) [m] of an envelope."""
        return cls(law, float(heights[0]), float(heights.min()), period)

    def hear(self, force: float | None) -> None:
        """Take over the force [N] of this period; None without a reading."""
        if force is None:
            self._silence += self.period
            return
        self._silence = 0.0
        self._felt += self._share * (force - self._felt)

    def next(self, time: float, floor: float) -> tuple[float, float]:
        """Return height [m] and speed [m/s] at a time [s] of the motion, whose envelope has its `floor` [m] now."""
        law, step = self.law, self.law.acceleration * self.period
        if time < law.begin:
            return self.height, self.speed
        # The speed by the law, or on the way out.
        if time < law.end:
            goal = -law.gain * (law.force - self._felt)
            goal = min(max(goal, -law.speed), law.speed)
        else:
            goal = law.speed
        # Not so fast that it could not brake before the ends of the envelope.
        goal = min(goal, self._braking_speed(self.top - self.height))
        goal = max(goal, -self._braking_speed(self.height - self.bottom))
        # By the acceleration of the law, and within the envelope of now.
        former = self.height
        self.speed += min(max(goal - self.speed, -step), step)
        self.height = min(max(former + self.speed * self.period, floor), self.top)
        self.speed = (self.height - former) / self.period
        return self.height, self.speed

    def _braking_speed(self, way: float) -> float:
        """Return the speed [m/s] from which half the acceleration brings it to rest within a way [m]: v^2 = a s."""
        return math.sqrt(self.law.acceleration * max(way, 0.0))

    def fault(self, time: float, tip: float) -> str | None:
        """Return why the motion has to end, at a time [s] and with the tip at a height [m]; None if it need not."""
        law = self.law
        if not law.begin <= time < law.end:
            return None
        if self.height <= self.bottom + _END_MARGIN:
            depth = _MM * (self.top - self.bottom)
            return (
                f"the controlled force is {self._felt:.2f} N and not {law.force:g} N at the end of its envelope, "
                f"{depth:.3g} mm below the start: deeper it may not go"
            )
        if tip < self.bottom - _MARGIN:
            return f"the tip is {_MM * (self.bottom - tip):.2f} mm below the envelope of the force control"
        if self._felt < -_MAX_PULL - _MAX_PULL_SHARE * law.force:
            return (
                f"the controlled force pulls with {-self._felt:.2f} N: does the sensor count the other way round "
                "([alignment] force sign = -1)?"
            )
        if self._silence > _MAX_SILENCE:
            return f"no reading of the controlled force for {_MS * self._silence:.0f} ms"
        return None
