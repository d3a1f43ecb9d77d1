"""The force as the guard reads it: its tare, its range, and faults of a sensor that does not measure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from palpate.arm_limits import torque_fault
from palpate.device import Batch, address
from palpate.errors import DeviceError
from palpate.repeated_readings import RepeatCount, Repeats
from palpate.vectors import Floats

from palpate_engine.alignment import Port

_TORQUE = "N*m"
_SECOND = 1e9  # [ns]


class ContactForce:
    """Every force that the stream of the named channel declares, from the standstill on."""

    def __init__(self, port: Port) -> None:
        """Take the port of the force, whose stream declares components, torques and ranges."""
        self.port, self.name = port, port.signal.channel
        self.components = port.components
        self._channels = port.stream.channels
        self.torques = tuple(i for i, channel in enumerate(self._channels) if channel.unit == _TORQUE)
        self.ranges = tuple(self._range(column) for column in self.components)
        self._low, self._high = np.array(self.ranges).T
        self._rows: list[Floats] = []  # (n, channels) at standstill
        self._stamps: list[NDArray[np.int64]] = []  # [ns]
        self.tare: Floats | None = None  # (components,) [N]
        self.torque_tare = np.zeros(0)  # (torques,) [N m]
        self.repeats: Repeats | None = None
        self._count: RepeatCount | None = None

    def _range(self, column: int) -> tuple[float, float]:
        """Return the ends [unit] between which a column measures; infinite where none are stated."""
        limits = self.port.limits if column == self.port.column else self._channels[column].limits
        return limits or (-np.inf, np.inf)

    def _address(self, column: int) -> str:
        return address(self.port.device, self.port.stream, self._channels[column])

    def keep_standstill(self, batch: Batch) -> None:
        """Keep the readings of a batch of the standstill."""
        self._rows.append(batch.values)
        self._stamps.append(batch.time)

    def take_tare(self) -> None:
        """Take tare and usual repeats from the standstill; raises DeviceError where no reading differs from another."""
        rows, stamps = np.concatenate(self._rows), np.concatenate(self._stamps)
        self._rows, self._stamps = [], []
        name_by_column = {
            column: self._address(column)
            for column, channel in enumerate(self._channels)
            if column in self.components or (channel.unit == _TORQUE and self.port.unit != "1")
        }
        # Rate of the stream, by its stamps: repeats are judged by how long they last.
        span = float(stamps[-1] - stamps[0]) / _SECOND
        rate = (len(stamps) - 1) / span if span > 0 else self.port.stream.rate or 1.0
        stream = ".".join(part for part in self.port.key if part)
        repeats = Repeats.of(rows, rate, name_by_column, self.components, stream)
        if repeats.longest[0] == len(rows):
            raise DeviceError(
                f"{repeats.names[0]} repeats its reading in every digit through the standstill, {len(rows)} times: the "
                "sensor or its driver is stuck, or its resolution is too coarse to see that it measures; restart it"
            )
        # Means of the standstill are the tare of each component.
        self.torques = tuple(i for i in self.torques if np.isfinite(rows[:, i]).all())  # others are not measured
        self.torque_tare = rows[:, self.torques].mean(axis=0)
        self.tare = np.nanmean(rows[:, self.components], axis=0)
        self.repeats, self._count = repeats, RepeatCount(repeats)

    def range_fault(self, values: Floats) -> str | None:
        """Return why forces (n, components) are not readings; None where they are."""
        if not np.isfinite(values).all():
            return f"a reading of {self.name} is over range or invalid"
        ends = ((values <= self._low) | (values >= self._high)).any(axis=0)
        if ends.any():
            return f"{self._address(self.components[int(np.flatnonzero(ends)[0])])} is at the end of its range"
        return None

    def torque_fault(self, rows: Floats, limit: float) -> str | None:
        """Return why readings (n, channels) are a torque over `limit` [N m], or none; None where they are in order."""
        return torque_fault(rows[:, self.torques], self.torque_tare, limit)

    def repeat_fault(self, rows: Floats) -> str | None:
        """Return why the sensor no longer measures, after the next readings (n, channels) of a motion; None where it
        does."""
        if self._count is None:
            return None
        self._count.add(rows)
        return self._count.fault
