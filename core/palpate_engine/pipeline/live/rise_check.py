"""Whether the force rises on the way in, as the guard sees force and position."""

from __future__ import annotations

import math
from dataclasses import replace

from palpate.device import Batch
from palpate.sound_force import SoundForce
from palpate.vectors import Floats

from palpate_engine.alignment import Port
from palpate_engine.safety.force_rise import RiseWatch


class RiseCheck:
    """Puts the tip's latest place to the readings of the force, for a `RiseWatch`."""

    def __init__(self, force: Port, position: Port) -> None:
        self._force, self._position = force, position
        self._height, self._place = math.inf, (0.0,)  # [m]
        self._watch: RiseWatch | None = None
        self.sound: SoundForce | None = None  # the force at standstill; None before a motion

    def begin(self, force: Floats, position: Floats, window: float, inertia: float, set_force: float) -> None:
        """A motion comes: standstill of force [N] and position [m], see `SoundForce`, and the force [N] of a law."""
        sound = SoundForce.of(self._force.signal.channel, force, position, window, inertia)
        self.sound = replace(sound, set_force=set_force)
        self._watch = RiseWatch(self.sound)

    def note_tip(self, batch: Batch, height: float) -> None:
        """Readings of the position, of which the latest is at a height [m]."""
        self._height = height
        pose = self._position.stream.layout == "pose"
        self._place = tuple(batch.values[-1, :3].tolist()) if pose else (height,)

    def fault(self, batch: Batch, pushed: Floats) -> str | None:
        """Why tared forces (n,) [N] that push out are not believed; None where they are."""
        if self._watch is None or math.isinf(self._height):
            return None
        return self._watch.add(float(batch.time[-1]) / 1e9, pushed, -self._height, self._place)
