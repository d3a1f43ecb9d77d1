"""One signal as the guard watches it: its readings at standstill, and how long it is silent."""

from __future__ import annotations

import numpy as np
from palpate.device import Batch
from palpate.errors import DeviceError
from palpate.vectors import Floats

from palpate_engine.alignment import Port
from palpate_engine.safety.reading_age import DRIFT, ReadingAge, StampAge

AHEAD = 1.0  # [s] of a time-stamp, which no clock and no delay explains: a choice
_SECOND = 1e9  # [ns]


class SignalWatch:
    """One signal on its way past the guard."""

    def __init__(self, port: Port) -> None:
        """Take the port of a signal; the age of its readings follows the clock of its stream."""
        self.port, self.name = port, port.signal.channel
        self._standstill: list[Floats] = []
        self._standstill_times: list[int] = []  # [ns] when they were received: first and last of each batch
        self.heard: int | None = None  # [ns] the latest reading, on the clock of the process that receives it
        self.age = ReadingAge(0.0 if port.stream.clock == "host" else DRIFT)  # a device follows the drift of its clock
        self.stamp_age = StampAge() if port.stream.clock == "host" else None
        self.ahead: float | None = None  # [s] of the time-stamp that was most ahead of its arrival
        self._looks: dict[str, int] = {}  # by stream of the device: when that process last looked [ns]

    def of(self, batch: Batch) -> Floats:
        """Return the readings (n,) as the device sent them."""
        return batch.values[:, self.port.column]

    def leap(self, batch: Batch) -> float:
        """Return by how much [s] a time-stamp is ahead of its arrival, beyond all before it; there is at least one."""
        ahead = float((batch.time - batch.received).max()) / _SECOND
        usual = ahead if self.ahead is None else self.ahead
        self.ahead = max(ahead, usual)
        return ahead - usual

    def late_fault(self, batch: Batch, delay: float, limit: float) -> str | None:
        """Return why readings come too late, by age [s] and by stamp, where a sensor has a delay [s]; None in time."""
        self.age.add(batch.time.tolist(), batch.received.tolist())
        fault = self.age.complaint(f"readings of {self.name}", limit)
        if self.stamp_age is not None:
            self.stamp_age.add(int(batch.time[-1]), int(batch.received[-1]))
            fault = fault or self.stamp_age.complaint(f"readings of {self.name}", delay, limit)
        return fault

    def silence(self, stream: str, look: int, has_readings: bool) -> float:
        """Return how long [s] it has been silent for sure, when its process looked at a stream of the device.

        A look counts from the next one at the same stream on: what was received before the first is here by then,
        however late the batches are taken.
        """
        if has_readings and stream == self.port.stream.name:
            self.heard = look
            self._looks.clear()
            return 0.0
        previous_look, self._looks[stream] = self._looks.get(stream), look
        self.heard = look if self.heard is None else self.heard
        return 0.0 if previous_look is None else (previous_look - self.heard) / _SECOND

    def begin(self) -> None:
        """Count silence from now on."""
        self.heard = None
        self._looks.clear()

    def add_standstill(self, batch: Batch) -> None:
        """Keep readings of the standstill; there is at least one."""
        self._standstill.append(self.of(batch))
        self._standstill_times += [int(batch.received[0]), int(batch.received[-1])]

    def at_standstill(self) -> Floats:
        """Return the finite readings (n,) at standstill."""
        values = np.concatenate(self._standstill) if self._standstill else np.zeros(0)
        return values[np.isfinite(values)]

    @property
    def standstill_middle(self) -> int:
        """Time [ns] at which the standstill was half over, on the clock of the process that receives."""
        return (self._standstill_times[0] + self._standstill_times[-1]) // 2


def refuse_other_clocks(force: SignalWatch, position: SignalWatch) -> None:
    """Raise DeviceError where two signals bear the times of clocks that are apart."""
    apart = (force.ahead or 0.0) - (position.ahead or 0.0)
    if abs(apart) > AHEAD:
        first, second = (force, position) if apart > 0 else (position, force)
        raise DeviceError(
            f"the time-stamps of {first.name} are {abs(apart):.3g} s ahead of those of {second.name}: set their clocks "
            "to the same time"
        )
