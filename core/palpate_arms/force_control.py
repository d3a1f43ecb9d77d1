"""A tip that the force leads: one loop for the arm's own process and for the simulated rig."""

from __future__ import annotations

import math
from typing import Any

from palpate import ForceLaw

_SMOOTH = 0.01  # [s] time constant over which readings of the force are averaged
_AT_END = 2e-5  # [m] from the deepest place of the envelope: no deeper
_PULL, _PULLED = 0.5, 0.25  # [N] and part of the force, by which less than none is felt: the sign is wrong
_UNHEARD = 0.1  # [s] without a reading
_MARGIN = 1e-3  # [m] by which the tip may be below the envelope, as a loop swings
_OF_STOP = 0.8  # of the force that stops the motion; more would stop it by its own noise and swing


def refusal(law: ForceLaw, stop: float | None, speed: float, acceleration: float, duration: float) -> str | None:
    """Return why a law is not allowed for an arm with these limits; None where it is. No `stop` [N]: the force is
    not read."""
    if stop is None:
        return (
            "the controlled force has to be read by the arm's own process, and the sensor does not share its readings"
        )
    numbers = (law.force, law.begin, law.end, law.speed, law.acceleration, law.gain)
    if not all(map(math.isfinite, numbers)) or min(law.force, law.speed, law.acceleration, law.gain) <= 0:
        return "a setting of the force control is not finite, or not above 0"
    if law.force > _OF_STOP * stop:
        return f"a force of {law.force:g} N is more than {_OF_STOP:g} of the {stop:g} N that stop the motion"
    if law.speed > speed * (1 + 1e-9):
        return f"the force control may move at {1e3 * law.speed:g} mm/s, over the limit of {1e3 * speed:g} mm/s"
    if law.acceleration > acceleration * (1 + 1e-9):
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
        self._felt = 0.0
        self._share = 1.0 - math.exp(-period / _SMOOTH)
        self._unheard = 0.0

    @classmethod
    def of(cls, law: ForceLaw, heights: Any, period: float) -> ForceLead:
        """From the heights (n,) [m] of an envelope."""
        return cls(law, float(heights[0]), float(heights.min()), period)

    def hear(self, force: float | None) -> None:
        """The force [N] of this period; None without a reading."""
        if force is None:
            self._unheard += self.period
            return
        self._unheard = 0.0
        self._felt += self._share * (force - self._felt)

    def next(self, time: float, floor: float) -> tuple[float, float]:
        """Height [m] and speed [m/s] at a time [s] of the motion, whose envelope is at a `floor` [m]."""
        law, step = self.law, self.law.acceleration * self.period
        if time < law.begin:
            return self.height, self.speed
        if time < law.end:
            wanted = -law.gain * (law.force - self._felt)
            wanted = min(max(wanted, -law.speed), law.speed)
        else:
            wanted = law.speed
        wanted = min(wanted, self._brakes(self.top - self.height))
        wanted = max(wanted, -self._brakes(self.height - self.bottom))
        before = self.height
        self.speed += min(max(wanted - self.speed, -step), step)
        self.height = min(max(before + self.speed * self.period, floor), self.top)
        self.speed = (self.height - before) / self.period
        return self.height, self.speed

    def _brakes(self, way: float) -> float:
        """Return the speed [m/s] from which it comes to rest within a way [m], with half of its acceleration."""
        return math.sqrt(self.law.acceleration * max(way, 0.0))

    def fault(self, time: float, tip: float) -> str | None:
        """Return why the motion has to end, at a time [s] of it and with the tip at a height [m]; None where it need
        not."""
        law = self.law
        if not law.begin <= time < law.end:
            return None
        if self.height <= self.bottom + _AT_END:
            depth = 1e3 * (self.top - self.bottom)
            return (
                f"the controlled force is {self._felt:.2f} N and not {law.force:g} N at the end of its envelope, "
                f"{depth:.3g} mm below the start: deeper it may not go"
            )
        if tip < self.bottom - _MARGIN:
            return f"the tip is {1e3 * (self.bottom - tip):.2f} mm below the envelope of the force control"
        if self._felt < -_PULL - _PULLED * law.force:
            return (
                f"the controlled force pulls with {-self._felt:.2f} N: does the sensor count the other way round "
                "([alignment] force sign = -1)?"
            )
        if self._unheard > _UNHEARD:
            return f"no reading of the controlled force for {1e3 * self._unheard:.0f} ms"
        return None
