"""The force, read where the sensor's process puts it: no other process has to be awake."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import RepeatCount, Repeats
from palpate_kit.acquisition.ring import Ring

_DEAF = 30_000_000  # [ns] without a reading; a serial line's latency timer of 16 ms is none
_MISSED = 4  # readings, where they come more slowly than that


class ForceEye:
    """Looks at the readings that have come since the last look, and knows for how long there was none."""

    def __init__(self, descriptor: int, facts: dict[str, Any]) -> None:
        self._ring = Ring(descriptor, facts["columns"], facts["rows"])
        self._columns = [facts["first"] + channel for channel in facts["channels"]]
        self._tare, self.stop, self._name = np.array(facts["tare"]), facts["stop"], facts["name"]
        self._normal, self._sign = facts.get("normal", 0), facts.get("sign", 1.0)
        self._low, self._high = np.array(facts.get("ranges") or [(-np.inf, np.inf)]).T
        usual = facts.get("repeats")
        self._repeats = None if usual is None else RepeatCount(Repeats(**usual), facts["first"])
        self.felt: float | None = None  # [N] along the normal, mean of the latest look; None where nothing had come
        self._ring.read()
        self._began = self._heard = self._count = 0

    def deaf(self, now: int) -> bool:
        """Whether readings stay away or repeat themselves, as of the latest look at a time [ns]."""
        if self._repeats is not None and self._repeats.suspect:
            return True
        usual = (self._heard - self._began) / max(self._count, 1)
        return now - self._heard > max(_DEAF, _MISSED * usual)

    def look(self, now: int) -> str | None:
        """Why the arm has to stop at a time [ns]; None where it need not."""
        self._began = self._began or now
        self._heard = self._heard or now
        rows = self._ring.read()
        self.felt = None
        if not len(rows):
            return None
        self._heard, self._count = now, self._count + len(rows)
        forces = rows[:, self._columns]
        tared = forces - self._tare
        largest = float(np.abs(tared).max())
        self.felt = self._sign * float(tared[:, self._normal].mean())
        if largest != largest:
            return f"a reading of {self._name} is over range or invalid"
        ends = ((forces <= self._low) | (forces >= self._high)).any(axis=0)
        if ends.any():
            return f"{self._name if ends[self._normal] else f'a force beside {self._name}'} is at the end of its range"
        if largest > self.stop:
            return f"the force is {largest:.1f} N, over the limit of {self.stop:g} N that stops the motion"
        if self._repeats is None:
            return None
        self._repeats.add(rows)
        return self._repeats.fault
