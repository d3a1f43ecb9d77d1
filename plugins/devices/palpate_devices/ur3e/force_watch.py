"""The force, read where the sensor's process puts it: nobody else has to be awake."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate_devices.process.ring import Ring


class ForceEye:
    """Looks at the readings that have come since the last look."""

    def __init__(self, descriptor: int, facts: dict[str, Any]) -> None:
        self._ring = Ring(descriptor, facts["columns"], facts["rows"])
        self._columns = [facts["first"] + channel for channel in facts["channels"]]
        self._tare, self._stop, self._name = np.array(facts["tare"]), facts["stop"], facts["name"]
        self._ring.read()

    def look(self) -> str | None:
        """Why the arm has to stop; None where it need not."""
        rows = self._ring.read()
        if not len(rows):
            return None
        felt = np.abs(rows[:, self._columns] - self._tare)
        largest = float(felt.max())
        if not largest <= self._stop:
            if largest != largest:
                return f"a reading of {self._name} is over range or invalid"
            return f"the force is {largest:.1f} N, over the limit of {self._stop:g} N that stops the motion"
        return None
