"""Driver of a sensor: it opens the line, and makes readings of bytes."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

from palpate import DeviceError

_MAX_BYTES = 4096  # at once; a terminal hands out no more at a time, and room for more would leave holes in the heap


class Reading(NamedTuple):
    """One reading of a sensor."""

    values: Sequence[float]  # of the channels of all its streams, in their order; NaN where invalid
    stamp: int = 0  # of the sensor's clock, unwrapped


class SensorReader(ABC):
    """Opens the line of a sensor, starts its stream and decodes it, in the process of that sensor."""

    tick: ClassVar[int] = 0  # [ns] of one count of the sensor's clock; 0: readings are stamped when they arrive
    counters: ClassVar[tuple[str, ...]] = ()  # names of `counts`, eight at most
    status_bits: ClassVar[Mapping[str, int]] = {}  # masks by name: readings with such a bit in `bits` are counted

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self.settings = settings
        self.counts = dict.fromkeys(self.counters, 0)  # what goes wrong on the line

    @abstractmethod
    def open(self) -> Any:
        """Return the line, which has `fileno` and `close`; raises DeviceError or OSError."""

    def start(self, line: Any) -> Mapping[str, Any]:
        """Make the sensor send; return what is known of it by name, for the result. Raises DeviceError or OSError."""
        return {}

    @abstractmethod
    def read(self, line: Any) -> Iterable[Reading]:
        """Take what has arrived, and return the readings that are complete; raises DeviceError or OSError."""

    def stop(self, line: Any) -> None:  # noqa: B027  (a sensor may go on sending)
        """Make the sensor quiet; what this raises does not matter."""


def received(line: Any) -> bytes:
    """Return the bytes that have arrived at a port; raises DeviceError where it was closed from the other side."""
    data = os.read(line.fileno(), _MAX_BYTES)  # `in_waiting` never says more than 4095, and needs a call more
    if not data:
        raise DeviceError("the sensor is disconnected (its port was closed)")
    return data
