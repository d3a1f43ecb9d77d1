"""The process of a sensor as its parent sees it: started, watched, and its readings as batches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Batch, Channel, DeviceError, Floats, Layout, Link, SharedReadings, Stream, clock, epoch_offset

from palpate_kit.acquisition.child import Child
from palpate_kit.acquisition.class_place import class_place
from palpate_kit.acquisition.device_clock import ClockMap
from palpate_kit.acquisition.ring import HEAD, ROWS, WORDS, integers
from palpate_kit.acquisition.sensor_reader import SensorReader
from palpate_kit.acquisition.sensor_worker import MODULE

_POLL = 0.004  # [s] between looks for rows: a choice
_MOST_QUIET = 0.01  # [s]; at least so often there is something, if nothing new
_BEAT_SLACK = 0.02  # [s]; a sensor's process beats at least so often
_HOST, _SENSOR = "time of arrival", "time of the sensor"  # columns before those of the streams


def wrench_stream(rate: float, force_limit: float, delay: float = 0.0) -> Stream:
    """Return the stream of a sensor of force and torque: rate [Hz], range of its forces [N], delay of its filters
    [s]."""
    force = [Channel(axis, "N", (-force_limit, force_limit)) for axis in "xyz"]
    torque = [Channel(f"t{axis}", "N*m") for axis in "xyz"]
    return Stream("wrench", (*force, *torque), rate, "wrench", clock="host", frame="sensor", delay=delay)


@dataclass(frozen=True)
class SensorProcess:
    """A process of its own in which a reader reads a sensor, and writes what it reads into shared memory."""

    name: str  # "bota at /dev/ttyUSB0", as messages call it
    reader: type[SensorReader]
    streams: Sequence[Stream]  # of the device; a reading has a value for each of their channels
    settings: Mapping[str, Any]  # for the reader; plain data
    silence: float  # [s]; a longer silence is a fault
    start: float  # longest time to get ready [s]

    @contextmanager
    def link(self) -> Iterator[Link]:
        """Yield the sensor, streaming; raises DeviceError where it does not get ready."""
        # A row of the ring: two times, then the values of each stream; `task` has the settings of the process.
        row = Layout(**{_HOST: 1, _SENSOR: 1, **{stream.name: len(stream.channels) for stream in self.streams}})
        task = {
            "reader": class_place(self.reader),
            "settings": dict(self.settings),
            "columns": row.size,
            "silence": self.silence,
        }
        child = Child(self.name, "sensor", MODULE, task, row.size)
        try:
            yield _SensorLink(self, child, row, child.wait_for("ready", self.start))
        finally:
            child.close()


class _SensorLink:
    """The readings of a sensor's process as batches (a Link)."""

    def __init__(self, process: SensorProcess, child: Child, row: Layout, ready: Mapping[str, Any]) -> None:
        self._process, self._child, self._row, self._ready = process, child, row, ready
        self._clock = ClockMap()
        bits = [f"{stream.name}/{channel.name}" for stream in process.streams for channel in stream.channels]
        self._bits = next(
            (column for column, name in enumerate(bits, row.size - len(bits)) if name.endswith("/bits")), None
        )
        self._counts = dict.fromkeys(("readings", *process.reader.status_bits, "unusable"), 0)

    def shared(self, stream: str) -> SharedReadings | None:
        """Return where other processes find the readings of a stream; None of another device's."""
        if stream not in self._row:
            return None
        row, tick = self._row, self._process.reader.tick
        columns = row.size, row[stream].start, row.at(_HOST), row.at(_SENSOR)
        return SharedReadings(self._child.memory, HEAD, ROWS, *columns, tick)

    def batches(self) -> Iterator[Batch]:
        """Yield the batches that have come, every 4 ms; raises DeviceError as soon as the sensor fails."""
        self._times(self._child.ring.early())  # these came while other devices were connected
        for rows in self._rows():
            stamps, arrivals = self._times(rows)
            self._count(rows)
            for stream in self._process.streams:
                yield Batch(stream.name, stamps, arrivals, rows[:, self._row[stream.name]].copy())

    def _rows(self) -> Iterator[Floats]:
        """Yield rows (n, columns) as they come, n = 0 where none has for 10 ms; raises DeviceError when the sensor
        fails."""
        ring, quiet = self._child.ring, clock().now()
        while True:
            rows = ring.read()
            if len(rows) or clock().now() - quiet > _MOST_QUIET:
                yield rows
                quiet = clock().now()
            if not len(rows):
                self._child.messages()
                self._child.check(self._process.silence + _BEAT_SLACK)
                clock().sleep(_POLL)
            if ring.lost:
                raise DeviceError(f"{self._child.name}: {ring.lost} readings were lost: the host is too slow")

    def _times(self, rows: Floats) -> tuple[Any, Any]:
        """Return the host times (n,) [ns] of the readings and of their arrival."""
        arrivals = integers(rows, self._row.at(_HOST)) + epoch_offset()
        tick = self._process.reader.tick
        if not tick:
            return arrivals, arrivals
        return self._clock.to_host(integers(rows, self._row.at(_SENSOR)) * tick, arrivals), arrivals

    def _count(self, rows: Floats) -> None:
        """Count readings, unusable ones, and those with each status bit."""
        self._counts["readings"] += len(rows)
        first = rows[:, self._row[self._process.streams[0].name]]
        self._counts["unusable"] += int(np.count_nonzero(~np.isfinite(first).all(axis=1)))
        if self._bits is not None:
            bits = rows[:, self._bits].astype(np.int64)
            for name, mask in self._process.reader.status_bits.items():
                self._counts[name] += int(np.count_nonzero(bits & mask))

    @property
    def attended(self) -> int:
        """Time [ns] at which the sensor's process last looked for readings."""
        return self._child.ring.last_beat() + epoch_offset()

    @property
    def health(self) -> Mapping[str, Any]:
        """Health of the sensor, its line and its clock."""
        line_counts = zip(self._process.reader.counters, self._child.ring.head[WORDS:].tolist())
        drift = {"clock_wander": self._clock.wander, "clock_deviation": self._clock.deviation}
        return {**self._ready, **self._counts, **dict(line_counts), **(drift if self._process.reader.tick else {})}
