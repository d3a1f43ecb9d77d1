"""The force, read where the sensor's process puts it: no other process has to be awake."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from palpate import Floats, RepeatCount, Repeats, clock, torque_fault
from palpate_engine import ReadingAge, RiseWatch, SoundForce, TouchSlope, TouchWatch
from palpate_kit.acquisition.ring import Ring, integers

# Choices.
_MAX_SILENCE = 30_000_000  # [ns] without a reading; more than the latency timer of a serial line, 16 ms
_MAX_MISSED = 4  # readings, where they come more slowly than that
_SECOND = 1e9  # [ns]


class ForceEye:
    """The readings since the last look, their checks, and the time for which there was none."""

    def __init__(self, descriptor: int, facts: dict[str, Any]) -> None:
        """Read the ring of a descriptor; `facts` are those of `ArmLink.watch_force`, as plain data."""
        # Columns of the ring: forces, torques, and the clocks of their stamps.
        self._ring = Ring(descriptor, facts["columns"], facts["rows"])
        self._columns = [facts["first"] + channel for channel in facts["channels"]]
        self._tare, self.stop, self._name = np.array(facts["tare"]), facts["stop"], facts["name"]
        self._normal, self._sign = facts.get("normal", 0), facts.get("sign", 1.0)
        self._low, self._high = np.array(facts.get("ranges") or [(-np.inf, np.inf)]).T
        self._torques = [facts["first"] + channel for channel in facts.get("torques", ())]
        # Limits of all axes, and checks of the sensor by the standstill.
        self._torque = np.array(facts.get("torque_tare", ())), facts.get("torque", np.inf)
        repeats = facts.get("repeats")
        self._repeats = None if repeats is None else RepeatCount(Repeats(**repeats), facts["first"])
        self.felt: float | None = None  # [N] along the normal, mean of the latest look; None where nothing had come
        sound = facts.get("sound")
        self._rise = None if sound is None else RiseWatch(SoundForce(**sound))
        self._touch: TouchWatch | None = None
        if self._rise is not None:
            zero_time = clock().now() - self._rise.sound.zero_age
            self._touch = TouchWatch(self._rise.sound, self._rise.contact, zero_time)
        # Ages of the readings, and times [ns] of the first look and of the latest reading, with their number.
        self._tick = facts.get("tick", 0)  # [ns]
        self._clock = facts.get("arrival", 0), facts.get("stamp", 1)  # columns
        self._age, self._oldest = ReadingAge(), facts.get("age", np.inf)
        self._note_age(self._ring.read())  # the standstill shows how late a reading is as a rule
        self._began = self._heard = self._count = 0

    def deaf(self, now: int) -> bool:
        """Return True if readings stay away or repeat themselves, as of the latest look at a time [ns]."""
        if self._repeats is not None and self._repeats.suspect:
            return True
        usual = (self._heard - self._began) / max(self._count, 1)
        return now - self._heard > max(_MAX_SILENCE, _MAX_MISSED * usual)

    @property
    def touches(self) -> list[TouchSlope]:
        """The rise of the force at the begin of each touch so far."""
        return [] if self._touch is None else self._touch.slopes

    def look(
        self,
        now: int,
        depth: float = 0.0,
        place: Floats | None = None,
        in_air: bool | None = None,
        commanded: float = math.nan,
    ) -> str | None:
        """Return why the arm has to stop at a time [ns]; None where it need not.

        The tip has a `depth` [m] below the plane of its station, measured and as `commanded`, and a `place` (3,) [m].
        `in_air` is True where it is as high as travel in free air, False where it is lower, and None where it has not
        shown that it is free.
        """
        # The readings since the last look.
        self._began = self._began or now
        self._heard = self._heard or now
        rows = self._ring.read()
        self.felt = None
        if not len(rows):
            return None
        self._heard, self._count = now, self._count + len(rows)
        forces = rows[:, self._columns]
        tared = forces - self._tare
        normal_force = self._sign * tared[:, self._normal]
        self.felt = self._sign * float(tared[:, self._normal].mean())
        # Limits come first, then the sensor's own faults, which need time to show.
        fault = self._limit_fault(forces, tared, torques=rows[:, self._torques]) or self._sensor_fault(rows)
        if fault is not None:
            return fault
        # The rise of the force with the depth, by which a sensor that reads too little is noticed.
        if self._rise is None or self._touch is None or place is None:
            return None
        location, seconds = place.tolist(), now / _SECOND
        fault = self._rise.add(seconds, normal_force, depth, location, commanded)
        if fault is not None or in_air is None:
            return fault
        return self._touch.fault(seconds, normal_force, depth, location, in_air)

    def _limit_fault(self, forces: Floats, tared: Floats, torques: Floats) -> str | None:
        """Return the limit that readings break, of any axis: not a number, end of the range, force, torque; else None.

        Forces (n, axes) [N] as they come and less their tare, torques (n, axes) [N m] as they come.
        """
        largest = float(np.abs(tared).max())
        if math.isnan(largest):
            return f"a reading of {self._name} is over range or invalid"
        is_at_end = ((forces <= self._low) | (forces >= self._high)).any(axis=0)
        if is_at_end.any():
            subject = self._name if is_at_end[self._normal] else f"a force across {self._name}"
            return f"{subject} is at the end of its range"
        if largest > self.stop:
            return f"the force is {largest:.1f} N, over the limit of {self.stop:g} N that stops the motion"
        return torque_fault(torques, *self._torque)

    def _sensor_fault(self, rows: Floats) -> str | None:
        """Return that readings (n, columns) are late, or repeat themselves; None where they do neither."""
        self._note_age(rows)
        late = self._age.complaint(f"readings of {self._name}", self._oldest)
        if late is not None:
            return late
        if self._repeats is not None:
            self._repeats.add(rows)
            return self._repeats.fault
        return None

    def _note_age(self, rows: Any) -> None:
        """Add the ages of readings (n, columns) whose sensor has a clock of its own."""
        if self._tick:
            arrivals, stamps = (integers(rows, column) for column in self._clock)
            self._age.add((stamps * self._tick).tolist(), arrivals.tolist())
