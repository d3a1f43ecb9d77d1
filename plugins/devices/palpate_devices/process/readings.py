"""What the process of a sensor has read, as its link passes it on."""

from __future__ import annotations

from collections.abc import Iterator

from palpate import DeviceError, Floats, Layout, SharedReadings, clock

from palpate_devices.process.child import Child
from palpate_devices.process.clock import epoch_offset
from palpate_devices.process.ring import HEAD, ROWS

_POLL = 0.004  # [s]
_MOST_QUIET = 0.01  # [s]; at least so often there is something, if nothing new
_BEAT_SLACK = 0.02  # [s]; a sensor's process beats at least so often


class SensorReadings:
    """The rows that a sensor's process writes into its ring, watched on the way."""

    def __init__(self, child: Child, row: Layout, silence: float) -> None:
        self._child, self._row, self._beat_limit = child, row, silence + _BEAT_SLACK

    def early(self) -> Floats:
        """Rows (n, columns) that came while other devices were connected."""
        return self._child.ring.early()

    def rows(self) -> Iterator[Floats]:
        """Rows (n, columns) as they come, n = 0 where none has for 10 ms; raises DeviceError when the sensor fails."""
        quiet = clock().now()
        while True:
            rows = self._child.ring.read()
            if len(rows) or clock().now() - quiet > _MOST_QUIET:
                yield rows
                quiet = clock().now()
            if not len(rows):
                self._child.messages()
                self._child.check(self._beat_limit)
                clock().sleep(_POLL)
            if self._child.ring.lost:
                lost = self._child.ring.lost
                raise DeviceError(f"{self._child.name}: {lost} readings were lost: the host is too slow")

    def shared(self, stream: str) -> SharedReadings | None:
        """Where the wrench is for other processes; None for other streams."""
        if stream != "wrench":
            return None
        return SharedReadings(self._child.memory, HEAD, ROWS, self._row.size, self._row["wrench"].start)

    @property
    def attended(self) -> int:
        """When the sensor's process last looked for readings [ns]."""
        return self._child.ring.last_beat() + epoch_offset()
