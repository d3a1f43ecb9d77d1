"""Comparison of the force with the place of the tip, as the guard sees force and position."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from palpate.device import Batch
from palpate.sound_force import SoundForce
from palpate.vectors import Floats

from palpate_engine.alignment import Port
from palpate_engine.safety.force_rise import RiseWatch
from palpate_engine.safety.touch_watch import TouchWatch


@dataclass(frozen=True)
class ExpectedForce:
    """Bounds of the force in a motion."""

    inertia: float  # [N] of the tip at most
    set_force: float  # [N] that a law holds
    stiffness: float  # [N/m] of the stiffest material that the tip may meet
    drift: float  # [N/s] of the sensor's zero


_SECOND = 1e9  # [ns]


class RiseCheck:
    """Puts the tip's latest place to the readings of the force, for a `RiseWatch` and a `TouchWatch`."""

    def __init__(self, force: Port, position: Port) -> None:
        """Take the ports of force and position."""
        self._force, self._position = force, position
        self._height, self._place = math.inf, (0.0,)  # [m]
        self._commanded_height = math.nan  # [m]
        self._watch: RiseWatch | None = None
        self._touch: TouchWatch | None = None
        self._judges_touches = False
        self._zero_time = math.inf  # [s] of the standstill, by the time-stamps of the force
        self.sound: SoundForce | None = None  # the force at standstill; None before a motion

    def begin(self, force: Floats, position: Floats, window: float, expected: ExpectedForce, zero_age: float) -> None:
        """Take the standstill of force [N] and position [m], see `SoundForce`, and what may be expected in the motion
        that comes."""
        sound = SoundForce.of(self._force.signal.channel, force, position, window, expected.inertia)
        self.sound = replace(
            sound,
            set_force=expected.set_force,
            stiffness=expected.stiffness,
            drift=expected.drift,
            zero_std=sound.standard_error(len(force)),
            zero_age=zero_age,
        )
        self._touch, self._judges_touches, self._zero_time = None, False, math.inf
        self._watch = RiseWatch(self.sound)

    def begin_touches(self) -> None:
        """Judge each touch from now on: the tip has shown that it is free."""
        self._judges_touches = self._watch is not None

    def note_tip(self, batch: Batch, height: float) -> None:
        """Take readings of the position, of which the latest is at a height [m]."""
        self._height = height
        pose = self._position.stream.layout == "pose"
        self._place = tuple(batch.values[-1, :3].tolist()) if pose else (height,)

    def note_command(self, batch: Batch) -> None:
        """Take setpoints of the arm whose position it is; those of a pose have its columns."""
        if self._position.stream.layout == "pose" and len(batch.values):
            self._commanded_height = self._position.signal.sign * float(batch.values[-1, self._position.column])

    def fault(self, batch: Batch, pushed: Floats) -> str | None:
        """Return why tared forces (n,) [N] that push out are not believed; None where they are."""
        if self._watch is None or math.isinf(self._height):
            return None
        time, way = float(batch.time[-1]) / _SECOND, -self._height
        self._zero_time = min(self._zero_time, time - self._watch.sound.zero_age)
        complaint = self._watch.add(time, pushed, way, self._place, -self._commanded_height)
        if complaint is not None or not self._judges_touches:
            return complaint
        if self._touch is None:
            self._touch = TouchWatch(self._watch.sound, self._watch.contact, self._zero_time)
        # How high travel is only the process that commands the arm knows.
        return self._touch.fault(time, pushed, way, self._place, False)
